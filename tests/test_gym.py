"""`aerofed.gym`: environments that learners know how to use, on the planner's own definitions."""

import copy
import pickle
import subprocess
import sys
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from one_aircraft import changed, round_problem
from patience import HANG_S

import aerofed
import aerofed.gym
from fl.radio.channel import CHANNEL_PRESETS
from flightdyn.config import LimitsConfig
from mission.base.airspace import Airspace
from mission.planner.check import check_plan
from mission.planner.flyable import foresee_round
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem

FLYING = Performance(20.0, 5.0, LimitsConfig())
WALL = np.array([[300.0, 100], [360, 100], [360, 700], [300, 700]])
KINDS: dict[str, dict[str, Any]] = {
    "metres": {},
    "time": {"limits": RoundLimits(FLYING, 60.0), "upload_s": np.linspace(0.5, 8.0, 8)},
    "energy": {"limits": RoundLimits(FLYING, energy_j=9000.0)},
    "areas": {"airspace": Airspace((WALL,), margin_m=5.0)},
    "readiness": {"limits": RoundLimits(FLYING, 60.0), "ready_in_s": np.linspace(0.0, 50.0, 8)},
}

PERFECT = {"vehicle.aircraft.sensors.kind": "perfect"}


def problem(kind: str = "metres", seed: int = 1) -> RoundProblem:
    rng = np.random.default_rng(seed)
    known = {
        "devices_m": rng.uniform(0, 800, (8, 2)),
        "importance": rng.uniform(0.2, 1.0, 8),
        "start_m": np.array([400.0, 400.0]),
        "steps": 6,
        "per_step": 2,
        "path_budget_m": 900.0,
        "channel": CHANNEL_PRESETS["suburban+10dB"],
    }
    return round_problem(**{**known, **KINDS[kind]})


def of_plan(env: Any, plan: RoundPlan) -> list[np.ndarray]:
    """The actions that carry out a plan."""
    places_m = np.vstack((plan.waypoints_m[1:], plan.waypoints_m[-1:]))
    places = (places_m - env.unwrapped._middle_m) / env.unwrapped._half_m
    return list(np.hstack((places, plan.schedule[0])))


def played(env: Any, actions: Any, seed: int) -> tuple[list[Any], float, float]:
    """Every observation of an episode, and what arrived and was expected to."""
    observation, _ = env.reset(seed=seed)
    seen, arrived, expected, over = [deepcopy(observation)], 0.0, 0.0, False
    actions = iter(actions)
    while not over:
        observation, reward, over, cut, info = env.step(next(actions))
        seen.append(deepcopy(observation))
        arrived, expected, over = (
            arrived + reward,
            expected + info.get("expected", 0.0),
            over or cut,
        )
    return seen, arrived, expected


def at_random(env: Any, seed: int) -> Any:
    env.action_space.seed(seed)
    while True:
        yield env.action_space.sample()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("aerofed/Setpoint-v0", {}),
        ("aerofed/Setpoint-v0", {"setpoint": "acceleration", "wind_mps": 6}),
        ("aerofed/Round-v0", {}),
        ("aerofed/Round-v0", {"problem": problem("time")}),
    ],
)
def test_they_are_what_gymnasium_calls_an_environment(name: str, options: dict[str, Any]) -> None:
    check_env(gymnasium.make(name, **options).unwrapped)


def test_the_same_seed_gives_the_same_round_and_another_one_another() -> None:
    env = gymnasium.make("aerofed/Round-v0")
    once, again, other = (played(env, at_random(env, 1), seed)[0] for seed in (5, 5, 6))
    assert str(once) == str(again)
    assert str(once[0]) != str(other[0])


def test_every_seed_has_a_world_of_its_own() -> None:
    """Of 2^31 worlds 300 are the same twice with a chance of 2 in 100 000."""
    env: Any = gymnasium.make("aerofed/Round-v0").unwrapped
    worlds = set()
    for seed in range(300):
        env.reset(seed=seed)
        worlds.add(env._problem.devices_m.tobytes())
    assert len(worlds) == 300


@pytest.mark.slow
def test_the_same_seed_gives_the_same_flight_and_another_one_another() -> None:
    env = gymnasium.make("aerofed/Setpoint-v0", max_episode_steps=30, wind_mps=5)
    once, again, other = (played(env, at_random(env, 1), seed)[0] for seed in (5, 5, 6))
    assert str(once) == str(again)
    assert str(once) != str(other)
    assert len(once) == 31


