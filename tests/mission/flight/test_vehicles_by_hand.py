"""Vehicles that stand alone, that nobody flies, and that only say how they are, by hand."""

import asyncio
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from mavsdk.asyncio import System
from mavsdk.plugins.telemetry import StatusTextType

from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.errors import InputError
from mission.commands.options import load
from mission.config.area import AreaConfig
from mission.config.models import MissionConfig
from mission.flight.flyers.unflown import UnflownFlyer
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.pilot.watch import Watch
from mission.flight.serve.separation import in_words, pairs_of, separation_file
from mission.flight.serve.vehicle import area_of, link_url, make_vehicles, names_of
from mission.planner.flyable import Stop
from sitl.observer import VehicleSample

S = 1_000_000_000
HOME = GeodeticPoint(47.0, 8.0, 500.0)
AREA = Area.at((400.0, 300.0), (100.0, 50.0), HOME)


def test_vehicles_have_numbers_from_one_or_names() -> None:
    assert names_of(2) == ["vehicle-1", "vehicle-2"]
    assert names_of(1, instance=3) == ["vehicle-4"]
    assert names_of(["a", "B.2-_"]) == ["a", "B.2-_"]
    assert names_of(["a" * 40]) == ["a" * 40]
    assert len(names_of(64)) == 64
    assert names_of(2, each=["vehicle-2"]) == ["vehicle-1", "vehicle-2"]


@pytest.mark.parametrize(
    ("count", "each", "words"),
    [
        (0, (), "0 vehicles: from 1 to 64"), (65, (), "65 vehicles: from 1 to 64"),
        ([], (), "from 1 to 64"),
        (["a", "b", "a"], (), "'a' stands twice"), (["-a"], (), "name '-a'"),
        (["a" * 41], (), "40 at most"), ([""], (), "name ''"), (["a/b"], (), "name 'a/b'"),
        (2, ("vehicle-3",), "no vehicle 'vehicle-3' of these: vehicle-1, vehicle-2"),
    ],
)  # fmt: skip
def test_what_names_no_vehicle_is_said(count: Any, each: tuple[str, ...], words: str) -> None:
    with pytest.raises(InputError, match=words):
        names_of(count, each=each)


@pytest.mark.parametrize(
    ("text", "url"),
    [("14540", "udpout://127.0.0.1:14540"), ("65535", "udpout://127.0.0.1:65535"),
     ("tcpin://127.0.0.1:5760", "tcpin://127.0.0.1:5760"), ("65536", ""), ("0", ""), ("x", "")],
)  # fmt: skip
def test_a_link_is_a_port_or_a_url(text: str, url: str) -> None:
    if url:
        assert link_url(text) == url
    else:
        with pytest.raises(InputError, match=f"--udp {text}: neither a port from 1 to 65535"):
            link_url(text)


def served(**more: Any) -> list[Any]:
    return list(make_vehicles(load(None, ()), **{"udp": ("14540",), "logs": None, **more}))


