"""What is told of a run before its first round."""

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fl.data.arrays import Samples
from fl.radio.place import PlacedRadio, RadioMap
from flightdyn.random import RandomStreams
from mission.base.errors import InputError
from mission.config.loading import builtin_config, load_config
from mission.config.models import RunConfig
from mission.flight.flyers.choice import set_up
from mission.planner.problem import RoundProblem
from mission.scenario.limits import Amount
from mission.scenario.radio_maps import read_map, write_map
from mission.scenario.radios import radio_of
from mission.scenario.scenario import Scenario, build_scenario
from mission.scenario.strategies import Sortie, StrategyContext
from native.errors import SettingError


def test_the_assignment_is_written_as_it_is() -> None:
    scenario = build_scenario(load_config(builtin_config("quickstart.toml"), {}), data_dir=None)
    table = list(csv.DictReader(scenario.devices_csv().splitlines()))
    owned = [
        (community, community.dataset.train.labels[share])
        for community in scenario.federation.communities
        for share in community.shares
    ]
    assert len({len(labels) for _, labels in owned}) > 1
    for row, (community, labels), place in zip(table, owned, scenario.devices_m, strict=True):
        pairs = (entry.split(":") for entry in row["labels"].split())
        written = {int(label): int(count) for label, count in pairs}
        assert written == {c: int((labels == c).sum()) for c in set(labels.tolist())}
        assert (row["community"], int(row["samples"])) == (community.name, len(labels))
        everybody = sum(len(share) for share in community.shares)
        np.testing.assert_allclose(float(row["p"]), len(labels) / everybody, rtol=1e-15)
        assert (float(row["x_m"]), float(row["y_m"])) == tuple(place)


def test_classes_without_an_owner_are_said() -> None:
    settings = {"communities.0.labels_per_device": 1, "communities.0.coverage": False}
    scenario = build_scenario(
        load_config(builtin_config("quickstart.toml"), settings), data_dir=None
    )
    community = scenario.federation.communities[0]
    orphans = sorted(set(range(10)) - set(np.flatnonzero(community.counts.any(axis=0)).tolist()))
    assert orphans
    notice = f"{community.name}: no device owns classes {', '.join(map(str, orphans))}, "
    (line,) = (line for line in scenario.notices() if line.startswith(notice))
    # 6 devices with a class each; the advice must not be refused when it is followed.
    assert "more devices or labels_per_device, communities.0.coverage = true" in line


def test_coverage_alone_is_advised_only_where_it_can_help() -> None:
    settings = {"communities.0.labels_per_device": 2, "communities.0.coverage": False}
    for seed in range(20):
        config = load_config(builtin_config("quickstart.toml"), settings | {"seed": seed})
        lines = build_scenario(config, data_dir=None).notices()
        if found := [line for line in lines if "no device owns class" in line]:
            break
    assert found[0].endswith("(communities.0.coverage = true gives all an owner)")
    load_config(builtin_config("quickstart.toml"), settings | {"communities.0.coverage": True})


def own_data(data_dir: Path | None) -> Samples:  # noqa: ARG001
    """A researcher's data set: there is no official one to compare it with."""
    images = np.random.default_rng(1).random((40, 8, 8))
    return Samples(images, np.arange(40) % 4, images, np.arange(40) % 4)


def test_own_data_are_not_measured_against_official_files() -> None:
    settings = {"communities.0.task": f"{__name__}:own_data", "communities.0.partition": "iid"}
    config = load_config(builtin_config("quickstart.toml"), settings)
    notices = build_scenario(config, data_dir=None).notices()
    assert not any("official" in line for line in notices)


def from_one(data_dir: Path | None) -> Samples:
    """Labels numbered from 1: nobody has a 0, and nobody asks for it."""
    found = own_data(data_dir)
    return Samples(found.x_train, found.y_train + 1, found.x_test, found.y_test + 1)


def test_a_class_of_which_there_is_no_sample_is_not_missed() -> None:
    settings = {"communities.0.task": f"{__name__}:from_one", "communities.0.partition": "iid"}
    config = load_config(builtin_config("quickstart.toml"), settings)
    assert not any("owns class" in line for line in build_scenario(config, data_dir=None).notices())


def test_a_run_takes_no_failsafe_that_goes_by_wall_time() -> None:
    settings = {"vehicle.parameters.NAV_DLL_ACT": 2}
    config = load_config(builtin_config("quickstart.toml"), settings)
    with pytest.raises(InputError, match=r"NAV_DLL_ACT = 2: this failsafe goes by wall time"):
        set_up(config, data_dir=None)


def test_a_channel_is_that_of_the_lowest_altitude() -> None:
    config = load_config(builtin_config("quickstart.toml"), {"mission.altitude_m": [40.0, 120.0]})
    assert build_scenario(config, data_dir=None).channel.altitude_m == 40.0


