"""A whole flight of the real aircraft, ordered by MAVSDK over its in-process link."""

import asyncio
import threading

import numpy as np
import pytest
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission import MissionAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.telemetry import FlightMode
from sitl_mavsdk import Recorder, make_vehicle, mission_plan, over_raw, until, until_true

from sitl.autopilot.flying.modes import Mode

pytestmark = pytest.mark.slow

SQUARE = [(0.0, 0.0, 40.0), (80.0, 0.0, 40.0), (80.0, 60.0, 40.0)]
BACK = [(80.0, 60.0, 40.0), (0.0, 60.0, 45.0)]


async def fly_two_missions(recorder: Recorder) -> None:
    """Take off, fly two missions one after the other in the air, hold, return, land."""
    vehicle = make_vehicle(recorder)
    async with over_raw(vehicle) as system:
        action, mission, telemetry = (
            ActionAsync(system),
            MissionAsync(system),
            TelemetryAsync(system),
        )
        async for healthy in telemetry.subscribe_health_all_ok():
            if healthy:
                break
        await action.set_takeoff_altitude(40.0)
        await action.arm()
        assert vehicle.t_ns == recorder.events[0].t_ns  # arming moves nothing
        await action.takeoff()
        await until(lambda: vehicle.autopilot.mode is Mode.HOLD and not vehicle.moving)
        for points in (SQUARE, BACK):
            await mission.upload_mission(mission_plan(points, speed_mps=15.0))
            assert not await mission.is_mission_finished()
            await mission.set_current_mission_item(0)
            await mission.start_mission()
            await until_true(mission.is_mission_finished)
            progress = await mission.mission_progress()
            assert (progress.current, progress.total) == (len(points), len(points))
            assert not vehicle.moving
            stopped_at = vehicle.t_ns
            await asyncio.sleep(0.05)
            assert vehicle.t_ns == stopped_at
        assert len((await mission.download_mission()).mission_items) == len(BACK)
        async for mode in telemetry.subscribe_flight_mode():
            if mode == FlightMode.HOLD:
                break
        await action.hold()
        await action.return_to_launch()
        await until(lambda: not vehicle.aircraft.armed)


def test_two_missions_in_one_flight() -> None:
    recorder = Recorder()
    asyncio.run(fly_two_missions(recorder))

    modes = [text.split()[0] for text in recorder.texts("mode")]
    assert modes == [
        "TAKEOFF",
        "HOLD",
        "MISSION",
        "HOLD",
        "MISSION",
        "HOLD",
        "RETURN",
        "LAND",
        "HOLD",
    ]
    # A MAVSDK item with a speed is two MAVLink items; the places are the even ones.
    reached = recorder.of_kind("reached")
    assert [event.seq for event in reached] == [0, 2, 4, 0, 2]
    for event, (north, east, height) in zip(reached, SQUARE + BACK, strict=True):
        miss = event.belief.pos_ned_m - np.array([north, east, -height])
        assert np.linalg.norm(miss) < 5.0
    ends = [event.t_ns for event in recorder.of_kind("mode") if event.text.startswith("HOLD")]
    assert ends[1] == max(e.t_ns for e in reached[:3])  # time stops with the last item
    touchdown = recorder.of_kind("armed")[-1]
    assert np.linalg.norm(touchdown.truth.pos_ned_m) < 3.0


def test_track_is_the_same_bytes_on_a_loaded_machine() -> None:
    """Scheduling decides when messages arrive; it must not decide anything about the flight."""
    quiet, loaded = Recorder(), Recorder()
    asyncio.run(fly_two_missions(quiet))
    stop = threading.Event()

    def burn() -> None:
        while not stop.is_set():
            sum(range(2000))

    burner = threading.Thread(target=burn)
    burner.start()
    try:
        asyncio.run(fly_two_missions(loaded))
    finally:
        stop.set()
        burner.join()
    assert len(quiet.samples) > 500
    assert quiet.track() == loaded.track()
    assert [(e.t_ns, e.text) for e in quiet.events] == [(e.t_ns, e.text) for e in loaded.events]
