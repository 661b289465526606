"""A real firmware flies the simulated aircraft.

It is flown like any external autopilot, with two differences: the truth is known, and time is
ours. Time stands still while a round is planned and devices train, and goes on while the firmware
takes orders, whose answers take it some of its own time.
"""

import math
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Concatenate, NamedTuple, ParamSpec, Self, TypeVar

import numpy as np

from flightdyn.plant import Plant
from mission.base.errors import FlightError, InputError
from mission.config.models import RunConfig
from mission.flight.flyers.base import Attached, Backend, Flyer, Task, station_links
from mission.flight.flyers.external import ExternalFlyer, limits_of
from mission.flight.missions.round_mission import FlightPlan, stop_items
from mission.flight.pilot.connection import NoVehicleError, located
from mission.flight.pilot.feed import Known, Takers
from mission.flight.pilot.pilot import Pilot
from mission.flight.track import FlightRecorder, FlownTrack, reported_in_turn
from native.errors import FirmwareError, FirmwareSilentError
from sitl.firmware.vehicle import FirmwareVehicle, ShareClock, check_firmware, plant_for
from sitl.links import RawLink
from sitl.observer import VehicleEvent, VehicleSample

P = ParamSpec("P")
T = TypeVar("T")

NAMES = {"px4": "PX4", "ardupilot": "ArduPilot"}
FOLDER = "firmware"  # of a run, where the firmware lives
_HEARD = frozenset({0, 31, 33, 46, 83, 85, 147, 162, 242})  # what the feed takes from the relay
_TOLD_NS = 100_000_000  # after an instant, in which a position is told: two of its intervals
_AIRBORNE_M = 0.5
_SAME_PARAMETER = 1e-4  # relative: parameters travel as 32-bit floats


@dataclass(frozen=True)
class Milestones:
    """`VehicleObserver` that tells the plant of the events after which its faults may begin."""

    plant: Plant

    def sampled(self, sample: VehicleSample) -> None:
        if sample.armed:
            self.plant.faults.happened("arming")
        if sample.truth.alt_rel_m > _AIRBORNE_M:
            self.plant.faults.happened("take-off")

    def happened(self, event: VehicleEvent) -> None:
        if event.seq is not None:
            self.plant.faults.happened(event.seq)


def _given_time(
    order: Callable[Concatenate["FirmwareFlyer", P], Awaitable[T]],
) -> Callable[Concatenate["FirmwareFlyer", P], Coroutine[Any, Any, T]]:
    """The order, for which the firmware is given some of its time."""

    async def timed(self: "FirmwareFlyer", /, *given: P.args, **named: P.kwargs) -> T:
        async with self.vehicle.going():
            return await order(self, *given, **named)

    return timed


