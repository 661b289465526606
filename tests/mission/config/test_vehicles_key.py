"""The key `vehicles`: a count, or a table for each aircraft over what all have."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from mission.base.errors import InputError
from mission.config.loading import load_config
from mission.config.models import RunConfig


def config(vehicles: Any, **given: Any) -> RunConfig:
    keys = {key.replace("__", "."): value for key, value in given.items()}
    return load_config(Path("quickstart"), {"vehicles": vehicles, **keys})


def test_a_number_of_vehicles_stand_side_by_side_and_are_alike() -> None:
    found = config(3, vehicle__system_id=7)
    assert [one.name for one in found.aircraft] == ["uav1", "uav2", "uav3"]
    assert [one.home_m for one in found.aircraft] == [(400, 400), (405, 400), (410, 400)]
    assert [one.vehicle.system_id for one in found.aircraft] == [7, 8, 9]
    alike = [one.vehicle.model_copy(update={"system_id": 7}) for one in found.aircraft]
    assert alike == [found.vehicle] * 3


def test_a_table_has_its_own_over_what_all_have() -> None:
    gusts = {"speed_mps": 4.0}
    found = config(
        [
            {"name": "north", "home_m": [100, 700], "altitude_m": 50, "path_budget_m": 400},
            {"aircraft": {"limits": {"speed_mps": 12.0}}, "altitude_m": [40, 90]},
        ],
        vehicle__aircraft__wind=gusts,
        vehicle__sample_rate_hz=5,
    )
    north, second = found.aircraft
    assert (north.name, north.home_m, second.name) == ("north", (100, 700), "uav2")
    assert north.vehicle.sample_rate_hz == second.vehicle.sample_rate_hz == 5
    assert second.vehicle.aircraft.wind.speed_mps == 4.0
    assert second.vehicle.aircraft.limits.speed_mps == 12.0
    assert north.vehicle.aircraft.limits == found.vehicle.aircraft.limits
    assert found.of(north).mission.path_budget_m == 400
    assert found.of(second).mission.path_budget_m == found.mission.path_budget_m
    assert found.of(second).mission.altitudes_m == (40, 90)
    assert found.heights_m == (40, 90)


def test_numbers_and_homes_go_as_far_as_they_may() -> None:
    found = config(
        [{"system_id": 40}, {}, {"system_id": 250, "home_m": [800, 0]}, {"home_m": [799, 0]}],
        vehicle__system_id=7,
    )
    assert [one.vehicle.system_id for one in found.aircraft] == [40, 8, 250, 10]
    assert [one.home_m for one in found.aircraft] == [(400, 400), (405, 400), (800, 0), (799, 0)]
    assert [one.altitude_m for one in found.aircraft] == [None] * 4
    assert [one.vehicle.system_id for one in config(2, vehicle__system_id=249).aircraft][1] == 250
    with pytest.raises(InputError, match=r"vehicles: uav2 has system_id 251: 250 at most"):
        config(2, vehicle__system_id=250)
    outside = config([{}, {"home_m": [0, 0]}], area__home_m=[-400.0, 9.0])
    assert outside.aircraft[0].home_m == (-400, 9)
    with pytest.raises(InputError, match=r"uav2 has home_m = \[-395.0, 9.0\], outside the area"):
        config(2, area__home_m=[-400.0, 9.0])


def test_what_is_of_an_autopilot_is_shared_by_those_that_have_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("AEROFED_ARDUCOPTER", "/built/arducopter")
    px4 = {"path": "/built/px4", "parameters": {"MPC_XY_ERR_MAX": 5.0}}
    found = config(
        [{}, {"firmware": {"arguments": ["-x"]}}, {"autopilot": "ardupilot"},
         {"autopilot": "built-in", "parameters": {"MPC_XY_VEL_MAX": 9.0}}],
        vehicle__autopilot="px4", vehicle__firmware=px4,
    )  # fmt: skip
    one, two, three, ours = (each.vehicle for each in found.aircraft)
    assert [v.autopilot for v in (one, two, three, ours)] == [
        "px4", "px4", "ardupilot", "built-in",
    ]  # fmt: skip
    assert str(one.firmware.path) == str(two.firmware.path) == "/built/px4"
    assert (one.firmware.arguments, two.firmware.arguments) == ((), ("-x",))
    assert two.firmware.parameters == {"MPC_XY_ERR_MAX": 5.0}
    assert str(three.firmware.path) == "/built/arducopter"
    assert three.firmware.parameters == {}
    assert ours.firmware.path is None
    assert [v.system_id for v in (one, two, three, ours)] == [1, 2, 3, 4]


def test_the_resolved_configuration_reads_back_equal() -> None:
    for vehicles in (2, [{"name": "a"}, {"name": "b", "parameters": {"MPC_XY_VEL_MAX": 9.0}}]):
        found = config(vehicles)
        assert load_config(Path("quickstart"), tomllib.loads(found.to_toml())) == found


def test_without_the_key_there_is_one() -> None:
    (only,) = load_config(Path("quickstart")).aircraft
    assert (only.name, only.home_m) == ("uav1", (400, 400))


@pytest.mark.parametrize(
    ("vehicles", "said"),
    [
        (0, "vehicles = 0: must be greater than or equal to 1, or a list"),
        ("three", "vehicles = 'three': must be a whole number, or a list"),
        ([], "vehicles = []: must be a whole number, or have at least 1 item, not 0"),
        ([{"name": "a"}, {"name": "a"}], "2 have the name 'a': names must differ"),
        ([{"name": "uav2"}, {}], "2 have the name 'uav2'"),
        ([{"name": "a/b"}], "vehicles.0.name = 'a/b'"),
        (
            [{"home_m": [10, 10]}, {"home_m": [10.5, 10]}],
            "uav1 and uav2 stand 0.5 m apart, at home_m = [10.0, 10.0] and [10.5, 10.0]: 1 m",
        ),
        ([{}, {"home_m": [-3, 10]}], "uav2 has home_m = [-3.0, 10.0], outside the area"),
        ([{"nam": "a"}], "vehicles.0.nam: unknown key; did you mean name?"),
        ([{}, {"altitude": 50}], "vehicles.1.altitude: unknown key; did you mean altitude_m?"),
        ([{}, {"link": {}}], "vehicles.1.link: unknown key; link belongs to the top level"),
        ([{"system_id": 2}, {}], "vehicles: uav1 and uav2 have the system_id 2: they must differ"),
        ([{"altitude_m": [60, 50]}], "vehicles.0.altitude_m = [60, 50]: the lowest altitude"),
        (
            [{}, {"autopilot": "px4", "firmware": {"path": "px4"}, "traffic": "adsb"}],
            "uav2 has traffic = 'adsb' and autopilot = 'px4', a firmware, which cannot be told",
        ),
        (
            [{}, {"autopilot": "ardupilot", "firmware": {"path": "x"}, "parameters": {"A": 1}}],
            "parameters and parameter_file are the built-in autopilot's",
        ),
        ([{"parameter_file": "v.parm"}, {}], "uav1 has a parameter_file, of one aircraft whose"),
        ([{}, {"home_m": [800.5, 10]}], "uav2 has home_m = [800.5, 10.0], outside the area"),
        ([{}, {"home_m": [10, 800.5]}], "which is area.size_m = [800.0, 800.0]"),
        ([{"home_m": [10, 10]}, {}, {"home_m": [10, 10.99]}], "uav1 and uav3 stand 0.99 m apart"),
        ([{"aircraft": {"wind": {"speed_mps": 3}}}, {}], "the wind is of the place"),
    ],
)
def test_what_is_wrong_is_one_line(vehicles: Any, said: str) -> None:
    with pytest.raises(InputError) as wrong:
        config(vehicles)
    text = str(wrong.value)
    assert said in text
    assert "\n" not in text
    assert text.startswith("command line: vehicles")


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("mission.strategy", "barycenter", "cov, no_cov, ideal, or one of your own"),
        ("mission.strategy", "rectangular", "several need cov, no_cov"),
        ("link.kind", "udp", "'in_process'"),
        ("link.kind", "external", "which flies our own autopilot, and PX4 and ArduPilot"),
        ("link.gcs", ["udpout://127.0.0.1:14550"], "leave it out"),
    ],
)
def test_what_one_aircraft_alone_can_do_is_refused(key: str, value: Any, said: str) -> None:
    with pytest.raises(InputError) as wrong:
        load_config(Path("quickstart"), {"vehicles": 2, key: value})
    text = str(wrong.value)
    assert key in text
    assert said in text
    assert "\n" not in text
    assert load_config(Path("quickstart"), {"vehicles": 1, key: value}).aircraft


def test_what_is_wrong_for_all_is_told_once() -> None:
    with pytest.raises(InputError) as wrong:
        config([{}, {}], vehicle__aircraft__wind__speed_mps=99)
    assert "\n" not in str(wrong.value)
    assert "vehicle.aircraft.wind.speed_mps = 99" in str(wrong.value)


def test_a_home_where_nobody_may_climb_is_named() -> None:
    from mission.scenario.scenario import build_scenario

    corners = [[500, 500], [600, 500], [600, 600], [500, 600]]
    found = config(
        [{}, {"name": "east", "home_m": [550, 550]}],
        area__no_fly=[{"name": "school", "polygon_m": corners}],
    )
    with pytest.raises(InputError, match=r"the home of east, home_m = \[550.0, 550.0\], .*school"):
        build_scenario(found, data_dir=None)
