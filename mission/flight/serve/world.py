"""The aircraft on its own, served to a firmware that somebody else starts, until they stop it."""

import math
import threading
from collections.abc import Callable

from flightdyn.random import RandomStreams
from mission.base.errors import FlightError, InputError
from mission.config.models import RunConfig
from mission.flight.failures import of_a_vehicle, of_settings
from sitl.config import VehicleConfig
from sitl.errors import FirmwareError, FirmwareRestartedError
from sitl.firmware.ardupilot import ArduPilotBridge
from sitl.firmware.bridge import Bridge
from sitl.firmware.clock import FirmwareClock
from sitl.firmware.px4 import Px4Bridge
from sitl.firmware.vehicle import plant_for

_LOOK_S = 0.2

Say = Callable[[str], None]


def serve_world(
    config: RunConfig, autopilot: str, *, port: int, speed: float, say: Say, stop: threading.Event
) -> None:
    """Serve the configured aircraft to the `autopilot`, "px4" or "ardupilot", that comes to `port`.

    Whenever a firmware ends or starts anew, the aircraft stands at home again. Ends when `stop`
    is set, or by KeyboardInterrupt.

    Raises:
        InputError: a setting of the aircraft is refused.
        LinkLostError: the port cannot be had.
        FlightError: what came is no such firmware, or the aircraft left its physics.
    """
    try:
        with of_a_vehicle(), of_settings():
            while not stop.is_set():
                _serve_once(config, autopilot, port=port, speed=speed, say=say, stop=stop)
    except FirmwareError as error:
        raise FlightError(str(error)) from None


def _serve_once(
    config: RunConfig, autopilot: str, *, port: int, speed: float, say: Say, stop: threading.Event
) -> None:
    bridge = _bridge(config, autopilot, port)
    bridge.open()
    clock = FirmwareClock(bridge, speed=speed, patience_s=math.inf)
    clock.start()
    clock.run()
    try:
        home = bridge.plant.frame.origin
        say(
            f"aircraft at {home.lat_deg:.7f}, {home.lon_deg:.7f}, {home.alt_msl_m:g} m, "
            f"{1e9 / bridge.plant.dt_ns:g} Hz, waiting for {autopilot} on port {port}; Ctrl-C ends"
        )
        told = False
        while clock.error is None and not stop.wait(_LOOK_S):
            if bridge.connected and not told:
                told = True
                say(f"{autopilot} has come")
    finally:
        clock.stop()
    if isinstance(clock.error, FirmwareRestartedError):
        say(f"{clock.error} after {bridge.plant.t_ns / 1e9:.1f} s")
    elif clock.error is not None:
        raise clock.error


def _bridge(config: RunConfig, autopilot: str, port: int) -> Bridge:
    vehicle = VehicleConfig.model_construct(
        **{**dict(config.vehicle), "autopilot": autopilot}  # its firmware is somebody else's
    )
    for fault in config.vehicle.aircraft.faults:
        if fault.after is not None:
            raise InputError(
                f"vehicle.aircraft.faults: after = {fault.after!r}: aerofed world is not told when "
                "that is; leave it out, and at_s counts from the start"
            )
    home, streams = config.area.build().home, RandomStreams(config.seed)
    plant = plant_for(vehicle, home=home, streams=streams)
    if autopilot == "px4":
        return Px4Bridge(plant, port=port)
    return ArduPilotBridge(plant, port=port)