@dataclass(kw_only=True)
class FirmwareFlyer(ExternalFlyer):
    """Flyer of a firmware on the simulated aircraft: truth from physics, belief from telemetry."""

    vehicle: FirmwareVehicle

    set_fence = _given_time(ExternalFlyer.set_fence)
    take_off = _given_time(ExternalFlyer.take_off)
    upload = _given_time(ExternalFlyer.upload)
    fly = _given_time(ExternalFlyer.fly)
    carry_out = _given_time(ExternalFlyer.carry_out)
    land = _given_time(ExternalFlyer.land)

    @property
    def t_ns(self) -> int:
        return self.vehicle.plant.t_ns

    def begin(self, plan: FlightPlan) -> None:
        """Begin the flight of a plan among others, from now on."""
        self._own: FlownTrack | None = None
        self.feed.reached_ns.clear()
        self.recorder.start(self.here(), goes_on=plan.goes_on)

    async def order(self, plan: FlightPlan) -> None:
        """Fly it to its end, and record how it waits for the others."""
        self._own = await self.fly(plan)
        self.recorder.start(self.here(), goes_on=not plan.stands or plan.goes_on)

    def end(self, plan: FlightPlan) -> FlownTrack:
        """Return the flight of a plan, which ends now, with the wait after it; of one that was lost
        what it had passed by its own word, and how it went on without a brain."""
        rest, own = self.recorder.finish(self.here(), self.battery_remaining), self._own
        if self.lost is not None:
            rest = self._fallen(rest)
        if own is not None:
            return replace(FlownTrack.joined([own, rest]), passages=own.passages)
        items = stop_items(plan)
        told = reported_in_turn(self.feed.reached_ns, items)
        count = max((n for n, t_ns in enumerate(told, 1) if t_ns is not None), default=0)
        stops = self.area.to_ned(plan.points_m, plan.alt_rel_m)
        hold_s = [stop.hold_s for stop in plan.stops]
        passed = self.find_passages(rest, stops[:count], items=items[:count], hold_s=hold_s[:count])
        missed = [None] * (len(items) - count)
        return replace(rest, passages=(*passed, *missed))

    def _fallen(self, flight: FlownTrack) -> FlownTrack:
        """A flight with the fall of the aircraft behind it, of which nobody believes anything."""
        fall = self.vehicle.clock.fall
        t_ns, places = [t_ns for t_ns, _ in fall], [place for _, place in fall]
        return replace(
            flight,
            t_ns=np.append(flight.t_ns, np.array(t_ns, dtype=np.int64)),
            true_ned_m=np.vstack((flight.true_ned_m, *places)),
            est_ned_m=np.vstack((flight.est_ned_m, *places)),
        )

    @property
    def lost(self) -> BaseException | None:
        """What has gone wrong with it; None: nothing."""
        return self.vehicle.failure()

    async def wait(self, until_ns: int) -> None:
        async with self.vehicle.going(until_ns + _TOLD_NS):
            await super().wait(until_ns)

    @property
    def battery_remaining(self) -> float:
        return self.vehicle.clock.truth.newest.battery.remaining

    async def refresh(self, needed: float) -> bool:
        """See `Flyer`; the battery is changed at once, as for the simulated vehicle."""
        return await Flyer.refresh(self, needed)

    async def _change_battery(self, needed: float) -> None:  # noqa: ARG002
        self.vehicle.clock.exchange_battery()