def test_a_round_starts_where_runs_do() -> None:
    env: Any = gymnasium.make("aerofed/Round-v0").unwrapped
    first = aerofed.first_problem()
    env.reset(seed=1)
    assert (env.problem.importance == first.importance).all()
    assert not (env.problem.devices_m == first.devices_m).any()
    size_m = 2.0 * env._half_m
    assert ((env.problem.devices_m >= 0.0) & (env.problem.devices_m <= size_m)).all()


def test_what_is_believed_by_place_is_of_the_devices_of_the_episode() -> None:
    env: Any = gymnasium.make(
        "aerofed/Round-v0", source="city", overrides={"radio.belief": "buildings"}
    ).unwrapped
    env.reset(seed=3)
    devices_m = env.problem.devices_m
    assert env.problem.per_grid is not None
    above_m = np.column_stack((devices_m, np.full(len(devices_m), 60.0)))
    assert (env.problem.radio.per(np.arange(len(devices_m)), above_m) < 0.5).mean() > 0.8


@pytest.mark.parametrize("kind", ["metres", "time", "energy"])
def test_a_plan_carried_out_stop_by_stop_is_worth_what_the_planner_says(kind: str) -> None:
    # What was decided so far has to fit, too, and may be flown with sharper corners than all of it:
    # so a plan that takes 3 % less than there is.
    to_plan = problem(kind)
    if kind == "energy":
        to_plan = changed(to_plan, limits=RoundLimits(FLYING, energy_j=0.97 * 9000.0))
    plan = aerofed.plan(to_plan, "sqp")
    env: Any = gymnasium.make("aerofed/Round-v0", problem=problem(kind))
    _, _, expected = played(env, of_plan(env, plan), seed=1)
    made = env.unwrapped.plan
    assert (made.schedule == plan.schedule).all()
    assert made.value == pytest.approx(expected)
    assert made.waypoints_m == pytest.approx(plan.waypoints_m, abs=1e-3)
    assert expected == pytest.approx(plan.value, rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_whatever_is_done_keeps_to_every_limit(kind: str) -> None:
    env: Any = gymnasium.make("aerofed/Round-v0", problem=problem(kind))
    short = 0
    for seed in range(20):
        seen, _, expected = played(env, at_random(env, seed), seed)
        check_plan(problem(kind), env.unwrapped.plan)
        assert expected == pytest.approx(env.unwrapped.plan.value, abs=0.05)
        short += seen[-1]["left"][0] < 1.0 and env.unwrapped.plan.path_m > 100.0
    assert short


def test_what_arrives_is_drawn_with_the_rates_of_the_radio() -> None:
    env: Any = gymnasium.make("aerofed/Round-v0", problem=problem())
    actions = of_plan(env, aerofed.plan(problem(), "sqp"))
    each = [played(env, actions, seed)[1:] for seed in range(300)]
    arrived, expected = np.array(each).T
    assert arrived.mean() == pytest.approx(expected[0], rel=0.02)
    assert arrived.std() > 0.05


def test_whoever_has_sent_sends_no_more_and_only_so_many_send_at_once() -> None:
    env: Any = gymnasium.make("aerofed/Round-v0", problem=problem())
    env.reset(seed=1)
    action = np.concatenate(([0.0, 0.0], [0.1, 0.9, -0.5, 0.8, 0.9, 0.2, 0.3, 0.4]))
    for asked in ([1, 4], [1, 3, 4, 7], [1, 3, 4, 5, 6, 7], [0, 1, 3, 4, 5, 6, 7]):
        observation, *_ = env.step(action)
        assert np.flatnonzero(observation["asked"]).tolist() == asked
    assert (observation["heard"] <= observation["asked"]).all()


def test_places_are_shares_of_the_half_of_the_longer_side_about_the_middle() -> None:
    """Of an area of 800 m by 400 m, by its devices; all that is sent arrives there."""
    devices_m = np.array([[0.0, 0.0], [800.0, 100.0], [200.0, 400.0], [400.0, 200.0]])
    sure = replace(CHANNEL_PRESETS["suburban"], tx_power_db=90.0)
    importance = np.array([0.5, 3.0, 0.25, 1.0])
    made = round_problem(devices_m, importance, np.array([400.0, 200.0]), 4, 2, 500.0, sure)
    env: Any = gymnasium.make("aerofed/Round-v0", problem=made).unwrapped
    assert env.observation_space["importance"].high.tolist() == [3.0] * 4
    seen, told = env.reset(seed=1)
    assert told == {}
    assert seen["position"].tolist() == [0.0, 0.0]
    assert seen["devices"].tolist() == [[-1.0, -0.5], [1.0, -0.25], [-0.5, 0.5], [0.0, 0.0]]
    assert seen["importance"].tolist() == importance.tolist()
    assert seen["left"].tolist() == [1.0] * 4
    rows = [
        # where to go, who is to send; who has then sent; where it is; metres that are left
        ((0.5, -0.25), (0.5, 0.5, 1.0, 0.0), [1, 0, 1, 0], (600.0, 100.0), 500 - 50_000**0.5),
        ((0.5, -0.25), (1.0, 0.0, 1.0, 0.0), [1, 0, 1, 0], (600.0, 100.0), 500 - 50_000**0.5),
        ((-1.0, -0.25), (-1.0, 0.1, -1.0, 1.0), [1, 1, 1, 1], (323.6068, 100.0), 0.0),
        ((1.0, 1.0), (1.0, 1.0, 1.0, 1.0), [1, 1, 1, 1], (323.6068, 100.0), 0.0),
    ]
    before = np.zeros(4)
    for step, (place, sends, asked, at_m, left_m) in enumerate(rows, start=1):
        seen, reward, over, cut, told = env.step(np.array([*place, *sends]))
        assert seen["asked"].tolist() == seen["heard"].tolist() == asked
        assert reward == told["expected"] == importance @ (np.array(asked) - before)
        assert seen["position"] == pytest.approx((np.array(at_m) - (400, 200)) / 400, abs=1e-6)
        assert seen["left"] == pytest.approx([1 - step / 4, left_m / 500, 1, 1], abs=1e-6)
        assert (over, cut) == (step == 4, False)
        before = np.array(asked)
    assert env.plan.value == pytest.approx(importance.sum())
    assert np.flatnonzero(env.plan.schedule.any(axis=2)).tolist() == [0, 2]


def test_of_time_and_energy_the_shares_are_left_that_a_plan_so_far_does_not_take() -> None:
    for kind in ("time", "energy"):
        env: Any = gymnasium.make("aerofed/Round-v0", problem=problem(kind)).unwrapped
        env.reset(seed=1)
        seen, *_ = env.step(np.array([0.5, 0.5, *[0.0] * 8]))
        foreseen = foresee_round(env.problem, env.plan)
        limits = KINDS[kind]["limits"]
        used = foreseen.duration_s / limits.duration_s, foreseen.energy_j / limits.energy_j
        assert 0.1 < max(used) < 1.0
        assert seen["left"][2:] == pytest.approx(1.0 - np.array(used), abs=1e-6)


def test_what_lies_on_a_line_or_a_point_has_a_unit_too() -> None:
    for devices_m, half_m in (
        ([[400.0, 400.0]], 1.0),
        ([[400.0, 400.5]], 1.0),
        ([[403, 400]], 1.5),
    ):
        made = changed(problem(), devices_m=np.array(devices_m, float), importance=np.ones(1))
        env: Any = gymnasium.make("aerofed/Round-v0", problem=made).unwrapped
        env.reset(seed=1)
        seen, *_ = env.step(np.array([1.0, 0.0, 0.0]))
        middle_m = (made.start_m + devices_m[0]) / 2.0
        assert env.plan.waypoints_m[1] - middle_m == pytest.approx([half_m, 0.0])
        assert seen["position"] == pytest.approx([1.0, 0.0])


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["sync", "async"])
def test_many_at_once_are_each_as_alone(mode: str) -> None:
    options = {"vector_kwargs": {"context": "spawn"}} if mode == "async" else {}
    many = gymnasium.make_vec("aerofed.gym:aerofed/Round-v0", 2, mode, **options)
    try:
        observations, _ = many.reset(seed=[3, 4])
        assert observations["devices"].shape == (2, 12, 2)
        *_, rewards, _, _, _ = many.step(np.ones((2, 14), dtype=np.float32))
        alone = gymnasium.make("aerofed/Round-v0")
        alone.reset(seed=4)
        assert rewards[1] == alone.step(np.ones(14, dtype=np.float32))[1]
    finally:
        many.close()


