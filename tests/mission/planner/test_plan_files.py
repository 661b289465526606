"""Problem files, plan files, pictures and the link budget."""

import json
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from fl.radio.channel import CHANNEL_PRESETS, average_per, served_radius_m
from flightdyn.config import LimitsConfig
from mission.base.errors import InputError, PlanInputError
from mission.base.explain import tables
from mission.commands.planning import PlanningTask, plan_problems
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.files import NamedProblem, ProblemEntry, read_problems
from mission.planner.limits import RoundLimits
from mission.planner.performance import Performance
from mission.scenario.strategies import Optimised

CHANNEL = {
    key: getattr(CHANNEL_PRESETS["suburban"], key)
    for key in CHANNEL_PRESETS["suburban"].__dataclass_fields__
}
GOOD: dict[str, Any] = {
    "id": "a",
    "devices": [[100.0, 0.0], [300, 200], [500.0, 700]],
    "importance": [1.0, 0, 2.5],
    "start": [0, 0],
    "steps": 4,
    "per_step": 2,
    "path_budget_m": 500,
    "channel": CHANNEL,
}
# The same with all that a round may have.
LIMITED: dict[str, Any] = {
    **GOOD,
    "altitudes_m": [40, 120],
    "areas": [[[150, 50], [200, 50], [200, 300], [150, 300]]],
    "fence": [[-200, -200], [900, -200], [900, 900], [-200, 900]],
    "fences": [{"center_m": [350, 350], "radius_m": 770, "group": 0}],
    "margin_m": 10,
    "deadline_s": 60,
    "energy_j": 15000,
    "upload_s": [1.5, 0, 3],
    "ready_in_s": [0, 5, 25],
    "flight": {
        "speed_mps": 18, "acceptance_radius_m": 4, "wind_mps": [3, -1], "air_density": 0.95,
        "guidance": {"acceleration_mps2": 4, "speed_mps": 16},
    },
}  # fmt: skip


def write(tmp_path, content):
    path = tmp_path / "problems.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_file_is_read_as_it_stands(tmp_path):
    first, second = read_problems(write(tmp_path, [GOOD, {**GOOD, "id": 7}]))
    assert (first.id, second.id) == ("a", "7")
    assert first.problem.devices_m.tolist() == GOOD["devices"]
    assert first.problem.channel == CHANNEL_PRESETS["suburban"]
    assert (first.problem.steps, first.problem.per_step) == (4, 2)
    assert not first.problem.devices_m.flags.writeable


def test_all_that_a_round_may_have_is_read_and_kept_to(tmp_path):
    (entry,) = read_problems(write(tmp_path, [LIMITED]))
    given, limits = entry.problem, entry.problem.limits
    assert limits == RoundLimits(
        Performance(
            18.0, 4.0, LimitsConfig(acceleration_mps2=4, speed_mps=16), 0.95, (3.0, -1.0)
        ),
        60.0, 15000.0,
    )  # fmt: skip
    np.testing.assert_array_equal(given.upload_s, [1.5, 0.0, 3.0])
    np.testing.assert_array_equal(given.ready_in_s, [0.0, 5.0, 25.0])
    assert given.altitudes_m == (40.0, 120.0)
    assert given.airspace.margin_m == 10.0
    inside = np.array([[175.0, 100], [160, 310], [-250, 0], [500, 500], [-195, -195]])
    assert given.airspace.allows(inside).tolist() == [False, True, False, True, False]
    other = {**LIMITED, "fences": [{**LIMITED["fences"][0], "group": 1}]}
    (either,) = read_problems(write(tmp_path, [other]))
    inside = np.array([[-195.0, -195], [-250, 350], [-410, 350], [-500, 350]])
    assert either.problem.airspace.allows(inside).tolist() == [True, True, True, False]
    _, failure = plan_problems(task("certified", [entry]), out=tmp_path / "plans.json")
    (made,) = json.loads((tmp_path / "plans.json").read_text()).values()
    assert made["value"] > 0.0
    assert made["duration_s"] <= 60.0
    assert made["energy_j"] <= 15000.0
    assert failure is None, "the plan is checked against all of it"


