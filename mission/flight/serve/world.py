"""The aircraft on its own, served to a firmware that somebody else starts, until they stop it."""

import asyncio
import math
import threading
from contextlib import AsyncExitStack, closing
from dataclasses import dataclass
from typing import Protocol

from flightdyn.plant import Plant
from flightdyn.random import RandomStreams
from mission.base.area import Area
from mission.base.errors import InputError
from mission.config.link import LinkConfig
from mission.config.models import RunConfig
from mission.flight.flyers.base import Say
from mission.flight.flyers.firmware import Milestones
from mission.flight.pilot.connection import located
from mission.flight.pilot.feed import Known
from mission.flight.serve.flight_logs import FlightLogs
from native.errors import FirmwareRestartedError
from sitl.autopilot.codec.orders import MissionItem
from sitl.block import following
from sitl.firmware.ardupilot import ArduPilotBridge
from sitl.firmware.bridge import Bridge
from sitl.firmware.clock import FirmwareClock, TruthHistory
from sitl.firmware.px4 import Px4Bridge
from sitl.firmware.vehicle import plant_for

_LOOK_S = 0.2
_FOR_EVER_S = 1e6
_TELL_OF_LISTS = ("total", "mission_id", "fence_id", "rally_points_id")


class Watched(Protocol):
    """An aircraft that a firmware flies on our clock."""

    @property
    def plant(self) -> Plant: ...

    @property
    def truth(self) -> TruthHistory: ...


@dataclass(frozen=True)
class Recorder:
    """Writes each flight of a firmware, as `aerofed sitl --logs` does: belief, modes and lists by
    its MAVLink at `url`, truth by our physics."""

    area: Area
    link: LinkConfig
    url: str
    logs: FlightLogs

    async def follow(self, flown: Watched, say: Say) -> None:
        """Record until cancelled; download the lists whenever the firmware reports a change.

        Raises:
            LinkLostError: the link cannot be opened.
            InputError: the vehicle is too far from the area.
        """
        patient = dict.fromkeys(("connect_timeout_s", "ready_timeout_s"), _FOR_EVER_S)
        link = self.link.model_copy(update={**patient, "url": self.url})
        with closing(self.logs):
            observers = self.logs, Milestones(flown.plant)
            known = Known(flown.truth.at, flown.plant.fault_news)
            async with located(link, area=self.area, observers=observers, say=say, known=known) as (
                pilot,
                feed,
            ):
                feed.first_item = 0  # its lists are recorded as they are
                held: list[tuple[MissionItem, ...]] = [(), (), ()]
                said = None
                async for fields in pilot.messages.of("MISSION_CURRENT"):
                    tells = pilot.armed, [fields.get(name) for name in _TELL_OF_LISTS]
                    if tells != said and (lists := await pilot.lists()) is not None:
                        for kind, (items, before) in enumerate(zip(lists, held, strict=True)):
                            if repr(items) != repr(before):  # a NaN is no NaN's equal
                                self.logs.took(flown.plant.t_ns, kind, items)
                        said, held = tells, lists


def serve_world(
    config: RunConfig,
    autopilot: str,
    *,
    port: int,
    speed: float,
    say: Say,
    stop: threading.Event,
    recorder: Recorder | None = None,
) -> None:
    """Serve the configured aircraft to the `autopilot`, "px4" or "ardupilot", that comes to `port`.

    Whenever a firmware ends or starts anew, the aircraft stands at home again. Ends when `stop`
    is set, or by KeyboardInterrupt.

    Raises:
        InputError: a setting of the aircraft is refused.
        LinkLostError: the port cannot be had.
        FlightError: what came is no such firmware, or the aircraft left its physics.
    """
    while not stop.is_set():
        area, streams = config.area.build(), RandomStreams(config.seed)
        bridge = bridge_to(
            config, autopilot, port, told=recorder is not None, area=area, streams=streams
        )
        bridge.open()
        clock = FirmwareClock(bridge, speed=speed, patience_s=math.inf)
        clock.start()
        clock.run()
        try:
            at = where(bridge.plant)
            say(f"aircraft {at}, waiting for {autopilot} on port {port}; Ctrl-C ends")
            asyncio.run(_watch(bridge, clock, autopilot, say, stop, recorder))
        finally:
            clock.stop()
        if isinstance(clock.error, FirmwareRestartedError):
            say(f"{clock.error} after {bridge.plant.t_ns / 1e9:.1f} s")
        elif clock.error is not None:
            raise clock.error


def where(plant: Plant) -> str:
    """Where an aircraft stands, and at what rate it is stepped."""
    home, rate_hz = plant.frame.origin, 1e9 / plant.dt_ns
    at = f"{home.lat_deg:.7f}, {home.lon_deg:.7f}, {home.alt_msl_m:g} m"
    return f"at {at}, {rate_hz:g} Hz"


async def _watch(
    bridge: Bridge,
    clock: FirmwareClock,
    autopilot: str,
    say: Say,
    stop: threading.Event,
    recorder: Recorder | None,
) -> None:
    """Wait for the end of the firmware, or `stop`, while the flights are recorded."""
    async with AsyncExitStack() as beside:
        if recorder is not None:
            work = recorder.follow(clock, say)
            await beside.enter_async_context(following(work, name="recorder"))
        told = False
        while clock.error is None and not stop.is_set():
            await asyncio.sleep(_LOOK_S)
            if bridge.connected and not told:
                told = True
                say(f"{autopilot} has come")


def bridge_to(
    config: RunConfig, autopilot: str, port: int, *, told: bool, area: Area, streams: RandomStreams
) -> Bridge:
    """Make a bridge to a firmware that comes to `port`, with the configured aircraft at the area's
    home; `told`: whether the firmware is heard by MAVLink.

    Raises:
        InputError: a setting of the aircraft is refused.
    """
    # Not validated: its firmware is somebody else's.
    vehicle = config.vehicle.model_copy(update={"autopilot": autopilot})
    for fault in config.vehicle.aircraft.faults:
        if autopilot == "ardupilot" and fault.kind == "gnss_off":
            raise InputError(
                "vehicle.aircraft.faults: gnss_off: ArduPilot's JSON interface cannot leave "
                "positions out; set its parameter SIM_GPS1_ENABLE to 0 yourself"
            )
        if fault.after is not None and not told:
            raise InputError(
                f"vehicle.aircraft.faults: after = {fault.after!r}: aerofed world is told when "
                "that is with --logs only; leave it out, and at_s counts from the start"
            )
    plant = plant_for(vehicle, home=area.home, streams=streams, obstacles=area.obstacles)
    if autopilot == "px4":
        return Px4Bridge(plant, port=port)
    return ArduPilotBridge(plant, port=port)