@pytest.mark.parametrize("name", ["height", "y", "x"])
def test_a_radio_map_s_places_must_ascend(tmp_path: Path, name: str) -> None:
    lines = {"height": [40.0, 60.0], "y": [2.0, 6.0], "x": [5.0, 15.0]}
    for values in ([9.0, 8.0], [9.0, 9.0]):
        height_m, y_m, x_m = map(np.array, (lines | {name: values}).values())
        made = RadioMap(np.full((1, 2, 2, 2), -60.0), height_m, y_m, x_m, np.zeros((1, 2)))
        write_map(tmp_path / "map.nc", made, {})
        with pytest.raises(InputError, match=f"map.nc: {name} must ascend$"):
            read_map(tmp_path / "map.nc")


def several(*vehicles: dict[str, Any], **more: Any) -> Scenario:
    """Two communities with a device each, the second of which sends four times as much."""
    communities = [
        {"name": name, "task": "digits", "devices": 1, "partition": "iid", **more.pop(name, {})}
        for name in "ab"
    ]
    given: dict[str, Any] = {
        "mission": {"steps": 4, "flight": "none", **more.pop("mission", {})},
        "communities": communities, **more,
    }  # fmt: skip
    if vehicles:
        given["vehicles"] = vehicles
    return build_scenario(RunConfig.model_validate(given), data_dir=None)


SENDS = {
    "a": {"upload_bits": 50_000}, "b": {"upload_bits": 200_000},
    "channel": {"upload_rate_bps": 1e6},
}  # fmt: skip


def test_an_aircraft_hovers_while_devices_send_or_are_heard() -> None:
    assert several().first_problem().upload_s is None
    sending, stopping = several(**SENDS), several(mission={"replan": "stop"})
    assert sending.first_problem().upload_s == pytest.approx([0.05, 0.2])
    assert stopping.first_problem().upload_s == pytest.approx([0.1, 0.1])
    both = several(mission={"replan": "stop"}, **SENDS)
    assert both.first_problem().upload_s == pytest.approx([0.1, 0.2])
    assert both.upload_s == pytest.approx([0.05, 0.2])
    assert [one.device_times for one in (sending, stopping)] == [True, False]
    rows = list(csv.DictReader(sending.devices_csv().splitlines()))
    assert [float(row["upload_s"]) for row in rows] == [0.05, 0.2]
    assert "upload_s" not in stopping.devices_csv()


def test_a_round_of_several_has_what_is_left_and_each_ones_own() -> None:
    scenario = several(
        {}, {"altitude_m": 80.0, "path_budget_m": 300.0}, {"altitude_m": [50.0, 90.0]},
        a={"compute_s": 12.0}, mission={"separation_m": 20.0},
    )  # fmt: skip
    assert scenario.channel.altitude_m == 50.0
    assert scenario.device_times
    first = scenario.first_problem()
    assert first.ready_in_s == pytest.approx([12.0, 0.0])
    assert [start.path_budget_m for start in first.starts] == [800.0, 300.0, 800.0]
    assert [start.altitude_m for start in first.starts] == [60.0, 80.0, None]
    assert [start.altitudes_m for start in first.starts] == [None, None, (50.0, 90.0)]
    assert [start.start_m.tolist() for start in first.starts] == [
        [400 + 5 * a, 400] for a in range(3)
    ]
    assert (first.separation_m, first.late_s, first.least_m) == (20.0, 0.0, None)
    work = scenario.work_before().round_begins(1, 0)
    flying, begins = scenario.fleet[0].performance, np.array([7.0, 9.0])

    def later(t_s: float, *which: bool, **left: float) -> RoundProblem:
        return scenario.problem(
            np.ones(2), [(begins, flying) if there else None for there in which],
            left=Amount(**{"metres": 500.0, **left}), work=work, t_ns=round(t_s * 1e9),
            leaving=False,
        )  # fmt: skip

    rest = later(4.5, True, False, True)
    assert rest.ready_in_s == pytest.approx([7.5, 0.0])
    assert [start.name for start in rest.starts] == ["uav1", "uav3"]
    assert [start.path_budget_m for start in rest.starts] == [500.0, 500.0]
    assert [start.limits and start.limits.duration_s for start in rest.starts] == [np.inf] * 2
    assert rest.least_m == 20.0
    alone = later(12.0, False, True, False)
    assert (alone.separation_m, alone.ready_in_s, alone.limits) == (0.0, None, None)
    assert (alone.path_budget_m, alone.channel.altitude_m) == (300.0, 80.0)
    limits = later(0.0, True, True, True, seconds=9.0).starts[1].limits
    assert limits is not None
    assert limits.duration_s == 9.0


class Approaching:
    """A strategy that begins elsewhere than above home."""

    fairness, approach_m = True, (120.0, 90.0)

    def __init__(self, context: StrategyContext) -> None:
        self.planner = context.planner

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:  # noqa: ARG002
        return Sortie(self.planner.plan(problem))


def test_where_a_strategy_begins_is_for_one_aircraft() -> None:
    own: dict[str, Any] = {"mission": {"strategy": f"{__name__}:Approaching"}}
    assert several(**own).first_problem().start_m.tolist() == [120.0, 90.0]
    assert several().first_problem().start_m.tolist() == [400.0, 400.0]
    with pytest.raises(InputError, match=r"Approaching'?: approach_m must be None with several"):
        several({}, {}, **own)


