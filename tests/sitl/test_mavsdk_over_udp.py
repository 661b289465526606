"""Each MAVSDK plugin that a mission needs, over a real UDP link, with the real aircraft."""

import asyncio
import importlib.metadata
import math
from typing import Any

import numpy as np
import pytest
from mavsdk.asyncio import System
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.failure import FailureAsync
from mavsdk.asyncio.plugins.geofence import GeofenceAsync
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.mission import MissionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action import ActionError
from mavsdk.plugins.failure import FailureError, FailureType, FailureUnit
from mavsdk.plugins.geofence import Circle, FenceType, GeofenceData, Point, Polygon
from mavsdk.plugins.mission_raw import MissionItem, MissionRawError
from mavsdk.plugins.param import ParamError
from mavsdk.plugins.telemetry import FixType, FlightMode, LandedState
from patience import HANG_S
from sitl_mavsdk import HOME, Recorder, make_vehicle, mission_plan, over_udp, until, until_true

from flightdyn.frames import LocalFrame
from sitl.autopilot.flying.modes import Mode
from sitl.autopilot.parameters import TABLE
from sitl.vehicle import Vehicle

pytestmark = pytest.mark.slow

FRAME = LocalFrame(HOME)


async def take_off(system: System, vehicle: Vehicle, height_m: float) -> ActionAsync:
    action = ActionAsync(system)
    telemetry = TelemetryAsync(system)
    async for healthy in telemetry.subscribe_health_all_ok():
        if healthy:
            break
    await action.set_takeoff_altitude(height_m)
    await action.arm()
    await action.takeoff()
    await resting(vehicle)
    return action


async def resting(vehicle: Vehicle) -> None:
    await until(lambda: not vehicle.moving)


def test_action() -> None:
    async def run() -> None:
        vehicle = make_vehicle(recorder := Recorder())
        async with over_udp(vehicle) as system:
            action = ActionAsync(system)
            await action.takeoff()  # as with PX4 a choice: it takes off when it is armed
            assert (vehicle.autopilot.mode, vehicle.aircraft.armed) == (Mode.TAKEOFF, False)
            action = await take_off(system, vehicle, 25.0)
            assert await action.get_takeoff_altitude() == 25.0
            assert vehicle.aircraft.belief.alt_rel_m == pytest.approx(25.0, abs=0.3)
            await action.set_return_to_launch_altitude(33.0)
            assert await action.get_return_to_launch_altitude() == 33.0
            await action.set_current_speed(12.0)
            goal = np.array([40.0, 30.0, -35.0])
            place = FRAME.to_geodetic(goal)
            await action.goto_location(place.lat_deg, place.lon_deg, place.alt_msl_m, 90.0)
            await until(lambda: vehicle.moving)
            await resting(vehicle)
            assert np.linalg.norm(vehicle.aircraft.belief.pos_ned_m - goal) < 0.5
            with pytest.raises(ActionError):
                await action.disarm()
            await action.set_home(False, HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m)
            await action.return_to_launch()
            await until(lambda: vehicle.autopilot.mode is Mode.RETURN or not vehicle.moving)
            await action.hold()
            await until(lambda: vehicle.autopilot.mode is Mode.HOLD and not vehicle.moving)
            await action.land()
            await until(lambda: not vehicle.aircraft.armed)
            await action.arm()
            await action.disarm()
            await action.arm()
            await action.kill()
            assert not vehicle.aircraft.armed
        assert recorder.texts("armed") == ["armed", "disarmed"] * 3

    asyncio.run(run())


def test_mission_holds_at_points_and_pauses() -> None:
    async def run() -> None:
        vehicle = make_vehicle(recorder := Recorder())
        async with over_udp(vehicle) as system:
            await take_off(system, vehicle, 20.0)
            mission = MissionAsync(system)
            points = [(0.0, 0.0, 20.0), (60.0, 0.0, 20.0), (60.0, 40.0, 25.0)]
            plan = mission_plan(points, speed_mps=10.0, fly_through=False)
            await mission.upload_mission(plan)
            back = (await mission.download_mission()).mission_items
            assert [item.speed_m_s for item in back] == [10.0] * 3
            assert [item.is_fly_through for item in back] == [False] * 3
            await mission.start_mission()
            await mission.pause_mission()
            await until(lambda: vehicle.autopilot.mode is Mode.HOLD and not vehicle.moving)
            assert not await mission.is_mission_finished()
            await mission.start_mission()
            await until_true(mission.is_mission_finished)
            await mission.set_current_mission_item(1)
            assert not await mission.is_mission_finished()
            await mission.clear_mission()
            assert not vehicle.autopilot.flight.mission.items
        assert [event.seq for event in recorder.of_kind("reached")][-2:] == [2, 4]

    asyncio.run(run())


def raw_item(
    seq: int, command: int, north: float, east: float, height: float, **fields: Any
) -> Any:
    place = FRAME.to_geodetic(np.array([north, east, 0.0]))
    values: dict[str, Any] = {
        "frame": 6, "current": int(seq == 0), "autocontinue": 1,
        "param1": 0.0, "param2": 2.0, "param3": 0.0, "param4": math.nan,
        "x": round(place.lat_deg * 1e7), "y": round(place.lon_deg * 1e7), "z": height,
        "mission_type": 0, **fields,
    }  # fmt: skip
    return MissionItem(seq=seq, command=command, **values)


