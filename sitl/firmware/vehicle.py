"""Our aircraft under a firmware: its process, the bridge, simulated time and the relay together."""

import asyncio
import math
import os
import socket
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Self, TypeAlias

from flightdyn.config import ImuConfig
from flightdyn.faults import LinkOff
from flightdyn.obstacles import Obstacles
from flightdyn.plant import Plant
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from native.errors import FirmwareError, FirmwareSilentError, InputError
from sitl.autopilot.codec.orders import Fields
from sitl.block import following
from sitl.config import VehicleConfig
from sitl.firmware.ardupilot import LOOPS_HZ, ardupilot_launch, check_arducopter, slowest_rate_hz
from sitl.firmware.bridge import Bridge, bound
from sitl.firmware.clock import FirmwareClock, SharedClock
from sitl.firmware.launch import FirmwareProcess, LaunchOptions
from sitl.firmware.px4 import etc_of, px4_launch
from sitl.firmware.relay import Hear, Relay, Writer
from sitl.links import Link

# Makes the clock of a firmware in a world with others, from its bridge and what reads telemetry.
ShareClock: TypeAlias = Callable[[Bridge, Callable[[], None]], SharedClock]

_LOOK_S = 0.05  # wall time between looks whether all is well
# PX4 refuses to arm, and complains in flight, where its filter finds a bias of the accelerometer
# beyond 0.75 of EKF2_ABL_LIM (0.4 m/s2): three standard deviations, and a walk that adds nothing to
# speak of in an hour.
_PX4_IMU = {"accel_turn_on_mps2": 0.1, "accel_random_walk": 5e-4}
_GNSS_SWITCH = "SIM_GPS1_ENABLE"  # ArduPilot's; its JSON interface cannot leave positions out


def plant_rate_hz(vehicle: VehicleConfig) -> int:
    """Return the physics rate (Hz) of the plant under the configured firmware."""
    if vehicle.autopilot == "ardupilot":
        loops_hz = vehicle.firmware.parameters.get("SCHED_LOOP_RATE", LOOPS_HZ)
        return max(vehicle.aircraft.physics_hz, slowest_rate_hz(loops_hz))
    return vehicle.aircraft.physics_hz


def check_firmware(vehicle: VehicleConfig) -> None:
    """Check that the binary is the configured firmware, as far as that shows before it runs.

    Raises:
        FirmwareSilentError: it is not; says what is wrong.
    """
    path = vehicle.firmware.path
    assert path is not None  # so says the configuration
    if vehicle.autopilot == "px4":
        etc_of(path)
    else:
        check_arducopter(path)


def plant_for(
    vehicle: VehicleConfig,
    *,
    home: GeodeticPoint,
    streams: RandomStreams,
    obstacles: Obstacles | None = None,
) -> Plant:
    """Build the configured aircraft on the ground at `home`, at the rate that its firmware needs.

    Under PX4 it has a better accelerometer, unless the configuration changes its IMU.

    Raises:
        InputError: an interval of the configuration is no whole number of ticks, or a fault is of
            the built-in autopilot.
    """
    aircraft = vehicle.aircraft
    if any(isinstance(fault, LinkOff) for fault in aircraft.faults):
        raise InputError(
            "vehicle.aircraft.faults: 'link_off' is of the built-in autopilot: a firmware has "
            "links of its own to ground stations; leave it out"
        )
    changes: dict[str, object] = {"physics_hz": plant_rate_hz(vehicle)}
    if vehicle.autopilot == "px4" and aircraft.sensors.imu == ImuConfig():
        imu = ImuConfig(**_PX4_IMU)
        changes["sensors"] = aircraft.sensors.model_copy(update={"imu": imu})
    aircraft = aircraft.model_copy(update=changes)
    return Plant(aircraft, home=home, streams=streams, obstacles=obstacles)


