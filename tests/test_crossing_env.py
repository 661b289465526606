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
PERFECT = {"vehicle.aircraft.sensors.kind": "perfect"}


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
    env = CrossingEnv(3, overrides=PERFECT, radius_m=10.0)
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


def test_what_each_sees_and_earns_follows_from_the_circle() -> None:
    """Four on a circle of 6 m: neighbours 6 sqrt(2) m apart, and each is to go 12 m across."""
    env = CrossingEnv(4, overrides=PERFECT, radius_m=6.0, separation_m=9.0, max_cycles=40)
    seen, infos = env.reset(seed=2)
    turned = np.random.default_rng(2).uniform(0.0, 2.0 * np.pi) + np.arange(4) * np.pi / 2.0
    homes = 6.0 * np.column_stack((np.cos(turned), np.sin(turned), np.zeros(4)))
    side_m = 6.0 * 2.0**0.5
    for me, name in enumerate(env.possible_agents):
        rows = seen[name].reshape(4, 6)
        assert rows.dtype == np.float32
        assert rows[0, :3] == pytest.approx(-2.0 * homes[me], abs=0.05)
        assert np.linalg.norm(rows[1:, :3], axis=1) == pytest.approx(
            [side_m, side_m, 12.0], abs=0.05
        )
        beside = sorted((homes[each % 4] - homes[me]).tolist() for each in (me + 1, me + 3))
        assert np.array(sorted(rows[1:3, :3].tolist())) == pytest.approx(np.array(beside), abs=0.05)
        assert infos[name] == {"separation_m": pytest.approx(side_m, abs=0.05)}
    # The first goes up and outwards, the third across, 25 m/s and up 4 m/s at most; two stand.
    out = homes[0] / 6.0
    orders = {
        "vehicle-1": (*(0.08 * out[:2]), 0.5),
        "vehicle-2": STILL,
        "vehicle-3": 0.08 * out,
        "vehicle-4": STILL,
    }
    places, at_goal = homes.copy(), np.roll(homes, 2, axis=0)
    for cycle in range(1, 41):
        before_m = np.linalg.norm(at_goal - places, axis=1)
        seen, rewards, outs, overs, infos = env.step(orders)
        for me, name in enumerate(env.possible_agents):
            rows = seen[name].reshape(4, 6)
            places[me] = at_goal[me] - rows[0, :3]
        away_m = np.linalg.norm(at_goal - places, axis=1)
        for me, name in enumerate(env.possible_agents):
            apart_m = np.linalg.norm(np.delete(places, me, axis=0) - places[me], axis=1)
            short_m = sum(9.0 - each for each in apart_m if each < 9.0)
            expected = before_m[me] - away_m[me] - short_m
            assert rewards[name] == pytest.approx(expected, abs=0.05), (cycle, name)
            others = np.delete(seen[name].reshape(4, 6), 0, axis=0)
            assert np.linalg.norm(others[:, :3], axis=1) == pytest.approx(
                np.sort(apart_m), abs=0.05
            )
            assert not outs[name]
            assert overs[name] is (cycle == 40)
        assert env.agents == ([] if cycle == 40 else env.possible_agents)
    first, third = (seen[name].reshape(4, 6) for name in ("vehicle-1", "vehicle-3"))
    assert first[0, 3:] == pytest.approx([*(2.0 * out[:2]), 2.0], abs=0.1)
    assert third[0, 3:] == pytest.approx(2.0 * out, abs=0.1)
    # Standing ones move against it as it moves, backwards.
    assert first[1:, 3:].sum(axis=0) == pytest.approx(third[0, 3:] - 3.0 * first[0, 3:], abs=0.05)
    # The third has passed the middle, 6 m from the two that stand; the first left everybody.
    for name in env.possible_agents[1:]:
        assert infos[name]["separation_m"] == pytest.approx(6.0, abs=0.01)
    assert infos["vehicle-1"]["separation_m"] == pytest.approx(side_m, abs=0.05)


def test_who_is_out_is_seen_as_zeros_and_the_others_go_on() -> None:
    env = CrossingEnv(3, overrides=PERFECT, radius_m=6.0)
    seen, _ = env.reset(seed=1)
    orders = dict.fromkeys(env.agents, STILL) | {"vehicle-2": np.array([0.0, 0.0, -1.0])}
    outs = dict.fromkeys(env.agents, False)
    while not outs["vehicle-2"]:
        seen, _, outs, overs, infos = env.step(orders)
    assert outs == {"vehicle-1": False, "vehicle-2": True, "vehicle-3": False}
    assert not any(overs.values())
    assert set(seen) == set(infos) == set(outs)
    assert env.agents == ["vehicle-1", "vehicle-3"]
    del orders["vehicle-2"]
    seen, rewards, outs, _, infos = env.step(orders)
    assert set(seen) == set(rewards) == set(outs) == set(infos) == set(env.agents)
    one, three = (seen[name].reshape(3, 6) for name in env.agents)
    assert np.linalg.norm(one[1, :3]) == pytest.approx(6.0 * 3.0**0.5, abs=0.05)
    assert (one[1] == -three[1]).all()
    assert not one[2].any()
    assert not three[2].any()


def test_a_seed_repeats_and_none_goes_on() -> None:
    def goals(env: CrossingEnv, seed: int | None) -> list[float]:
        return np.array(env.reset(seed)[0]["vehicle-1"][:2]).tolist()

    env = CrossingEnv()
    first, second, third = goals(env, None), goals(env, 3), goals(env, None)
    assert len({tuple(each) for each in (first, second, third)}) == 3
    assert goals(env, 3) == second
    assert goals(env, None) == third


def test_defaults_and_spaces() -> None:
    env = CrossingEnv()
    assert env.possible_agents == ["vehicle-1", "vehicle-2"]
    assert env.max_cycles == 200
    assert env.agents == []
    for name in env.possible_agents:
        act, see = env.action_space(name), env.observation_space(name)
        assert (act.low.tolist(), act.high.tolist()) == ([-1.0] * 3, [1.0] * 3)
        assert see.high.tolist() == [1000.0, 1000.0, 1000.0, 50.0, 50.0, 50.0] * 2
        assert see.low.tolist() == [-each for each in see.high.tolist()]
    assert env.reset(seed=1)[1]["vehicle-1"]["separation_m"] == pytest.approx(40.0, abs=0.1)
    near = CrossingEnv(radius_m=2.4, overrides=PERFECT)
    near.reset(seed=1)
    # 4.8 m apart, where less than 5 m costs.
    rewards = near.step(dict.fromkeys(near.agents, STILL))[1]
    assert rewards == {name: pytest.approx(-0.2, abs=0.01) for name in near.agents}


@pytest.mark.parametrize(
    ("name", "most"), [("radius_m", 300), ("separation_m", 100), ("max_cycles", 10**6)]
)
def test_the_most_that_is_allowed(name: str, most: int) -> None:
    given: dict[str, Any] = {name: most}
    CrossingEnv(**given)
    given = {name: most * 1.000001}
    with pytest.raises(aerofed.InputError, match=f"{name} = .*: must be more than 0, at most"):
        CrossingEnv(**given)


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