@pytest.mark.slow
@pytest.mark.parametrize(("setpoint", "share"), [("velocity", 0.2), ("acceleration", 0.3)])
def test_setpoints_go_where_they_say(setpoint: str, share: float) -> None:
    env = gymnasium.make("aerofed/Setpoint-v0", setpoint=setpoint)
    for axis, sign in ((0, 1.0), (1, -1.0), (2, 1.0)):
        _, began = env.reset(seed=1)
        action = np.zeros(3, dtype=np.float32)
        action[axis] = sign * share
        total = 0.0
        for _ in range(20):
            observation, reward, over, _, info = env.step(action)
            total += reward
        assert not over
        flown_m = began["offset_m"] - info["offset_m"]
        assert flown_m.round() @ action > 0.0
        assert np.abs(np.delete(flown_m, axis)).max() < 1.0
        assert info["velocity_mps"][axis] * sign > 0.5
        nearer_m = np.linalg.norm(began["offset_m"]) - np.linalg.norm(info["offset_m"])
        assert total == pytest.approx(nearer_m)
        # Belief is not the truth, and what is seen is belief.
        assert 0.0 < np.abs(observation[:3] - info["offset_m"]).max() < 3.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_places_are_drawn_around_the_hover(seed: int) -> None:
    """Any way, up to 40 m, 10 to 30 m high; the hover is at 20 m."""
    env = gymnasium.make("aerofed/Setpoint-v0", overrides=PERFECT)
    seen, told = env.reset(seed=seed)
    draw = np.random.Generator(np.random.PCG64(seed))
    way, far_m, height_m = draw.uniform(0, 2 * np.pi), 40 * draw.uniform(), draw.uniform(10, 30)
    offset_m = [far_m * np.cos(way), far_m * np.sin(way), height_m - 20.0]
    assert told["offset_m"] == pytest.approx(offset_m, abs=0.15)
    assert told["velocity_mps"] == pytest.approx(np.zeros(3), abs=0.1)
    assert seen == pytest.approx(np.concatenate((offset_m, np.zeros(3))), abs=0.15)
    near = gymnasium.make("aerofed/Setpoint-v0", overrides=PERFECT, far_m=5.0)
    assert near.reset(seed=seed)[1]["offset_m"][:2] * 8.0 == pytest.approx(offset_m[:2], abs=0.05)


