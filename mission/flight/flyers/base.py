"""What each way to fly has: a flyer, to whom a run gives its orders, and a backend, which makes it.

A flyer takes orders in area coordinates and returns what was flown. Its backend refuses what cannot
work before anything is written, and gives the flyer for the time of a run.
"""

import socket
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from flightdyn.config import LimitsConfig, WindConfig
from flightdyn.random import RandomStreams
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.base.errors import FlightError, LinkLostError
from mission.config.models import MissionConfig, RunConfig
from mission.flight.missions.geofence import airspace_zones
from mission.flight.missions.plan_check import CheckedPath
from mission.flight.missions.plan_file import PlanFile
from mission.flight.missions.round_mission import Demand, FlightPlan, climb, direct_flight
from mission.flight.track import FlownTrack, TrackPoint
from mission.log.values import Zone
from mission.planner.performance import Performance
from mission.scenario.limits import performance_of
from sitl.autopilot.codec.orders import MissionItem
from sitl.links import Link
from sitl.observer import VehicleObserver

if TYPE_CHECKING:  # who flies nothing needs no MAVSDK
    from mission.flight.pilot.parameters import VehicleLimits

from mission.config.link import LinkConfig
from mission.config.preflight import signing_key
from sitl.autopilot.codec.wire import Seal
from sitl.links import network_link

HOLD_TIMEOUT_S = 3.0  # wall time for the last order of an interrupted flight
# Of a charge (0..1): what a battery just changed reads at least, and after take-off and the way to
# the round. More is never asked for.
CHARGED = 0.9

Say: TypeAlias = Callable[[str], None]


class Flyer(ABC):
    """Base class of a vehicle with its pilot: flies plans and returns the recorded flights."""

    area: Area
    mission: MissionConfig  # with the speed that the vehicle keeps
    guidance: LimitsConfig | None  # what it keeps to between stops; None: always at its speed

    wind: WindConfig | None = None  # that it flies in; None: still air, or nobody knows
    pace: float = 1.0  # how much longer it has taken than `guidance` would, in its flights so far
    _ordered_m: float | None = None  # height above home; None: the mission's lowest

    @property
    def performance(self) -> Performance:
        """Flight performance that plans assume: speed, guidance limits, wind and pace."""
        return performance_of(
            self.mission, self.area.home.alt_msl_m, self.guidance, wind=self.wind, pace=self.pace
        )

    @property
    @abstractmethod
    def t_ns(self) -> int:
        """The vehicle's time."""

    @abstractmethod
    def here(self) -> TrackPoint:
        """Truth and belief at this instant."""

    @abstractmethod
    async def set_fence(self, items: Sequence[MissionItem]) -> None:
        """Give the vehicle a fence, before the first take-off."""

    @abstractmethod
    async def take_off(self) -> None:
        """Climb from the ground to the hover above home."""

    @abstractmethod
    async def upload(self, plan: FlightPlan) -> None:
        """Upload a plan's stops; do nothing if the plan neither moves nor hovers.

        Where time cannot stand still the vehicle hovers meanwhile.
        """

    @abstractmethod
    async def fly(self, plan: FlightPlan) -> FlownTrack:
        """Fly what was uploaded; a plan that neither moves nor hovers is over at once."""

    @abstractmethod
    async def land(self) -> None:
        """Return to home and land."""

    async def carry_out(
        self,
        plan: PlanFile,  # noqa: ARG002  whoever flies uses them
        path: CheckedPath,  # noqa: ARG002
        *,
        begins: Callable[[], None],  # noqa: ARG002
    ) -> None:
        """Fly a plan file from the ground to the ground; call `begins` when its path begins.

        Raises:
            FlightError, LinkLostError: see `Pilot`.
        """
        raise FlightError("nothing flies here, so no plan file either")

    @property
    @abstractmethod
    def battery_remaining(self) -> float:
        """Charge of the battery, 0..1; NaN where it is not known."""

    @abstractmethod
    async def _change_battery(self, needed: float) -> None:
        """Have a battery well above `needed` (0..1); the vehicle stands at home."""

    async def refresh(self, needed: float) -> bool:
        """Change the battery where less than `needed` (0..1) is left; returns whether it was.

        Return, land, change it, take off and come back to where it was.

        Raises:
            FlightError: nobody changed it in time; the vehicle stands at home.
        """
        if not self.battery_remaining < needed:  # an unknown one is not
            return False
        back = self.area.from_ned(self.here().est_ned_m)
        await self.land()
        await self._change_battery(needed)
        self._ordered_m = None
        await self.take_off()
        await self.go_to(back)
        return True

    async def go_to(self, xy_m: Floats) -> None:
        """Fly to a point in area coordinates, or near it where it may not be flown; outside any
        round.

        Raises:
            FlightError: no way leads there.
        """
        start, space = self.area.from_ned(self.here().est_ned_m), self.area.airspace
        try:
            xy_m = space.moved(xy_m[None])[0]
            if float(np.linalg.norm(xy_m - start)) <= self.mission.acceptance_radius_m:
                return
            plan = direct_flight(
                start, xy_m, altitude_m=self.altitude_m, mission=self.mission, airspace=space
            )
        except ValueError as error:
            x, y = xy_m.tolist()
            raise FlightError(f"to ({x:.0f}, {y:.0f}) m in the area: {error}") from None
        await self.upload(plan)
        await self.fly(plan)

    @property
    def altitude_m(self) -> float:
        """The height above home that was ordered last."""
        return self.mission.heights_m[0] if self._ordered_m is None else self._ordered_m

    async def climb(self, altitude_m: float) -> None:
        """Climb or descend on the spot to a height above home, where it is another than before;
        outside any round."""
        if altitude_m == self.altitude_m:
            return
        plan = climb(self.area.from_ned(self.here().est_ned_m), altitude_m, mission=self.mission)
        self._ordered_m = altitude_m
        await self.upload(plan)
        await self.fly(plan)

    async def go_home(self) -> None:
        """Fly to above home if there are no-fly areas or a fence, which a return might cross."""
        if not self.area.airspace.is_open:
            await self.go_to(np.array(self.area.home_m))