def test_mission_raw_with_fence_and_rally_lists() -> None:
    async def run() -> None:
        vehicle = make_vehicle(recorder := Recorder())
        async with over_udp(vehicle) as system:
            await take_off(system, vehicle, 20.0)
            raw = MissionRawAsync(system)
            items = [raw_item(0, 16, 0, 0, 20.0), raw_item(1, 16, 50.0, 0, 20.0)]
            rally = raw_item(0, 5100, 5.0, 5.0, 20.0, mission_type=2, frame=3, param2=0.0)
            fence = raw_item(0, 5003, 0, 0, 0.0, mission_type=1, frame=5, param1=300.0)
            await raw.upload_mission(items)
            await raw.upload_rally_points([rally])
            await raw.upload_geofence([fence])
            back = await raw.download_mission()
            assert [(i.seq, i.command, i.x, i.y, i.z) for i in back] == [
                (i.seq, i.command, i.x, i.y, i.z) for i in items
            ]
            assert [i.command for i in await raw.download_geofence()] == [5003]
            assert [i.command for i in await raw.download_rallypoints()] == [5100]
            await raw.set_current_mission_item(0)
            await raw.start_mission()
            await until_true(raw.is_mission_finished)
            progress = await raw.mission_progress()
            assert (progress.current, progress.total) == (2, 2)
            with pytest.raises(MissionRawError, match="UNSUPPORTED"):
                await raw.upload_mission([raw_item(0, 84, 0, 0, 20.0)])
            assert len(await raw.download_mission()) == 2
            await raw.clear_mission()
        assert [event.seq for event in recorder.of_kind("reached")] == [0, 1]

    asyncio.run(run())


async def first(stream: Any) -> Any:
    """The next value of a subscription."""
    value = await anext(stream)
    await stream.aclose()
    return value


def test_telemetry() -> None:
    async def run() -> None:
        vehicle = make_vehicle()
        async with over_udp(vehicle) as system:
            telemetry = TelemetryAsync(system)
            await take_off(system, vehicle, 20.0)
            await telemetry.set_rate_ground_truth(10.0)
            names = (
                "position", "home", "position_velocity_ned", "attitude_quaternion",
                "attitude_euler", "heading", "raw_gps", "gps_info", "battery", "flight_mode",
                "landed_state", "in_air", "armed", "health", "altitude", "fixedwing_metrics",
                "ground_truth", "velocity_ned", "attitude_angular_velocity_body",
            )  # fmt: skip
            async with asyncio.timeout(HANG_S):
                values = await asyncio.gather(
                    *(first(getattr(telemetry, f"subscribe_{name}")()) for name in names)
                )
                origin = await telemetry.get_gps_global_origin()
                await telemetry.set_rate_position(50.0)
                for _ in range(10):
                    await first(telemetry.subscribe_position())
            heard = dict(zip(names, values, strict=True))
            check_telemetry(heard, vehicle)
            assert origin.latitude_deg == pytest.approx(HOME.lat_deg, abs=1e-7)

    asyncio.run(run())


def check_telemetry(heard: dict[str, Any], vehicle: Vehicle) -> None:
    """Everything that was heard against the vehicle, whose time stands still."""
    aircraft, belief = vehicle.aircraft, vehicle.aircraft.belief
    place = FRAME.to_geodetic(belief.pos_ned_m)
    position = heard["position"]
    assert position.latitude_deg == pytest.approx(place.lat_deg, abs=1e-7)
    assert position.longitude_deg == pytest.approx(place.lon_deg, abs=1e-7)
    assert position.absolute_altitude_m == pytest.approx(place.alt_msl_m, abs=1e-3)
    assert position.relative_altitude_m == pytest.approx(belief.alt_rel_m, abs=0.01)
    assert heard["home"].latitude_deg == pytest.approx(HOME.lat_deg, abs=1e-7)
    ned = heard["position_velocity_ned"].position
    assert [ned.north_m, ned.east_m, ned.down_m] == pytest.approx(list(belief.pos_ned_m), abs=1e-3)
    velocity = heard["velocity_ned"]
    assert velocity.north_m_s == pytest.approx(belief.vel_ned_mps[0], abs=0.006)
    q = heard["attitude_quaternion"]
    assert [q.w, q.x, q.y, q.z] == pytest.approx(list(belief.q_frd_to_ned), abs=1e-5)
    rates = heard["attitude_angular_velocity_body"]
    assert rates.roll_rad_s == pytest.approx(belief.omega_frd_radps[0], abs=1e-4)
    assert abs(heard["attitude_euler"].roll_deg) < 10.0
    assert 0.0 <= heard["heading"].heading_deg <= 360.0
    fix = aircraft.gnss
    assert fix is not None
    raw, info = heard["raw_gps"], heard["gps_info"]
    assert raw.horizontal_uncertainty_m == pytest.approx(fix.std_horizontal_m, abs=1e-3)
    assert (info.num_satellites, info.fix_type) == (fix.satellites, FixType.FIX_3D)
    battery = heard["battery"]
    assert battery.voltage_v == pytest.approx(aircraft.battery.voltage_v, abs=1e-3)
    assert battery.remaining_percent == pytest.approx(aircraft.battery.remaining * 100, abs=0.51)
    assert heard["flight_mode"] == FlightMode.HOLD
    assert heard["landed_state"] == LandedState.IN_AIR
    assert heard["in_air"]
    assert heard["armed"]
    assert heard["health"].is_armable
    assert heard["altitude"].altitude_amsl_m == pytest.approx(place.alt_msl_m, abs=1e-2)
    assert heard["fixedwing_metrics"].groundspeed_m_s < 1.0
    true_place = FRAME.to_geodetic(aircraft.truth.pos_ned_m)
    assert heard["ground_truth"].latitude_deg == pytest.approx(true_place.lat_deg, abs=1e-7)


