"""`aerofed.vehicles`: several in one world."""

import math
from pathlib import Path
from typing import Any

import mavsdk.logging
import pytest
from crossings import HOME, crossing, independent, plan

import aerofed
from mission.log.reader import read_log


def test_a_crossing_is_flown_judged_and_repeats(tmp_path: Path) -> None:
    plans, found = crossing(tmp_path, apart_m=6.0), []
    with aerofed.vehicles(1) as fleet:
        fleet.fly([plans[0]])
    taken = mavsdk.logging._log_callback_ref
    for run in ("one", "two"):
        logs = tmp_path / run
        with aerofed.vehicles(2, wind_mps=4, logs=logs) as fleet:
            fleet.fly(plans, after_s={"vehicle-2": 3.0})
            (pair,) = fleet.separation().to_dict("records")
        files = [logs / f"vehicle-{i}" / "flight-0001.mcap" for i in (1, 2)]
        found.append((pair, [file.read_bytes() for file in files]))
        least_m, t_s = independent(files)
        assert pair["least_m"] == pytest.approx(least_m, abs=0.01)
        assert pair["t_s"] == pytest.approx(t_s, abs=0.1)
        assert math.hypot(pair["horizontal_m"], pair["vertical_m"]) == pytest.approx(
            pair["least_m"]
        )
    assert found[0] == found[1]
    # Where each pilot took MAVSDK's messages anew, what another's was calling was freed.
    assert mavsdk.logging._log_callback_ref is taken
    begun = [read_log(file).flown_events[0].t_ns for file in files]
    assert (begun[1] - begun[0]) * 1e-9 == pytest.approx(3.0, abs=0.05)


def test_who_is_hit_is_lost_and_the_third_flies_on(tmp_path: Path) -> None:
    third = plan(tmp_path / "c.plan", (10, -40, 15), home=(10, 0))
    head_on = [
        plan(tmp_path / "a.plan", (0, 60, 20), home=(0, 0)),
        plan(tmp_path / "b.plan", (0, 60, 20), home=(5, 0)),
    ]
    overrides = {"vehicle.aircraft.sensors.kind": "perfect"}
    burst = {"kind": "wind_burst", "after": "take-off", "duration_s": 3, "north_mps": 5}
    each = {"third": {"vehicle.aircraft.faults": [burst]}}
    names = "north", "south", "third"
    with aerofed.vehicles(names, overrides, each=each, logs=tmp_path / "l") as fleet:
        with pytest.raises(aerofed.AerofedError, match=r"north: .*lost.*south: .*lost") as failed:
            fleet.fly({"north": head_on[0], "south": head_on[1], "third": third})
        assert "third" not in str(failed.value)
        assert (tmp_path / "l" / "third" / "flight-0001.mcap").is_file()
        assert fleet["third"].height_m < 0.2
        assert not fleet["third"].armed
        least = fleet.separation().set_index(["one", "two"]).least_m
        assert least["north", "south"] < 0.76
        assert fleet.names == names
    for name in names:
        log = read_log(tmp_path / "l" / name / "flight-0001.mcap")
        felt = [event.text for event in log.events if event.kind == "fault"]
        assert felt == ["Fault begins: wind_burst", "Fault ends: wind_burst"] * (name == "third")


@pytest.mark.parametrize(
    ("traffic", "said"), [("adsb", "ADSB_VEHICLE"), ("utm", "UTM_GLOBAL_POSITION")]
)
def test_one_has_a_fault_and_hears_the_others(traffic: str, said: str) -> None:
    own = {"vehicle-2": {"vehicle.aircraft.faults": [{"kind": "gnss_off"}],
                         "vehicle.traffic": traffic, "area.home_m": [430, 400]}}  # fmt: skip
    with aerofed.vehicles(2, each=own) as fleet:
        first, second = fleet
        assert len(fleet) == 2
        assert fleet[1] is fleet["vehicle-2"] is second is fleet[-1]
        hears = second.mavlink()
        silent = first.mavlink()
        fleet.until(lambda all_: all_.t_s > 3.0)
        heard = hears.recv_match(type=said, blocking=True, timeout=5)
        assert traffic == "utm" or heard.ICAO_address == 0xF00001
        assert heard.lat * 1e-7 == pytest.approx(HOME.lat_deg, abs=1e-4)
        assert silent.recv_match(type=said, blocking=True, timeout=0.5) is None
        fixes = (hears.recv_match(type="GPS_RAW_INT", blocking=True).fix_type for _ in range(99))
        assert any(fix <= 1 for fix in fixes)  # the first are of before the fault
        assert silent.recv_match(type="GPS_RAW_INT", blocking=True).fix_type >= 3