def test_what_a_problem_leaves_out_limits_nothing(tmp_path):
    (entry,) = read_problems(write(tmp_path, [GOOD]))
    assert entry.problem.limits is entry.problem.upload_s is entry.problem.ready_in_s is None
    assert entry.problem.airspace.is_open
    (late,) = read_problems(write(tmp_path, [{**GOOD, "ready_in_s": [1, 2, 3]}]))
    assert late.problem.limits == RoundLimits(Performance(20.0, 5.0, LimitsConfig()))
    (unflown,) = read_problems(
        write(tmp_path, [{**GOOD, "deadline_s": 30, "flight": {"guidance": None}}])
    )
    assert unflown.problem.limits == RoundLimits(Performance(20.0, 5.0, None), 30.0)


def test_no_devices_and_no_problems_are_fine(tmp_path):
    assert read_problems(write(tmp_path, [])) == ()
    (empty,) = read_problems(write(tmp_path, [{**GOOD, "devices": [], "importance": []}]))
    assert empty.problem.devices_m.shape == (0, 2)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "not valid JSON"),
        ("{}", "holds {}: must be a list of problems"),
        ("[17]", "[0] = 17: must be an object"),
        ("[null]", "[0] = null: must be an object"),
        ([{**GOOD, "steps": 0}], "steps = 0: must be greater than or equal to 1"),
        ([{**GOOD, "steps": 2.5}], "steps = 2.5: must be a whole number"),
        ([{**GOOD, "steps": True}], "steps = true: must be a whole number"),
        ([{**GOOD, "steps": None}], "steps = null: must be a whole number"),
        ([{**GOOD, "per_step": "3"}], "per_step = '3': must be a whole number"),
        (
            [{**GOOD, "start": ["0", 0]}],
            "start.0 = '0': must be a number",
        ),
        ([{**GOOD, "deadline_s": "40"}], "deadline_s = '40': must be a number"),
        ([{**GOOD, "energy_j": True}], "energy_j = true: must be a number"),
        ([{**GOOD, "energy_j": 0}], "energy_j = 0: must be greater than 0"),
        ([{**GOOD, "start": [1]}], "start.1: missing"),
        ([{**GOOD, "start": 3}], "start = 3: must be a list"),
        (
            [{**GOOD, "path_budget_m": -1}],
            "path_budget_m = -1: must be greater than or equal to 0",
        ),
        ([{**GOOD, "importance": [1, -2, 1]}], "importance.1 = -2: must be greater than or"),
        ([{**GOOD, "importance": [1, 2]}], "importance has 2 values for 3 devices: must be one"),
        (
            [{**GOOD, "devices": [[1, 2, 3]]}],
            "devices.0 = [1, 2, 3]: must have at most 2 items",
        ),
        ([{**GOOD, "devices": 5}], "devices = 5: must be a list"),
        (
            [{**GOOD, "stepz": 3}],
            "stepz: unknown key; did you mean steps? (known: altitudes_m, ar",
        ),
        (
            [{**GOOD, "a2": 3}],
            "a2: unknown key; did you mean channel.a2?",
        ),
        (
            [{k: v for k, v in GOOD.items() if k != "start"}],
            "give either start, or vehicles with the start of each",
        ),
        (
            [{k: v for k, v in GOOD.items() if k != "channel"}],
            "channel: missing, and it has no default",
        ),
        ([{**GOOD, "channel": 3}], "channel = 3: must be an object"),
        (
            [{**GOOD, "channel": {**CHANNEL, "sigma_los": 0}}],
            "channel.sigma_los = 0: must be greater than 0",
        ),
        (
            [{**GOOD, "channel": {**CHANNEL, "gain": 0}}],
            "channel.gain: unknown key (known: a1_per_rad",
        ),
        ([{**GOOD, "upload_s": [1]}], "upload_s has 1 values for 3 devices: must be one each"),
        ([{**GOOD, "deadline_s": 0}], "deadline_s = 0: must be greater than 0"),
        (
            [{**GOOD, "areas": [[[0, 0], [9, 9], [9, 0], [0, 9]]]}],
            "[9, 0], [0, 9]]]: outline 0 crosses itself: its edges 0-1 and 2-3 meet",
        ),
        (
            [{**GOOD, "fence": [[0, 0], [9, 9], [9, 9]]}],
            "fence = [[0, 0], [9, 9], [9, 9]]: outline 0 has no area: its corners lie on one line",
        ),
        (
            [{**LIMITED, "fences": [{"center_m": [5000, 0], "radius_m": 9}]}],
            "the areas of no group have a place in common",
        ),
        ([{**GOOD, "flight": {"guidance": {"tilt": 3}}}], "flight.guidance.tilt: unknown key"),
        ([GOOD, GOOD], "[1].id = 'a': already used by [0]"),
        ([{**GOOD, "id": ""}], "id = '': must have at least 1 character, or be a whole number"),
        ([{**GOOD, "id": True}], "id = true: must be a string, or a whole number"),
        (json.dumps([GOOD]).replace("[500.0, 700", "[NaN, 700"), "devices.2.0 = nan: must be a"),
        (
            json.dumps([GOOD]).replace("2.5", "Infinity"),
            "importance.2 = inf: must be a finite number",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path, content, message):
    path = write(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_problems(path)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert message in said
    assert "\n" not in said


@pytest.mark.parametrize(
    ("key", "least", "most"),
    [
        ("start.0", -1e7, 1e7),
        ("devices.0.1", -1e7, 1e7),
        ("path_budget_m", 0, 1e6),
        ("altitudes_m.0", 10, None),
        ("altitudes_m.1", None, 500),
        ("margin_m", 0.1, 500),
        ("deadline_s", None, 1e9),
        ("energy_j", None, 1e9),
        ("upload_s.1", 0, 1e6),
        ("ready_in_s.1", 0, 1e6),
        ("steps", 1, 1000),
        ("per_step", 1, 1_000_000),
        ("separation_m", 0, 1e6),
        ("flight.speed_mps", 1, 30),
        ("flight.acceptance_radius_m", 0.5, 50),
        ("flight.wind_mps.0", -50, 50),
        ("flight.wind_mps.1", -50, 50),
        ("flight.air_density", 0.3, 1.5),
    ],
)
def test_numbers_are_taken_to_their_ends_and_no_further(tmp_path, key, least, most):
    def file(value):
        entry = json.loads(json.dumps({"separation_m": 0, **LIMITED}))
        *parts, last = (int(part) if part.isdigit() else part for part in key.split("."))
        table = entry
        for part in parts:
            table = table[part]
        table[last] = value
        return write(tmp_path, [entry])

    for value, beyond in ((least, -1), (most, 1)):
        if value is None:  # 0, or the other altitude, which is refused in other words
            continue
        read_problems(file(value))
        step = 1 if isinstance(value, int) else 2e-3 * abs(value)
        with pytest.raises(PlanInputError, match=re.escape(f"{key} = ")):
            read_problems(file(value + beyond * step))
    for no_number in (str(most or least), True):
        with pytest.raises(PlanInputError, match=re.escape(f"{key} = ")):
            read_problems(file(no_number))
    if key in ("deadline_s", "energy_j"):
        with pytest.raises(PlanInputError, match=re.escape(f"{key} = 0")):
            read_problems(file(0))


@pytest.mark.parametrize("key", ["areas", "fence"])
def test_an_outline_has_five_hundred_corners_at_most(tmp_path, key):
    def file(corners):
        turns = 2.0 * np.pi * np.arange(corners) / corners
        ring = (2e3 * np.column_stack((np.cos(turns), np.sin(turns)))).tolist()
        return write(tmp_path, [{**GOOD, key: [ring] if key == "areas" else ring}])

    for corners in (3, 500):
        assert len(read_problems(file(corners))) == 1
    for corners in (2, 501):
        with pytest.raises(PlanInputError, match=key):
            read_problems(file(corners))


# A value of every type that JSON has, and numbers beyond all limits.
STRANGE: tuple[Any, ...] = (
    "?",
    "",
    True,
    None,
    -3,
    2.5,
    -1e300,
    1e300,
    [],
    [1],
    ["?"],
    [[]],
    [{}],
    {},
    {"q": 1},
)


@pytest.mark.parametrize(
    "key", [(*path, name) for path, kind in tables(ProblemEntry) for name in kind.model_fields]
)
def test_no_key_is_refused_in_the_words_of_a_library(tmp_path, monkeypatch, key):
    monkeypatch.setattr("mission.planner.files.MOST_SHOWN", 99)
    for value in STRANGE:
        entry = json.loads(json.dumps(LIMITED))
        if key[0] == "vehicles":
            entry["vehicles"] = [{"start": entry.pop("start"), "path_budget_m": 300}]
        table = entry
        for part in key[:-1]:
            table = table[part]
        table[key[-1]] = value
        path = write(tmp_path, [entry])
        try:
            read_problems(path)
        except PlanInputError as error:
            for line in str(error).splitlines():
                assert line.startswith(f"{path}: [0]"), line
                assert key[0] in line or key == ("start",)
                assert not re.search(r"nput|instance|tuple|constrained|configuration|table", line)


def test_many_wrong_entries_are_cut_short(tmp_path):
    path = write(tmp_path, [{**GOOD, "id": i, "steps": 0} for i in range(40)])
    with pytest.raises(PlanInputError, match="and 30 more"):
        read_problems(path)


def test_a_missing_file_and_one_that_is_no_text(tmp_path):
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_problems(tmp_path / "none.json")
    (tmp_path / "b.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8"):
        read_problems(tmp_path / "b.json")


def task(kind: Any, problems: Sequence[NamedProblem]) -> PlanningTask:
    planner = make_planner(PlannerConfig(kind=kind))
    return PlanningTask(problems, Optimised(planner, fairness=True), "")


@pytest.mark.parametrize("kind", ["certified", "sqp"])
def test_plans_are_written_with_their_pictures(tmp_path, kind):
    problems = write(tmp_path, [GOOD, {**GOOD, "id": "b/../c", "steps": 1}])
    out, figures = tmp_path / "plans.json", tmp_path / "figures"
    plan_problems(task(kind, read_problems(problems)), out=out, figure_dir=figures)
    plans = json.loads(out.read_text())
    assert list(plans) == ["a", "b/../c"]
    assert set(plans["a"]) == {
        "waypoints", "route", "schedule", "value", "upper_bound", "gap", "nodes", "time_s",
    }  # fmt: skip
    way, schedule = np.array(plans["a"]["waypoints"]), np.array(plans["a"]["schedule"])
    assert way.shape == (4, 2)
    assert schedule.shape == (4, 3)
    r = np.hypot(*(way[:, None] - np.array(GOOD["devices"])).transpose(2, 0, 1))
    value = (
        (1 - average_per(CHANNEL_PRESETS["suburban"], r)) * GOOD["importance"] * schedule
    ).sum()
    assert plans["a"]["value"] == pytest.approx(value)
    if kind == "certified":
        assert plans["a"]["gap"] == pytest.approx(1 - value / plans["a"]["upper_bound"])
    else:
        assert plans["a"]["gap"] is plans["a"]["upper_bound"] is None
    pictures = sorted(figures.iterdir())
    assert [p.name for p in pictures] == ["000-a.png", "001-b_.._c.png"]
    assert all(p.read_bytes().startswith(b"\x89PNG") for p in pictures)


def test_an_output_that_cannot_be_written(tmp_path):
    path = write(tmp_path, [GOOD])
    asked = task("sqp", read_problems(path))
    with pytest.raises(InputError, match="cannot write"):
        plan_problems(asked, out=tmp_path / "no" / "plans.json")
    with pytest.raises(InputError, match="cannot write the figure"):
        plan_problems(asked, figure_dir=path)


@pytest.mark.parametrize("preset", ["suburban+10dB", "suburban+30dB"])
def test_the_served_radius_is_where_half_gets_through(preset):
    radius = served_radius_m(CHANNEL_PRESETS[preset])
    assert average_per(CHANNEL_PRESETS[preset], radius) <= 0.5
    assert average_per(CHANNEL_PRESETS[preset], radius + 1.0) > 0.5


@pytest.mark.parametrize(
    ("given", "timed"),
    [
        ({}, False),
        ({"separation_m": 0}, False),
        ({"separation_m": 0.5}, True),
        ({"ready_in_s": [0, 0, 0]}, True),
        ({"deadline_s": 60}, True),
    ],
)
def test_rounds_have_times_where_anything_depends_on_them(tmp_path, given, timed):
    (named,) = read_problems(write(tmp_path, [{**GOOD, **given}]))
    (start,) = named.problem.starts
    assert (start.limits is not None) == timed