def test_vehicles_are_numbered_alike_in_name_id_port_and_home() -> None:
    config = load(None, ())
    one, two, three = served(count=3, instance=1)
    ids = [each.vehicle._config.system_id for each in (one, two, three)]
    assert ids == [config.vehicle.system_id + n for n in (1, 2, 3)]
    assert [each.name for each in (one, two, three)] == ["vehicle-2", "vehicle-3", "vehicle-4"]
    assert [list(each.urls.items()) for each in (one, two)] == [
        [("udpout://127.0.0.1:14541", 14581)], [("udpout://127.0.0.1:14542", 14582)],
    ]  # fmt: skip
    x, y = config.area.home_m
    assert [each.area.home_m for each in (one, two)] == [(x + 5.0, y), (x + 10.0, y)]
    frame = config.area.build().frame
    at = [
        frame.to_ned(e.area.home.lat_deg, e.area.home.lon_deg, e.area.home.alt_msl_m)
        for e in (one, two)
    ]
    np.testing.assert_allclose(at, [[0.0, 5.0, 0.0], [0.0, 10.0, 0.0]], atol=1e-3)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"instance": -1}, "--instance -1: the first vehicle's number, from 0"),
        ({"instance": 250}, "vehicle-251 would have system id 251: they end at 250"),
        ({"count": 2, "instance": 249}, "vehicle-251 would have system id 251"),
        ({"udp": ("14540", "14540")}, "--udp 14540: vehicle-1 speaks there already"),
        ({"udp": ("udpout://1.2.3.4:65535",), "count": 2}, "vehicle-2 would be on port 65536"),
        ({"udp": ("tcpin://1.2.3.4:65526",), "count": 2}, "vehicle-2 would be on port 65536"),
        ({"udp": ("udpout://1.2.3.4:70000",)}, "neither a port from 1 to 65535"),
    ],
)
def test_vehicles_that_cannot_be_are_refused(more: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        served(**more)


def test_two_do_not_share_a_file_of_parameters(tmp_path: Path) -> None:
    (tmp_path / "p.params").write_text("")
    config = load(None, (f"vehicle.parameter_file={tmp_path / 'p.params'}",))
    assert len(make_vehicles(config, count=1, udp=("14540",), logs=None)) == 1
    with pytest.raises(InputError, match=r"--count 2: vehicle\.parameter_file cannot be shared"):
        make_vehicles(config, count=2, udp=("14540",), logs=None)


def test_the_last_vehicle_and_the_last_port_are_taken() -> None:
    (last,) = served(instance=249, udp=("tcpin://127.0.0.1:7000",))
    assert last.name == "vehicle-250"
    assert list(last.urls) == ["tcpin://127.0.0.1:9490"]
    _, two = served(count=2, udp=("udpout://1.2.3.4:65534", "1000"))
    assert list(two.urls.items()) == [
        ("udpout://1.2.3.4:65535", 0), ("udpout://127.0.0.1:1000", 0),
    ]  # fmt: skip


def test_a_home_of_its_own_is_a_place_of_the_common_ground() -> None:
    common = AreaConfig(home_lat_deg=47.0, home_lon_deg=8.0, home_alt_msl_m=500.0)
    x, y = common.home_m
    moved = common.model_copy(update={"home_m": (x + 7.0, y + 3.0)})
    assert area_of(common, common, 0).home_m == (x, y)
    assert area_of(common, common, 3).home_m == (x + 15.0, y)
    assert area_of(common, moved, 3).home_m == (x + 7.0, y + 3.0)
    update = {"home_lat_deg": 47.001, "home_lon_deg": 8.001, "home_alt_msl_m": 510.0}
    away = common.model_copy(update=update)
    found = area_of(common, away, 3)
    assert found.home == away.home
    assert found.home_m == pytest.approx((x + 76.06, y + 111.17), abs=0.05)
    assert found.site == area_of(common, common, 0).site


def world() -> Any:
    least = [
        SimpleNamespace(
            distance_m=5.0, horizontal_m=3.0, vertical_m=4.0, t_ns=2_500_000_000, pair=(0, 2),
            places_ned_m=np.array([[10.0, 20.0, -30.0], [14.0, 26.0, -38.0]]),
        ),
        SimpleNamespace(distance_m=math.nan),
    ]  # fmt: skip
    return SimpleNamespace(least=least, names=["a", "b", "c"], collisions=[(3_500_000_000, 1, 2)])


def test_the_least_distance_of_a_pair_has_its_time_and_place() -> None:
    (pair,) = pairs_of(world())
    assert pair == ("a", "c", 5.0, 3.0, 4.0, 2.5, 23.0, 12.0, 34.0)
    assert in_words(world()) == ["a and c: 5.00 m apart at 2.5 s (3.00 m level, 4.00 m upright)"]
    found = separation_file(world(), {"a": AREA})
    assert found["homes"] == {"a": [47.0, 8.0, 500.0]}
    assert found["collisions"] == [{"t_s": 3.5, "pair": ["b", "c"]}]
    assert found["pairs"] == [
        {"pair": ["a", "c"], "least_m": 5.0, "horizontal_m": 3.0, "vertical_m": 4.0, "t_s": 2.5,
         "x_m": 23.0, "y_m": 12.0, "height_m": 34.0},
    ]  # fmt: skip


class Seen:
    def __init__(self) -> None:
        self.samples: list[VehicleSample] = []

    def sampled(self, sample: VehicleSample) -> None:
        self.samples.append(sample)

    def happened(self, event: Any) -> None:
        raise AssertionError(event)


def test_what_is_not_flown_is_on_its_plan_at_the_planned_speed() -> None:
    seen = Seen()
    flyer = UnflownFlyer(AREA, MissionConfig(), [seen])
    stops = [((100.0, 50.0), 0.0), ((160.0, 130.0), 2.0), ((160.0, 180.0), 0.0)]
    plan = FlightPlan(
        tuple(Stop(np.array(xy), (n,), hold_s) for n, (xy, hold_s) in enumerate(stops)),
        60.0, 20.0, 5.0,
    )  # fmt: skip

    async def flown() -> Any:
        await flyer.take_off()
        assert flyer.here().true_ned_m.tolist() == [0.0, 0.0, -flyer.altitude_m]
        await flyer.climb(60.0)
        assert flyer.here().true_ned_m.tolist() == [0.0, 0.0, -60.0]
        return await flyer.fly(plan)

    flight = asyncio.run(flown())
    assert [p.t_ns for p in flight.passages] == [0, 5 * S, round(9.5 * S)]
    assert flight.t_ns.tolist() == [0, 5 * S, 7 * S, round(9.5 * S)]
    assert flyer.t_ns == round(9.5 * S)
    assert flyer.battery_remaining == flight.battery_remaining == 1.0
    assert flight.passages[1].true_ned_m.tolist() == [80.0, 60.0, -60.0]
    first, there, hovers, last = seen.samples
    assert first.truth.vel_ned_mps.tolist() == [0.0, 0.0, 0.0]
    assert there.truth.vel_ned_mps.tolist() == [16.0, 12.0, 0.0]
    assert hovers.truth.vel_ned_mps.tolist() == [0.0, 0.0, 0.0]
    assert last.truth.vel_ned_mps.tolist() == [20.0, 0.0, 0.0]
    assert there.truth.q_frd_to_ned.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert (there.mode, there.armed, there.battery.consumed_mah) == ("NOT FLOWN", False, 0.0)
    # 100 m away the globe lies 0.8 mm below the plane.
    assert there.truth.pos_ned_m[2] == pytest.approx(-60.0 + 100.0**2 / 2 / 6.37e6, abs=1e-5)
    assert flyer.wait_until(5 * S, flight) is flight
    waited = flyer.wait_until(12 * S, flight)
    assert waited.t_ns[-1] == 12 * S
    assert waited.passages == flight.passages

    async def away() -> None:
        await flyer.go_to(np.array([0.0, 0.0]))

    asyncio.run(away())
    assert flyer.here().true_ned_m.tolist() == [-50.0, -100.0, -60.0]


KINDS = {
    StatusTextType.DEBUG: 7, StatusTextType.INFO: 6, StatusTextType.NOTICE: 5,
    StatusTextType.WARNING: 4, StatusTextType.ERROR: 3, StatusTextType.CRITICAL: 2,
    StatusTextType.ALERT: 1, StatusTextType.EMERGENCY: 0,
}  # fmt: skip


@pytest.fixture
def watch(monkeypatch: pytest.MonkeyPatch) -> Watch:
    monkeypatch.setattr("mission.flight.pilot.watch.TelemetryAsync", lambda _: None)

    async def made() -> Watch:
        return Watch(cast("System", None))

    return asyncio.run(made())


@pytest.mark.parametrize(("kind", "severity"), KINDS.items())
def test_each_text_has_its_severity_and_warnings_are_kept(
    watch: Watch, kind: StatusTextType, severity: int
) -> None:
    heard: list[tuple[int, str]] = []
    watch.listeners.append(lambda severity, text: heard.append((severity, text)))

    async def told() -> None:
        for text in ("Crashed: here", "other"):
            watch._take_text(cast("Any", SimpleNamespace(type=kind, text=text)))

    asyncio.run(told())
    assert heard == [(severity, "Crashed: here"), (severity, "other")]
    warned = severity <= 4
    assert watch.first_warning == ("Crashed: here" if warned else "")
    assert watch.last_warning == ("other" if warned else "")
    assert watch.crash == ("Crashed: here" if severity <= 2 else "")
    watch.order_given()
    assert (watch.first_warning, watch.last_warning, watch.left_mission) == ("", "", None)


@pytest.mark.parametrize(("ago_s", "why"), [(4.99, "low"), (5.01, "")])
def test_a_warning_is_a_reason_for_five_seconds(watch: Watch, ago_s: float, why: str) -> None:
    watch.last_warning = "low"
    watch._warned_at = watch._changed_at - ago_s
    assert watch.why == why


def test_only_what_changes_is_a_sign_of_life(watch: Watch) -> None:
    async def told() -> None:
        def at(north: float, height: float) -> Any:
            return SimpleNamespace(
                latitude_deg=north, longitude_deg=8.0, relative_altitude_m=height
            )

        watch._changed_at = -100.0
        watch._take("armed", False)
        assert watch._changed_at == -100.0
        watch._take_position(at(47.0, 3.0))
        assert watch._changed_at > -100.0
        assert watch.alt_rel_m == 3.0
        watch._changed_at = -100.0
        watch._take_position(at(47.0, 3.0))
        assert watch._changed_at == -100.0
        assert watch.silence_s > 100.0
        watch.expect()
        assert watch.silence_s < 50.0
        watch._take_health(cast("Any", SimpleNamespace(is_armable=True)))
        assert watch.armable is True

    asyncio.run(told())


def test_a_plan_that_stands_has_one_stop_and_no_hover() -> None:
    stop = Stop(np.zeros(2), ())
    plan = FlightPlan((stop,), 60.0, 20.0, 5.0)
    assert plan.stands
    assert not plan.waits
    assert replace(plan, is_part=True).waits
    assert not FlightPlan((Stop(np.zeros(2), (), 1.0),), 60.0, 20.0, 5.0).stands
    assert not FlightPlan((stop, stop), 60.0, 20.0, 5.0, is_part=True).waits
    assert not FlightPlan((stop, stop), 60.0, 20.0, 5.0).stands