class FirmwareVehicle:
    """A firmware that flies a plant: an asynchronous context manager.

    Time stands still in it until `clock.run`. Whatever goes wrong with the firmware ends the
    block, or that of `going` where it is one of several: it is cancelled, and leaving it raises
    what was wrong.
    """

    clock: SharedClock
    relay: Relay
    process: FirmwareProcess

    def __init__(
        self,
        vehicle: VehicleConfig,
        plant: Plant,
        folder: Path,
        links: Sequence[Link],
        *,
        mission_speed_mps: float,
        speed: float,
        hear: Hear,
        heard: frozenset[int],
        shared: ShareClock | None = None,
    ) -> None:
        """Nothing is opened yet.

        `folder` is created as the firmware's working folder. `links` lead to ground stations;
        `hear` gets the vehicle's messages whose numbers are in `heard`; time waits for those with
        a time stamp. `speed`: simulated seconds per second at most; infinite: no limit. `shared`:
        for one of several, whose world has the speed and steps its plant.
        """
        self.plant = plant
        self._vehicle = vehicle
        self._folder = folder
        self._links = links
        self._mission_speed_mps = mission_speed_mps
        self._speed = speed
        self._hear, self._heard = hear, heard
        self._shared = shared
        self._followed = shared is None  # that something may go wrong is looked for
        self._writer = Writer(vehicle.system_id)
        self._gnss_on = True
        self._open = AsyncExitStack()

    async def __aenter__(self) -> Self:
        """Open bridge, links and relay and start the firmware.

        Raises:
            LinkLostError: a port or link cannot be had.
            FirmwareSilentError: the firmware cannot be started.
        """
        async with AsyncExitStack() as opened:
            sock = bound(socket.SOCK_DGRAM, 0)
            opened.callback(sock.close)
            with bound(socket.SOCK_DGRAM, 0) as free:
                ports = sock.getsockname()[1], free.getsockname()[1]
            options = LaunchOptions(self._vehicle, *ports, self._mission_speed_mps)
            prepare = px4_launch if self._vehicle.autopilot == "px4" else ardupilot_launch
            launch = prepare(options, self.plant)
            processor = None
            if self._shared is None:
                processor = _shared_processor()
                self.clock = FirmwareClock(launch.bridge, speed=self._speed, processor=processor)
            else:
                self.clock = self._shared(launch.bridge, lambda: self.relay.listen())
            opened.callback(self.clock.stop)
            self.relay = Relay(
                sock,
                self._links,
                asked=self.clock.cap_at_wall_pace,
                each_beat=self._battery,
                hear=self._take_heard,
                heard=self._heard,
            )
            await opened.enter_async_context(self.relay)
            self.process = launch.start(self._folder, processor=processor)
            opened.callback(self.process.stop)
            self.clock.start()
            if self._followed:
                await opened.enter_async_context(following(self._watch(), name="firmware watch"))
            self._open = opened.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._open.aclose()

    @asynccontextmanager
    async def going(self, until_ns: float = math.inf) -> AsyncIterator[None]:
        """Context manager: time goes on inside the block, up to an instant.

        Raises:
            FirmwareError: of one of several: what went wrong with it.
        """
        with self.clock.going(until_ns):
            if self._followed:
                yield
                return
            self._followed = True
            try:
                async with following(self._watch(), name="firmware watch"):
                    yield
            finally:
                self._followed = False

    def _take_heard(self, name: str, fields: Fields) -> None:
        """Hand on a message; one with a time stamp lets time go on."""
        if "time_boot_ms" in fields:
            self.clock.heard(fields["time_boot_ms"] * 1_000_000)
        if self._vehicle.autopilot == "ardupilot":
            self._switch_gnss()
        self._hear(name, fields)

    async def _watch(self) -> None:
        """Raise what goes wrong with the firmware."""
        while True:
            await asyncio.sleep(_LOOK_S)
            error = self.failure()
            if error is not None:
                raise error

    def _battery(self) -> bytes:
        """Return the BATTERY_STATUS that PX4 takes for its own; empty for ArduPilot."""
        if self._vehicle.autopilot == "ardupilot":
            return b""
        capacity_mah = self._vehicle.aircraft.battery.capacity_mah
        return self._writer.battery(self.clock.truth.newest.battery, capacity_mah)

    def _switch_gnss(self) -> None:
        """Switch ArduPilot's GNSS off and on with ours."""
        sensors = self.plant.sensors
        if sensors is not None and sensors.receiver.on != self._gnss_on:
            self._gnss_on = sensors.receiver.on
            self.relay.to_firmware(self._writer.parameter(_GNSS_SWITCH, float(self._gnss_on)))

    def failure(self) -> BaseException | None:
        """Return what has gone wrong with firmware or aircraft; None if nothing."""
        error, died = self.clock.error, self.process.died
        if error is not None and not isinstance(error, FirmwareError):
            return error
        if died:  # its aircraft may have fallen since
            return FirmwareSilentError(self.with_last_words(died))
        if error is not None:
            return type(error)(self.with_last_words(str(error)))
        if self.plant.impact_mps is not None:
            return FirmwareError(
                f"the aircraft is lost: it hit {self.plant.hit} at {self.plant.impact_mps:.1f} m/s"
            )
        return None

    def with_last_words(self, text: str) -> str:
        """Return `text` with the path and the last lines of the firmware's console added."""
        said = self.process.last_words()
        ended = f"ended with: {said}" if said else "is empty"
        return f"{text}; its console ({self.process.console}) {ended}"


def _shared_processor() -> int | None:
    """Choose one processor for firmware and bridge, which take turns: waking a sleeping one would
    take longer than a turn. Return None where the system does not let us choose.
    """
    if not hasattr(os, "sched_getaffinity"):
        return None
    allowed = sorted(os.sched_getaffinity(0))
    return allowed[os.getpid() % len(allowed)]