def test_no_owner_is_missed_where_labels_are_not_shared_out() -> None:
    task = f"{__name__}:four_of_five"
    given = {"task": task, "partition": "iid", "devices": 2}
    lines = several(a=given, b=given).notices()
    assert len(lines) == 2
    assert all(
        line.endswith("no device owns class 4, so accuracy cannot reach 1") for line in lines
    )


def four_of_five(data_dir: Path | None) -> Samples:  # noqa: ARG001
    """A class of which samples are asked for, but nobody has one."""
    images = np.random.default_rng(1).random((40, 8, 8))
    return Samples(images, np.arange(40) % 4, images, np.arange(40) % 5)


def test_what_a_user_should_know_is_told() -> None:
    flown = {"mission": {"flight": "flown", "separation_m": 20.0}}
    (line,) = several({}, {}, **flown).notices()
    assert line == (
        "mission.separation_m = 20: as flying adds errors, rounds are planned with 23 m, and for "
        "one aircraft up to 1 s later than another"
    )
    assert several({}, {}, mission={"separation_m": 20.0}).notices() == []
    assert several({}, **flown).notices() == []
    (line,) = several(channel={"preset": "literal"}).notices()
    assert line.startswith("the channel hardly reaches anybody; ")


LINE = np.arange(10.0, 200.0, 10.0)  # of places in an area of 200 m, to a cell from its edge
HOME = {"home_lat_deg": 60.0, "home_lon_deg": 8.0, "home_alt_msl_m": 100.0, "home_x_m": 20.0,
        "home_y_m": 30.0}  # fmt: skip
DEGREE_M = 111_195.0  # of latitude; of longitude at 60 degrees half of it


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({}, None),
        ({"devices": [[10.0, 0.0], [50.0, 61.0]]}, None),
        ({"devices": [[10.0, 0.0], [50.0, 61.1]]}, "has device 1 1 m from where it stands in the"),
        ({"devices": [[10.0, 0.0]]}, "is of 1 devices; the run has 2"),
        ({"home_lat_deg": 60.0 + 0.99 / DEGREE_M}, None),
        ({"home_lat_deg": 60.0 + 1.01 / DEGREE_M}, "is of another home: home_lat_deg = 60.00001;"),
        ({"home_lon_deg": 8.0 - 1.99 / DEGREE_M}, None),
        ({"home_lon_deg": 8.0 - 2.01 / DEGREE_M}, "is of another home: home_lon_deg = 7.999982; "),
        ({"home_alt_msl_m": 101.0}, None),
        ({"home_alt_msl_m": 98.9}, "is of another home: home_alt_msl_m = 98.9; the run has 100"),
        ({"home_y_m": 31.01}, "is of another home: home_y_m = 31.01; the run has 30"),
        ({"home_x_m": float("nan")}, "is of another home: home_x_m = nan; the run has 20"),
        ({"x": LINE + 0.1}, "covers x from 10.1 to 190.1 m; the area has 0 to 200"),
        ({"y": LINE - 0.1}, "covers y from 9.9 to 189.9 m; the area has 0 to 200"),
        ({"y": LINE[:1]}, "covers y from 10 to 10 m; the area has 0 to 200"),
        ({"height": np.array([65.0])}, None),
        ({"height": np.array([65.1])}, "is of 65.1 m above home; mission.altitude_m is not withi"),
        ({"height": np.array([50.0, 55.0])}, None),
        ({"height": np.array([50.0, 54.9])}, "is of 50, 54.9 m above home; mission.altitude_m is"),
    ],
)
def test_a_map_is_of_a_run_to_a_metre_and_a_cell(
    tmp_path: Path, changed: dict[str, Any], why: str | None
) -> None:
    lines = {"height": np.array([60.0]), "y": LINE, "x": LINE, **changed}
    devices_m = np.array(changed.get("devices", [[10.0, 0.0], [50.0, 60.0]]))
    height_m, y_m, x_m = (lines[name] for name in ("height", "y", "x"))
    gain_db = np.full((len(devices_m), len(height_m), len(y_m), len(x_m)), -60.0)
    home = {name: changed.get(name, value) for name, value in HOME.items()}
    write_map(tmp_path / "w.nc", RadioMap(gain_db, height_m, y_m, x_m, devices_m), home)
    config = RunConfig.model_validate({
        "area": {"size_m": (200.0, 200.0), "home_m": (20.0, 30.0), "home_lat_deg": 60.0,
                 "home_lon_deg": 8.0, "home_alt_msl_m": 100.0},
        "radio": {"truth": "map", "map_file": tmp_path / "w.nc"},
        "communities": [{"name": "a", "task": "digits", "devices": 2, "partition": "iid"}],
    })  # fmt: skip
    stand_m = np.array([[10.0, 0.0], [50.0, 60.0]])

    def radio() -> object:
        channel = config.channel.channel(altitude_m=60.0)
        return radio_of(config, channel, config.area.build(), stand_m, RandomStreams(1))

    if why is None:
        assert isinstance(radio(), PlacedRadio)
    else:
        with pytest.raises(SettingError, match=re.escape(why)) as wrong:
            radio()
        assert wrong.value.key == "radio.map_file"
