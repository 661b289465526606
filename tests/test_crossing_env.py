"""`aerofed.gym.crossing`: several vehicles as PettingZoo knows them."""

import warnings
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pettingzoo")
from pettingzoo.test import parallel_api_test, parallel_seed_test

import aerofed
from aerofed.gym.crossing import CrossingEnv

STILL = np.zeros(3, dtype=np.float32)


@pytest.mark.slow
def test_it_is_what_pettingzoo_calls_an_environment_and_repeats(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(CrossingEnv(3, radius_m=4.0, wind_mps=5), num_cycles=80)
    assert "Passed" in capsys.readouterr().out  # both tests of PettingZoo's raise where it fails
    parallel_seed_test(lambda: CrossingEnv(2, wind_mps=5), num_cycles=30)


@pytest.mark.slow
def test_who_flies_straight_ahead_is_hit_and_out() -> None:
    env = CrossingEnv(3, overrides={"vehicle.aircraft.sensors.kind": "perfect"}, radius_m=10.0)
    seen, infos = env.reset(seed=2)
    assert infos["vehicle-1"]["separation_m"] == pytest.approx(10.0 * 3**0.5, abs=0.1)
    for name, other in (("vehicle-1", "vehicle-2"), ("vehicle-2", "vehicle-3")):
        # To the place of the next one, which is where another one is seen to be.
        others = seen[name].reshape(3, 6)[1:, :3]
        assert np.abs(others - seen[name][:3]).sum(axis=1).min() < 0.01, other
    total = dict.fromkeys(env.agents, 0.0)
    out: dict[str, bool] = {}
    middle = {name: seen[name].reshape(3, 6)[:, :3][1:].mean(axis=0) * 2 / 3 for name in env.agents}
    while env.agents and not any(out.values()):
        actions = {name: np.clip(middle[name] / 50.0, -1, 1) for name in env.agents}
        seen, rewards, out, over, infos = env.step(actions)
        assert not any(over.values())
        total = {name: total[name] + reward for name, reward in rewards.items()}
    hit = [name for name, is_out in out.items() if is_out]
    assert len(hit) >= 2
    assert set(env.agents) == set(out) - set(hit)
    for name in hit:
        assert infos[name]["separation_m"] < 0.76
        assert total[name] < 0.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"count": 1}, "count = 1: it takes two to cross"),
        ({"count": 65}, "65 vehicles: from 1 to 64 in one world"),
        ({"radius_m": 0}, "radius_m = 0: must be more than 0, at most 300"),
        ({"separation_m": "5"}, "separation_m = '5': must be more than 0"),
        ({"max_cycles": 0}, "max_cycles = 0: must be more than 0"),
        ({"wind_mps": -1}, "vehicle.aircraft.wind.speed_mps = -1"),
    ],
)
def test_options_that_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(aerofed.InputError, match=words):
        CrossingEnv(**options)


def test_actions_that_are_refused() -> None:
    env = CrossingEnv(2)
    with pytest.raises(
        aerofed.InputError, match=r"actions of \['vehicle-1'\]: the agents are \[\]"
    ):
        env.step({"vehicle-1": STILL})
    env.reset(seed=1)
    with pytest.raises(aerofed.InputError, match=r"action = .*: must be 3 numbers from -1 to 1"):
        env.step({"vehicle-1": STILL, "vehicle-2": STILL[:2]})
    with pytest.raises(aerofed.InputError, match=r"stand 0\.20 m apart"):
        CrossingEnv(2, radius_m=0.1).reset(seed=1)