def test_param_info_failure_and_status_text() -> None:
    async def run() -> None:
        vehicle = make_vehicle(recorder := Recorder())
        async with over_udp(vehicle) as system:
            param = ParamAsync(system)
            assert await param.get_param_float("RTL_RETURN_ALT") == 30.0
            await param.set_param_float("RTL_RETURN_ALT", 44.5)
            assert vehicle.autopilot.parameters["RTL_RETURN_ALT"] == 44.5
            await param.set_param_int("NAV_DLL_ACT", 2)
            assert await param.get_param_int("NAV_DLL_ACT") == 2
            with pytest.raises(ParamError):
                await param.set_param_int("NAV_DLL_ACT", 99)
            assert vehicle.autopilot.parameters["NAV_DLL_ACT"] == 2.0
            everything = await param.get_all_params()
            names = {p.name for p in [*everything.int_params, *everything.float_params]}
            assert names == {spec.name for spec in TABLE}

            info = InfoAsync(system)
            version = await info.get_version()
            said = version.flight_sw_major, version.flight_sw_minor, version.flight_sw_patch
            assert ".".join(map(str, said)) == importlib.metadata.version("aerofed")
            assert (await info.get_identification()).legacy_uid > 0
            await info.get_product()

            texts: list[str] = []
            telemetry = TelemetryAsync(system)

            async def listen() -> None:
                async for status in telemetry.subscribe_status_text():
                    texts.append(status.text)  # noqa: PERF401 - read while it grows

            listening = asyncio.create_task(listen())
            await take_off(system, vehicle, 5.0)
            failure = FailureAsync(system)
            await failure.inject(FailureUnit.SENSOR_GPS, FailureType.OFF, 0)
            await until(lambda: "Fault begins: gnss_off" in texts)
            await failure.inject(FailureUnit.SENSOR_GPS, FailureType.OK, 0)
            with pytest.raises(FailureError):
                await failure.inject(FailureUnit.SENSOR_VIO, FailureType.OFF, 0)
            # A lost motor in the air: a quadrotor on three comes down; the vehicle stays sane.
            await failure.inject(FailureUnit.SYSTEM_MOTOR, FailureType.OFF, 1)
            action = ActionAsync(system)
            await action.terminate()
            await until(lambda: not vehicle.moving)
            assert not vehicle.aircraft.armed
            listening.cancel()
        assert recorder.texts("fault") == [
            "Fault begins: gnss_off",
            "Fault ends: gnss_off",
            "Fault begins: motor_loss",
        ]

    asyncio.run(run())


def test_geofence() -> None:
    def point(north: float, east: float) -> Point:
        place = FRAME.to_geodetic(np.array([north, east, 0.0]))
        return Point(place.lat_deg, place.lon_deg)

    async def run() -> None:
        vehicle = make_vehicle()
        async with over_udp(vehicle) as system:
            action = await take_off(system, vehicle, 20.0)
            corners = [point(-80, -80), point(80, -80), point(80, 80), point(-80, 80)]
            fence = GeofenceAsync(system)
            await fence.upload_geofence(
                GeofenceData(
                    [Polygon(corners, FenceType.INCLUSION)],
                    [Circle(point(50, 50), 10.0, FenceType.EXCLUSION)],
                )
            )
            back = await fence.download_geofence()
            assert len(back.polygons[0].points) == 4
            assert back.circles[0].radius == 10.0
            outside = FRAME.to_geodetic(np.array([100.0, 0.0, -20.0]))
            with pytest.raises(ActionError, match="COMMAND_DENIED"):
                await action.goto_location(
                    outside.lat_deg, outside.lon_deg, outside.alt_msl_m, math.nan
                )
            await fence.clear_geofence()
            await action.goto_location(
                outside.lat_deg, outside.lon_deg, outside.alt_msl_m, math.nan
            )
            await resting(vehicle)
            assert vehicle.aircraft.belief.pos_ned_m[0] == pytest.approx(100.0, abs=0.5)

    asyncio.run(run())
