"""MAVSDK 4.1 as the pilot: offboard, sticks, orbit and follow me."""

import asyncio
import math

import numpy as np
import pytest
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.follow_me import FollowMeAsync
from mavsdk.asyncio.plugins.manual_control import ManualControlAsync, ManualControlError
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action import OrbitYawBehavior
from mavsdk.plugins.follow_me import Config, TargetLocation
from mavsdk.plugins.offboard import PositionNedYaw, VelocityNedYaw
from patience import HANG_S
from sitl_mavsdk import HOME, client, make_vehicle, until

from sitl.autopilot.flying.modes import Mode
from sitl.links import RawLink
from sitl.pace import Simulation
from sitl.vehicle import Vehicle

pytestmark = pytest.mark.slow


def place(vehicle: Vehicle) -> np.ndarray:
    return np.array(vehicle.aircraft.belief.pos_ned_m)


async def fly(vehicle: Vehicle) -> None:
    link = RawLink()
    async with Simulation(vehicle, link, speed=20.0), client() as mavsdk:
        await mavsdk.add_any_connection("raw://")
        mavsdk._mavsdk.subscribe_raw_bytes_to_be_sent(link.feed)
        link.attach(mavsdk._mavsdk.pass_received_raw_bytes)
        system = await mavsdk.first_autopilot(timeout_s=HANG_S)
        assert system is not None
        action, autopilot = ActionAsync(system), vehicle.autopilot
        # What goes by wall time is given more of it: the machine may be busy.
        autopilot.parameters.set("COM_OF_LOSS_T", 30.0)
        autopilot.parameters.set("COM_RC_LOSS_T", 30.0)
        async for healthy in TelemetryAsync(system).subscribe_health_all_ok():
            if healthy:
                break
        offboard = OffboardAsync(system)
        await action.arm()
        await offboard.set_velocity_ned(VelocityNedYaw(0.0, 0.0, -2.0, 0.0))
        await offboard.start()
        assert autopilot.mode is Mode.OFFBOARD
        await until(lambda: place(vehicle)[2] < -10.0)
        await offboard.set_position_ned(PositionNedYaw(20.0, 5.0, -15.0, 90.0))
        goal = np.array([20.0, 5.0, -15.0])
        await until(lambda: bool(np.linalg.norm(place(vehicle) - goal) < 0.5))
        await offboard.stop()
        assert autopilot.mode is Mode.HOLD
        sticks = ManualControlAsync(system)
        with pytest.raises(ManualControlError):
            await sticks.start_position_control()
        await sticks.set_manual_control_input(1.0, 0.0, 0.5, 0.0)
        await sticks.start_position_control()
        assert autopilot.mode is Mode.POSITION
        await until(lambda: place(vehicle)[1] > 15.0)  # ahead is east
        front = OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER
        await action.do_orbit(12.0, 3.0, front, HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m + 20.0)
        assert autopilot.mode is Mode.ORBIT
        await until(lambda: abs(math.hypot(*place(vehicle)[:2]) - 12.0) < 0.5)
        follow = FollowMeAsync(system)
        config = Config(10.0, 5.0, 0.1, Config.FollowAltitudeMode.CONSTANT, 5.0, 180.0)
        await follow.set_config(config)
        assert autopilot.parameters["FLW_TGT_DST"] == 5.0
        await follow.start()
        assert autopilot.mode is Mode.FOLLOW
        target = TargetLocation(HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m, 0.0, 0.0, 0.0)
        await follow.set_target_location(target)
        behind = np.array([-5.0, 0.0, -10.0])
        await until(lambda: bool(np.linalg.norm(place(vehicle) - behind) < 0.7))
        await follow.stop()
        await action.land()
        await until(lambda: not vehicle.aircraft.armed)
        link.detach()


def test_mavsdk_flies_by_setpoints_sticks_orbit_and_target() -> None:
    vehicle = make_vehicle()
    asyncio.run(fly(vehicle))
    assert not vehicle.aircraft.crashed