def test_the_link_of_one_fails_and_comes_back() -> None:
    fault = {"kind": "link_off", "at_s": 6, "duration_s": 15}
    own = {"vehicle-1": {"vehicle.aircraft.faults": [fault]}}
    with aerofed.vehicles(2, {"vehicle.parameters.NAV_DLL_ACT": 3}, each=own) as fleet:
        clients = [vehicle.mavlink() for vehicle in fleet]

        def fly(until_s: float) -> list[str]:
            while fleet.t_s < until_s:
                for client in clients:
                    client.mav.heartbeat_send(6, 8, 0, 0, 0)
                fleet.step(1.0)
            return [vehicle.mode for vehicle in fleet]

        fly(3.0)
        for client in clients:
            arm = 400, 0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            client.mav.command_long_send(client.target_system, 1, *arm)
            up = 22, 0, 0.0, 0.0, 0.0, math.nan, math.nan, math.nan, HOME.alt_msl_m + 30.0
            client.mav.command_long_send(client.target_system, 1, *up)
        assert fly(15.0) == ["HOLD", "HOLD"]
        while clients[0].recv_msg() is not None:
            pass
        assert clients[0].recv_match(blocking=True, timeout=1.5) is None
        assert clients[1].recv_match(blocking=True, timeout=5.0) is not None
        assert fly(18.0)[0] == "LAND"
        fly(22.0)
        assert clients[0].recv_match(type="HEARTBEAT", blocking=True, timeout=5.0) is not None
        assert fleet[1].mode != "LAND"


@pytest.mark.parametrize(
    ("count", "options", "words"),
    [
        (("a", "b", "a"), {}, "name 'a' stands twice: give each vehicle one of its own"),
        (("a", "b/c"), {}, "name 'b/c': letters, digits"),
        ((), {}, "from 1 to 64"),
        (2, {"each": {"third": {}}}, "no vehicle 'third' of these: vehicle-1, vehicle-2"),
        (2, {"each": {"vehicle-2": 3}}, "each['vehicle-2'] = 3: must be a dictionary"),
        (
            2,
            {"each": {"vehicle-2": {"area.home_m": [400.3, 400]}}, "source": "quickstart"},
            "vehicle-1 and vehicle-2 stand 0.30 m apart: aircraft touch within 0.75 m; give them",
        ),
    ],
)
def test_fleets_that_are_refused(count: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(aerofed.InputError) as refused:
        aerofed.vehicles(count, **options)
    assert words in str(refused.value)


def test_orders_that_are_refused(tmp_path: Path) -> None:
    one, two = crossing(tmp_path)
    with aerofed.vehicles(2) as fleet:
        for plans, after, words in (
            ({"vehicle-3": one}, None, "'vehicle-3': no vehicle of these: vehicle-1, vehicle-2"),
            ({0: one, "vehicle-1": two}, None, "vehicle-1 is given two plans"),
            ({0: one}, {1: 5.0}, "after_s: vehicle-2 has no plan here"),
            ({0: one}, {0: -1.0}, "after_s of vehicle-1: -1.0: must be simulated seconds"),
            ({}, None, "no plan is given"),
        ):
            with pytest.raises(aerofed.InputError) as refused:
                fleet.fly(plans, after_s=after)  # type: ignore[arg-type]
            assert words in str(refused.value)