@dataclass
class Fleet:
    """The aircraft of a run on one clock, by their numbers; the only one is a fleet, too."""

    aloft: dict[int, Flyer]  # those that are not lost

    @property
    def t_ns(self) -> int:
        """The time of all."""
        return next(iter(self.aloft.values())).t_ns

    async def fly(self, plans: Mapping[int, FlightPlan]) -> "Flights":
        """Fly what was uploaded to each, begun at one instant, until the last has finished. Who
        waits hovers, in its flight.

        Raises:
            FlightError, LinkLostError: of the only aircraft.
        """
        ((number, plan),) = plans.items()
        return Flights({number: await self.aloft[number].fly(plan)})


@dataclass(frozen=True)
class Flights:
    """What several aircraft have flown at once, by their numbers, and who was lost, and how."""

    flown: Mapping[int, FlownTrack]
    lost: Mapping[int, FlightError | LinkLostError] = field(default_factory=dict)


@dataclass(frozen=True)
class Task:
    """Configuration, area, random streams and demand of the flights of one aircraft of a run."""

    config: RunConfig
    area: Area
    streams: RandomStreams
    demand: Demand


@dataclass(frozen=True)
class Attached:
    """Observers, folder, messages and links of a flight."""

    observers: Sequence[VehicleObserver]
    folder: Path  # of the run
    say: Say  # hears what people should know of another autopilot than ours
    links: tuple[Link, ...] = ()  # of clients beside those of `link.gcs`; of a firmware


@dataclass(frozen=True)
class Backend(ABC):
    """Makes a run's flyer, after its checks before anything flies."""

    task: Task

    @property
    @abstractmethod
    def position_source(self) -> str:
        """Where the run's positions come from, for people."""

    @property
    def no_resume(self) -> str:
        """Why the run cannot be resumed, for people; empty where it can."""
        return ""

    def check(self) -> None:
        """Refuse what cannot work, before anything is written.

        Raises:
            LinkLostError: a port is taken.
            InputError: the firmware's binary is not there.
        """
        link = self.task.config.link
        if link.kind == "udp":
            _check_port("127.0.0.1", link.udp_port, f"link.udp_port = {link.udp_port}")
        elif link.kind == "external":
            check_url(link.url, "link.url")
        for url in link.gcs:
            check_url(url, "link.gcs")

    def await_vehicle(self, *, say: Say) -> "VehicleLimits | None":  # noqa: ARG002
        """Wait for a vehicle that must be there already; `say` hears what is waited for.

        Returns its own limits; None of one that keeps to the configuration's.

        Raises:
            LinkLostError, FlightError, InputError: it is not, or not where the devices are.
            KeyboardInterrupt: nobody wants to wait any longer.
        """
        return None

    def fence(self) -> tuple[Zone, ...]:
        """Return the fence zones that are known before the flight: the configured ones."""
        return airspace_zones(self.task.area)

    @abstractmethod
    def open(self, attached: Attached) -> AbstractAsyncContextManager[Flyer]:
        """A context manager that gives the flyer, and ends it with the block."""

    @property
    def each(self) -> "tuple[Backend, ...]":
        """The backend of each aircraft."""
        return (self,)

    @asynccontextmanager
    async def fleet(self, attached: Sequence[Attached]) -> AsyncIterator[Fleet]:
        """A context manager that gives all aircraft, with what is `attached` to each."""
        (only,) = attached
        async with self.open(only) as flyer:
            yield Fleet({0: flyer})


@dataclass(frozen=True)
class FleetBackend(Backend):
    """Backend of several aircraft: those of each, one task being that of the first."""

    several: tuple[Backend, ...]
    names: tuple[str, ...]  # of the aircraft

    @property
    def position_source(self) -> str:
        return "; ".join(dict.fromkeys(one.position_source for one in self.several))

    @property
    def no_resume(self) -> str:
        reasons = dict.fromkeys(one.no_resume for one in self.several)
        return "; ".join(reason for reason in reasons if reason)

    @property
    def each(self) -> tuple[Backend, ...]:
        return self.several

    def check(self) -> None:
        for one in self.several:
            one.check()

    def open(self, attached: Attached) -> AbstractAsyncContextManager[Flyer]:  # noqa: ARG002
        raise FlightError("several aircraft fly here, where one was asked for")


def check_url(url: str, key: str) -> None:
    """Raise LinkLostError if a link is to listen on a UDP port that is taken."""
    host, _, port = url.removeprefix("udpin://").rpartition(":")
    if url.startswith("udpin://") and port.isdecimal():
        _check_port(host, int(port), f"{key} = {url}")


def _check_port(host: str, port: int, what: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, port))
        except (OSError, OverflowError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise LinkLostError(f"{what}: cannot listen on this UDP port: {reason}") from None


def station_links(
    link: LinkConfig, urls: Mapping[str, int] | Sequence[str] | None = None
) -> list[Link]:
    """Return a link for each of `urls` (default: those of `link.gcs`), signed if there is a key.
    A mapping gives each URL its local port, 0 for any.

    Raises:
        InputError: the key cannot be read.
    """
    urls = link.gcs if urls is None else urls
    own = urls if isinstance(urls, Mapping) else {}
    key = None if link.signing_key is None else signing_key(link.signing_key)
    return [
        network_link(url, Seal(key, link_id=number) if key else None, own_port=own.get(url, 0))
        for number, url in enumerate(urls)
    ]