@pytest.mark.parametrize(
    ("setpoint", "steps", "grown"), [("velocity", 80, 1.0), ("acceleration", 20, 2.0)]
)
def test_setpoints_are_shares_of_the_limits(setpoint: str, steps: int, grown: float) -> None:
    """Velocities are reached, accelerations held: `grown` s of 3, 3, 2 m/s2, 0.1 s a step."""
    limits = {"speed_mps": 10, "climb_mps": 2, "acceleration_mps2": 3}
    limits |= {"vertical_acceleration_mps2": 2}
    given = {f"vehicle.aircraft.limits.{name}": value for name, value in limits.items()}
    env = gymnasium.make("aerofed/Setpoint-v0", setpoint=setpoint, overrides=PERFECT | given)
    _, told = env.reset(seed=1)
    action, most = np.array([0.3, -0.2, 0.25]), ((10, 10, 2), (3, 3, 2))[setpoint != "velocity"]
    for _ in range(steps):
        before = told
        seen, reward, over, cut, told = env.step(action.astype(np.float32))
        moved_m = before["offset_m"] - told["offset_m"]
        assert moved_m == pytest.approx(
            0.05 * (before["velocity_mps"] + told["velocity_mps"]), abs=0.01
        )
        nearer_m = np.linalg.norm(before["offset_m"]) - np.linalg.norm(told["offset_m"])
        assert reward == pytest.approx(nearer_m, abs=1e-9)
        assert (over, cut) == (False, False)
        assert seen == pytest.approx(
            np.concatenate((told["offset_m"], told["velocity_mps"])), abs=0.05
        )
    assert told["velocity_mps"] == pytest.approx(action * most * grown, rel=0.25, abs=0.15)


def test_the_spaces_of_setpoints() -> None:
    env = gymnasium.make("aerofed/Setpoint-v0")
    act, see = env.action_space, env.observation_space
    assert (act.low.tolist(), act.high.tolist()) == ([-1.0] * 3, [1.0] * 3)
    assert see.high.tolist() == [1000.0, 1000.0, 1000.0, 50.0, 50.0, 50.0]
    assert see.low.tolist() == [-each for each in see.high.tolist()]
    assert see.dtype == np.float32
    gymnasium.make("aerofed/Setpoint-v0", far_m=500)
    with pytest.raises(aerofed.InputError, match=r"far_m = 500\.1: must be more than 0"):
        gymnasium.make("aerofed/Setpoint-v0", far_m=500.1)


