"""The flight of a vehicle that only telemetry tells of, as samples for log and track.

MAVSDK's telemetry plugin drops the time stamps, so positions are taken from the messages
themselves: the clock is the vehicle's own, counted from the first position.
"""

import asyncio
import json
import logging
import math
from collections.abc import AsyncIterator, Sequence
from typing import Any

import numpy as np
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.mavlink_direct import MavlinkMessage

from flightdyn.frames import frozen
from flightdyn.state import BatteryState, GeodeticPoint, Kinematics
from mission.area import Area
from mission.pilot.orders import Pilot
from mission.track import Passage
from sitl.observer import VehicleObserver, VehicleSample

logger = logging.getLogger(__name__)

SET_MESSAGE_INTERVAL = 511
# Message number and rate: what this module and MAVSDK's plugins live on. Nobody but the vehicle
# knows what it sends by itself; ArduPilot sends next to nothing.
STREAMS_HZ = {
    "SYS_STATUS": (1, 2.0),
    "GPS_RAW_INT": (24, 2.0),
    "ATTITUDE_QUATERNION": (31, 10.0),
    "GLOBAL_POSITION_INT": (33, 20.0),
    "MISSION_CURRENT": (42, 5.0),
    "BATTERY_STATUS": (147, 1.0),
    "HOME_POSITION": (242, 1.0),
    "EXTENDED_SYS_STATE": (245, 5.0),
}
_UNKNOWN_PERCENT = -1


class TelemetryFeed:
    """Turns a vehicle's messages into samples. Truth and belief are both what it says."""

    def __init__(self, pilot: Pilot, *, area: Area, observers: Sequence[VehicleObserver]) -> None:
        self._pilot = pilot
        self._direct = MavlinkDirectAsync(pilot.system)
        self._area = area
        self._observers = observers
        self._boot_ms: int | None = None  # the vehicle's clock at the first position
        self._attitude = frozen([1.0, 0.0, 0.0, 0.0])
        self._rates = frozen([0.0, 0.0, 0.0])
        self._battery = BatteryState(math.nan, math.nan, math.nan, math.nan)
        self._here: Passage | None = None
        self.first: asyncio.Future[GeodeticPoint] = asyncio.get_running_loop().create_future()
        self.reached_ns: dict[int, int] = {}  # by item: when the vehicle said so

    @property
    def here(self) -> Passage | None:
        """The newest position; None before the first."""
        return self._here

    @property
    def battery_remaining(self) -> float:
        """0..1; NaN where the vehicle does not know."""
        return self._battery.remaining

    async def ask(self) -> None:
        """Ask for the streams. A vehicle may refuse what it sends anyway."""
        target = await self._pilot.system.get_system_id()
        for name, (number, rate_hz) in STREAMS_HZ.items():
            fields = {
                "target_system": target, "target_component": 1, "confirmation": 0,
                "command": SET_MESSAGE_INTERVAL, "param1": number, "param2": 1e6 / rate_hz,
                "param3": 0, "param4": 0, "param5": 0, "param6": 0, "param7": 0,
            }  # fmt: skip
            order = MavlinkMessage("COMMAND_LONG", 0, 0, target, 1, json.dumps(fields))
            try:
                answer = json.loads((await self._direct.send_command(order)).fields_json)
                if answer["result"] != 0:
                    logger.info("the vehicle refuses to stream %s: %s", name, answer["result"])
            except MavsdkError as error:
                logger.info("no answer to the request for %s: %s", name, error)

    async def watch(self) -> None:
        """Follow the messages until cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._watch_position())
            group.create_task(self._watch_attitude())
            group.create_task(self._watch_battery())
            group.create_task(self._watch_reached())

    async def _messages(self, name: str) -> AsyncIterator[dict[str, Any]]:
        async for message in self._direct.subscribe_message(name):
            yield json.loads(message.fields_json)

    async def _watch_position(self) -> None:
        async for fields in self._messages("GLOBAL_POSITION_INT"):
            if self._boot_ms is None:
                self._boot_ms = fields["time_boot_ms"]
            t_ns = (fields["time_boot_ms"] - self._boot_ms) * 1_000_000
            if self._here is not None and t_ns <= self._here.t_ns:
                continue
            height_m = fields["relative_alt"] / 1e3
            seen = GeodeticPoint(
                fields["lat"] / 1e7, fields["lon"] / 1e7, self._area.home.alt_msl_m + height_m
            )
            place = self._area.frame.to_ned(seen.lat_deg, seen.lon_deg, seen.alt_msl_m)
            # Height above home is what the vehicle says, not the plane that touches the globe.
            position = frozen([float(place[0]), float(place[1]), -height_m])
            velocity = frozen([fields["vx"] / 1e2, fields["vy"] / 1e2, fields["vz"] / 1e2])
            said = Kinematics(t_ns, position, velocity, self._attitude, self._rates)
            self._here = Passage(t_ns, position, position)
            if not self.first.done():
                self.first.set_result(seen)
            sample = VehicleSample(
                t_ns=t_ns, truth=said, belief=said, cmd_pos_ned_m=None, gnss=None,
                battery=self._battery, mode=self._pilot.mode, armed=self._pilot.armed,
            )  # fmt: skip
            for observer in self._observers:
                observer.sampled(sample)

    async def _watch_attitude(self) -> None:
        async for fields in self._messages("ATTITUDE_QUATERNION"):
            q = np.array([fields["q1"], fields["q2"], fields["q3"], fields["q4"]])
            self._attitude = frozen(q / np.linalg.norm(q))
            rates = (fields["rollspeed"], fields["pitchspeed"], fields["yawspeed"])
            self._rates = frozen(rates)

    async def _watch_battery(self) -> None:
        async for fields in self._messages("BATTERY_STATUS"):
            percent, consumed = fields["battery_remaining"], fields["current_consumed"]
            cells = [cell for cell in fields["voltages"] if cell < 65535]
            current = fields["current_battery"]
            self._battery = BatteryState(
                sum(cells) / 1e3,
                math.nan if current == -1 else current / 1e2,
                math.nan if consumed == -1 else float(consumed),
                math.nan if percent == _UNKNOWN_PERCENT else percent / 100,
            )

    async def _watch_reached(self) -> None:
        async for fields in self._messages("MISSION_ITEM_REACHED"):
            if self._here is not None:
                self.reached_ns.setdefault(fields["seq"], self._here.t_ns)