@dataclass(frozen=True)
class FirmwareBackend(Backend):
    """Backend of a real firmware on the simulated aircraft; opened once in a run."""

    plant: Plant  # on the ground at home

    @classmethod
    def of(cls, task: Task) -> Self:
        """Create the backend with the configured aircraft.

        Raises:
            InputError: one of its settings is refused.
        """
        area, streams = task.area, task.streams
        plant = plant_for(
            task.config.vehicle, home=area.home, streams=streams, obstacles=area.obstacles
        )
        return cls(task, plant)

    @property
    def name(self) -> str:
        """Of the firmware."""
        return NAMES[self.task.config.vehicle.autopilot]

    @property
    def position_source(self) -> str:
        name = self.name
        return f"simulated aircraft flown by {name}: truth from its physics, belief from {name}"

    @property
    def no_resume(self) -> str:
        return f"flights of {self.name} do not repeat to the last bit"

    def check(self) -> None:
        """Refuse a binary that cannot be started or is another's, and ports that are taken."""
        try:
            check_firmware(self.task.config.vehicle)
        except FirmwareSilentError as error:
            raise InputError(str(error)) from None
        super().check()

    def wired(self, attached: Attached, *, shared: ShareClock | None = None) -> "Wired":
        """The firmware, not started yet, in a folder of its own below the run's; `shared` as for
        `FirmwareVehicle`. Ground stations of `link.gcs` see it too."""
        config, raw_link = self.task.config, RawLink()
        takers: Takers = {}
        vehicle = FirmwareVehicle(
            config.vehicle,
            self.plant,
            attached.folder / FOLDER,
            [raw_link, *attached.links, *station_links(config.link)],
            mission_speed_mps=config.mission.speed_mps,
            speed=math.inf if config.link.speed == "max" else config.link.speed,
            hear=lambda name, fields: takers[name](fields) if name in takers else None,
            heard=_HEARD,
            shared=shared,
        )
        return Wired(vehicle, raw_link, takers)

    @asynccontextmanager
    async def open(self, attached: Attached) -> AsyncIterator[FirmwareFlyer]:
        """Start the firmware, which ends with the block, and connect a pilot to it.

        Raises:
            LinkLostError: a port cannot be had; the firmware cannot be started, dies or falls
                silent.
            FlightError: it cannot be flown: not ready in time, another program, a parameter of the
                configuration that it does not know.
        """
        wired, when = self.wired(attached), " at its start"
        try:
            async with wired.vehicle, self.flyer(wired, attached) as flyer:
                when = ""
                yield flyer
        except FirmwareError as error:
            raise error.in_words(f"{self.name}{when}: {error}") from None

    @asynccontextmanager
    async def flyer(self, wired: "Wired", attached: Attached) -> AsyncIterator[FirmwareFlyer]:
        """Connect a pilot to the firmware that was started; raises as `open`."""
        config, recorder, (vehicle, raw_link, takers) = self.task.config, FlightRecorder(), wired
        async with AsyncExitStack() as opened:
            async with vehicle.going():
                try:
                    pilot, feed = await opened.enter_async_context(
                        located(
                            config.link,
                            area=self.task.area,
                            observers=(recorder, Milestones(self.plant), *attached.observers),
                            say=attached.say,
                            raw_link=raw_link,
                            known=Known(
                                vehicle.clock.truth.at,
                                self.plant.faults.news,
                                takers,
                                vehicle.clock.truth.motors,
                                config.vehicle.control_rate_hz,
                            ),
                        )
                    )
                except NoVehicleError:
                    raise silent(wired, config) from None
                pilot.giving = partial(vehicle.clock.going, speed=1.0)
                await _check_program(pilot, config)
                limits = await limits_of(
                    pilot, feed, self.task.demand, adjusted=False, say=attached.say
                )
                speed_mps = min(config.mission.speed_mps, limits.speed_mps)
                flyer = FirmwareFlyer(
                    pilot,
                    feed,
                    recorder,
                    self.task.area,
                    config.mission.model_copy(update={"speed_mps": speed_mps}),
                    limits.guidance,
                    config.link,
                    attached.say,
                    vehicle=vehicle,
                )
                flyer.wind = config.vehicle.aircraft.wind
            yield flyer


class Wired(NamedTuple):
    """A firmware, the link of its pilot, and who takes the messages that are heard beside it."""

    vehicle: FirmwareVehicle
    link: RawLink
    takers: Takers


def silent(wired: Wired, config: RunConfig) -> FirmwareSilentError:
    """The error of a firmware that has not answered in time."""
    waited = f"it has not answered in {config.link.connect_timeout_s:g} s"
    return FirmwareSilentError(wired.vehicle.with_last_words(f"{waited} (link.connect_timeout_s)"))


async def _check_program(pilot: Pilot, config: RunConfig) -> None:
    """Raise FlightError unless this is the configured firmware and it took its parameters."""
    name = NAMES[config.vehicle.autopilot]
    if pilot.dialect.name != name:
        raise FlightError(
            f"vehicle.firmware.path = {config.vehicle.firmware.path}: this is "
            f"{pilot.dialect.name}, vehicle.autopilot asks for {name}"
        )
    for parameter, wanted in config.vehicle.firmware.parameters.items():
        has = await pilot.parameters.get(parameter)
        if has is None or not math.isclose(has, wanted, rel_tol=_SAME_PARAMETER, abs_tol=1e-9):
            said = "it knows no such parameter" if has is None else f"it has {has:g}"
            raise FlightError(
                f"vehicle.firmware.parameters.{parameter} = {wanted:g}: the firmware did not take "
                f"it: {said}"
            )