@pytest.mark.slow
def test_rewards_may_be_of_ones_own_and_landing_is_the_end() -> None:
    env = gymnasium.make(
        "aerofed/Setpoint-v0", reward=lambda before, action, after: before[2] + action[2] - after[2]
    )
    env.reset(seed=1)
    down, over, steps = np.array([0.0, 0.0, -0.5], dtype=np.float32), False, 0
    while not over and steps < 190:
        _, reward, over, _, _ = env.step(down)
        assert -0.9 < reward < -0.4
        steps += 1
    assert over
    assert steps > 80


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("Setpoint", {"setpoint": "place"}, "setpoint = 'place': must be 'velocity' or"),
        ("Setpoint", {"far_m": 0.0}, "far_m = 0.0: must be more than 0, at most 500"),
        ("Setpoint", {"far_m": "10"}, "far_m = '10': must be more than 0, at most 500"),
        ("Setpoint", {"wind_mps": -1}, "vehicle.aircraft.wind.speed_mps = -1"),
        ("Round", {"overrides": {"mission.stepz": 3}}, "mission.stepz"),
        (
            "Round",
            {"overrides": {"mission.altitude_m": [40.0, 80.0]}},
            r"altitudes_m = \[40.0, 80.0\]: must be None here",
        ),
    ],
)
def test_options_that_are_refused(name: str, options: dict[str, Any], words: str) -> None:
    with pytest.raises(aerofed.InputError, match=words):
        gymnasium.make(f"aerofed/{name}-v0", **options)


@pytest.mark.parametrize("kind", ["Setpoint", "Round"])
def test_an_action_that_is_none_is_refused_in_one_line(kind: str) -> None:
    env: Any = gymnasium.make(f"aerofed/{kind}-v0").unwrapped
    (count,) = env.action_space.shape
    still, no_episode = np.zeros(count), r"^step: no episode is under way; call reset\(\) first$"
    with pytest.raises(aerofed.InputError, match=no_episode):
        env.step(still)
    env.reset(seed=1)
    allowed = rf": must be {count} numbers from -1 to 1, shape \({count},\)$"
    nan, far = still.copy(), still.copy()
    nan[0], far[1] = np.nan, np.inf
    masked = np.ma.masked_array(still, mask=np.arange(count) == 0)
    odd = (still + 0j, [0j] * count, ["0.5"] * count, still.astype(str), still.astype(object))
    typed = (masked, still.astype(bool), still.astype("m8[s]"), [None] * count, [10**400] * count)
    shaped = (0.0, still[1:], still[None], nan, far, still - 1.5, "up", None, [[0.0], [0, 1]])
    for action in (*shaped, *odd, *typed):
        with pytest.raises(aerofed.InputError, match="^action = .*" + allowed) as refused:
            env.step(action)
        assert "\n" not in str(refused.value)
    down = still.copy()
    down[-1], over = -1.0, False
    while not over:  # on the ground, or at the last stop
        over = env.step(down)[2]
    with pytest.raises(aerofed.InputError, match=no_episode):
        env.step(still)


def test_lists_and_whole_numbers_are_actions() -> None:
    rewards = set()
    for action in ([0] * 14, np.zeros(14, dtype=np.int64), np.zeros(14, dtype=np.float16)):
        env = gymnasium.make("aerofed/Round-v0").unwrapped
        env.reset(seed=1)
        rewards.add(env.step(action)[1])
    assert len(rewards) == 1


@pytest.mark.slow
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_an_environment_can_be_copied_and_a_flight_under_way_says_why_not(copied: Any) -> None:
    env = gymnasium.make("aerofed/Setpoint-v0", wind_mps=5, max_episode_steps=20)
    once, other = (played(each, at_random(env, 1), 5)[0] for each in (env, copied_fresh(copied)))
    assert str(once) == str(other)
    with pytest.raises(aerofed.InputError, match="Setpoint-v0: a flight under way cannot be"):
        copied(env)
    down, over = np.array([0.0, 0.0, -1.0], dtype=np.float32), False
    while not over:
        over = env.unwrapped.step(down)[2]
    assert str(played(copied(env), at_random(env, 1), 5)[0]) == str(once)


def copied_fresh(copied: Any) -> Any:
    return copied(gymnasium.make("aerofed/Setpoint-v0", wind_mps=5, max_episode_steps=20))


def test_without_gymnasium_the_import_says_what_to_install_and_nothing_else_needs_it() -> None:
    program = """
import sys
sys.modules["gymnasium"] = None
import aerofed
try:
    import aerofed.gym
except ImportError as error:
    print(error)
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=HANG_S, check=True
    )
    words = "aerofed.gym: Gymnasium is not installed: pip install 'aerofed[gym]'\n"
    assert ended.stdout == words


@pytest.mark.slow
def test_the_example_learns_and_is_put_beside_the_planner() -> None:
    example = Path(__file__).parents[1] / "examples" / "learned_round.py"
    command = [sys.executable, str(example), "2", "6", "2"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=True)
    assert ended.stdout.splitlines()[-1].startswith("30 other rounds: learned ")
