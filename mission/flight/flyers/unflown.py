"""Nobody flies: every waypoint is met exactly, at the planned speed (the paper)."""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, replace

import numpy as np

from flightdyn.state import BatteryState, Kinematics
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.config.models import MissionConfig
from mission.flight.flyers.base import Attached, Backend, Fleet, FleetBackend, Flights, Flyer
from mission.flight.missions.round_mission import FlightPlan
from mission.flight.track import FlightRecorder, FlownTrack, TrackPoint
from sitl.autopilot.codec.orders import MissionItem
from sitl.observer import VehicleObserver, VehicleSample

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
FULL = BatteryState(voltage_v=0.0, current_a=0.0, consumed_mah=0.0, remaining=1.0)


@dataclass
class UnflownFlyer(Flyer):
    """Flyer without an aircraft: it is exactly on its plan in rounds, and jumps between them."""

    area: Area
    mission: MissionConfig
    observers: Sequence[VehicleObserver]
    guidance: None = None
    _t_ns: int = 0

    def __post_init__(self) -> None:
        self._ned_m = self.area.to_ned(np.array(self.area.home_m), 0.0)

    @property
    def t_ns(self) -> int:
        """Time by the planned speed; it stands still outside rounds."""
        return self._t_ns

    def here(self) -> TrackPoint:
        """Position on the plan, true and estimated alike."""
        return TrackPoint(self._t_ns, self._ned_m, self._ned_m)

    async def set_fence(self, items: Sequence[MissionItem]) -> None:
        """Do nothing: nobody has to be told."""

    async def take_off(self) -> None:
        """Be above home at once."""
        self._ned_m = self.area.to_ned(np.array(self.area.home_m), self.altitude_m)

    async def go_to(self, xy_m: Floats) -> None:
        """Move at once to a point (2,) in area coordinates, or to an allowed place close to it."""
        allowed_m = self.area.airspace.moved(xy_m[None])[0]
        self._ned_m = self.area.to_ned(allowed_m, self.altitude_m)

    async def climb(self, altitude_m: float) -> None:
        """Be at that height at once."""
        self._ordered_m = altitude_m
        self._ned_m = self.area.to_ned(self.area.from_ned(self._ned_m), altitude_m)

    async def land(self) -> None:
        """Do nothing: nothing of a landing is recorded."""

    @property
    def battery_remaining(self) -> float:
        """1, a full charge: nothing is used up."""
        return FULL.remaining

    async def _change_battery(self, needed: float) -> None:
        """Do nothing: it is always full."""

    async def upload(self, plan: FlightPlan) -> None:
        """Do nothing: nobody has to be told."""

    async def fly(self, plan: FlightPlan) -> FlownTrack:
        """Pass the stops one after another, and hover where the plan hovers."""
        recorder = FlightRecorder()
        recorder.start(self.here())
        passages: list[TrackPoint] = []
        for stop in plan.stops:
            there = self.area.to_ned(stop.xy_m, plan.alt_rel_m)
            leg_m = float(np.linalg.norm(there - self._ned_m))
            leg_s = leg_m / plan.speed_mps
            velocity = (there - self._ned_m) / leg_s if leg_s > 0.0 else np.zeros(3)
            self._move(there, leg_s, velocity, recorder)
            passages.append(self.here())
            if stop.hold_s > 0.0:
                self._move(there, stop.hold_s, np.zeros(3), recorder)
        flight = recorder.finish(self.here(), FULL.remaining)
        return replace(flight, passages=tuple(passages))

    def wait_until(self, t_ns: int, flight: FlownTrack) -> FlownTrack:
        """Hover where the flight has ended; returns it with the hover."""
        if t_ns <= self._t_ns:
            return flight
        recorder = FlightRecorder()
        recorder.start(self.here())
        self._move(self._ned_m, (t_ns - self._t_ns) / 1e9, np.zeros(3), recorder)
        hover = recorder.finish(self.here(), FULL.remaining)
        return replace(FlownTrack.joined([flight, hover]), passages=flight.passages)

    def _move(
        self, there: Floats, duration_s: float, velocity: Floats, recorder: FlightRecorder
    ) -> None:
        self._ned_m = there
        self._t_ns += round(1e9 * duration_s)
        # Observers hear of places as those that are flown to: at their heights above the globe.
        at = there + np.array([0.0, 0.0, self.area.frame.drop_m(*there[:2])])
        state = Kinematics(self._t_ns, at, velocity, LEVEL, np.zeros(3))
        sample = VehicleSample(
            t_ns=self._t_ns,
            truth=state,
            belief=state,
            gnss=None,
            battery=FULL,
            mode="NOT FLOWN",
            armed=False,
        )
        for observer in (recorder, *self.observers):
            observer.sampled(sample)


class UnflownFleet(Fleet):
    """Several that are not flown: each is on its plan, and waits for the last."""

    async def fly(self, plans: Mapping[int, FlightPlan]) -> Flights:
        flown = {number: await self.aloft[number].fly(plan) for number, plan in plans.items()}
        end_ns = max(flyer.t_ns for flyer in self.aloft.values())
        for number, flyer in self.aloft.items():
            assert isinstance(flyer, UnflownFlyer)
            flown[number] = flyer.wait_until(end_ns, flown[number])
        return Flights(flown)


class UnflownFleetBackend(FleetBackend):
    """Backend of several aircraft none of which is flown."""

    @asynccontextmanager
    async def fleet(self, attached: Sequence[Attached]) -> AsyncIterator[Fleet]:
        async with AsyncExitStack() as opened:
            each = zip(self.several, attached, strict=True)
            flyers = [await opened.enter_async_context(one.open(to)) for one, to in each]
            yield UnflownFleet(dict(enumerate(flyers)))


@dataclass(frozen=True)
class UnflownBackend(Backend):
    """Backend of a run in which nothing is flown: a plan, if there is one, is met exactly."""

    position_source = "nothing is flown: what is planned is met exactly, at the planned speed"

    def check(self) -> None:
        """Refuse nothing: no link is needed."""

    @asynccontextmanager
    async def open(self, attached: Attached) -> AsyncIterator[UnflownFlyer]:
        """Give the flyer that is always exactly on its plan."""
        yield UnflownFlyer(self.task.area, self.task.config.mission, attached.observers)
