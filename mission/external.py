"""An external autopilot with its pilot: orders in area coordinates in, flights out.

What is known of such a flight is what the autopilot itself believes: truth, belief and telemetry
are the same here, and time is the vehicle's own.
"""

import asyncio
import itertools
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress

import numpy as np
from numpy.typing import NDArray

from mission.area import Area
from mission.config import LinkConfig, MissionConfig
from mission.errors import AerofedError, FlightError, InputError, LinkLostError
from mission.flightplan import FlightPlan
from mission.flyer import HOLD_TIMEOUT_S, Flyer
from mission.pilot.connection import connect
from mission.pilot.feed import TelemetryFeed
from mission.pilot.items import stop_sequence
from mission.pilot.orders import Pilot
from mission.track import Flight, FlightRecorder, Passage
from sitl.observer import VehicleObserver

Floats = NDArray[np.float64]

FARTHEST_M = 5_000.0  # the vehicle from the area's home, before anything flies
FIRST_POSITION_S = 30.0  # wall time
_SHORT_M = 20.0  # braking at the end may take it beyond the acceptance radius
_ARRIVED_M = 1.0  # of the closest approach, where a hover follows


class ExternalFlyer(Flyer):
    """Flies stretches one after another; what was flown comes from telemetry."""

    def __init__(
        self,
        pilot: Pilot,
        feed: TelemetryFeed,
        recorder: FlightRecorder,
        *,
        area: Area,
        mission: MissionConfig,
    ) -> None:
        self.pilot, self.area, self.mission = pilot, area, mission
        self._feed, self._recorder = feed, recorder

    @property
    def t_ns(self) -> int:
        """The vehicle's time since the first position."""
        return self.here().t_ns

    def here(self) -> Passage:
        """The newest position."""
        here = self._feed.here
        if here is None:
            raise LinkLostError("the vehicle has not said yet where it is")
        return here

    async def take_off(self) -> None:
        """From the ground to the hover above where the vehicle stands."""
        await self.pilot.ready()
        if self.pilot.armed:
            raise FlightError("the vehicle is armed already: land and disarm it first")
        await self.pilot.take_off(self.mission.altitude_m)

    async def fly(self, plan: FlightPlan) -> Flight:
        """Fly the stops; a plan that neither moves nor hovers is over at once."""
        if plan.stands:
            here = self.here()
            return Flight.standing(here, {0: here}, self._feed.battery_remaining)
        self._recorder.start(self.here())
        self._feed.reached_ns.clear()
        await self.pilot.fly(plan, plan.positions(self.area))
        flight = self._recorder.finish(self.here(), self._feed.battery_remaining)
        stops = self.area.to_ned(plan.points_m, plan.alt_rel_m)
        short_m = float(np.linalg.norm(stops[-1, :2] - flight.true_ned_m[-1, :2]))
        if short_m > plan.acceptance_m + _SHORT_M:
            raise FlightError(
                f"the vehicle says that the mission is over, {short_m:.0f} m short of its end"
            )
        flight.reached.update(
            passages(
                flight,
                stops,
                reported_ns=[
                    self._feed.reached_ns.get(seq)
                    for seq in stop_sequence(plan, self.pilot.dialect)
                ],
                hovers=[stop.hold_s > 0.0 for stop in plan.stops],
                sequence=stop_sequence(plan),
            )
        )
        return flight

    async def land(self) -> None:
        """Back to home and down."""
        await self.pilot.land()

    async def refresh(self, reserve: float) -> bool:  # noqa: ARG002
        """Nobody here can change the battery of somebody else's vehicle; its failsafes watch it."""
        return False


def passages(
    flight: Flight,
    stops_ned_m: Floats,
    *,
    reported_ns: Sequence[int | None],
    hovers: Sequence[bool],
    sequence: Sequence[int],
) -> dict[int, Passage]:
    """When each stop (S, 3) was passed, by `sequence`: closest approach in the track.

    A stop is looked for after the one before it and until the vehicle reported the next one, so
    that a track that crosses itself is not mistaken; a hover was reached when it began. Reports
    may be lost: the flight is over, so every stop was passed.
    """
    found: dict[int, Passage] = {}
    after_ns = int(flight.t_ns[0])
    for index in range(len(stops_ned_m)):
        later = (t_ns for t_ns in reported_ns[index + 1 :] if t_ns is not None)
        until_ns = max(next(later, int(flight.t_ns[-1])), after_ns)
        instant = _closest(flight, stops_ned_m[index], after_ns, until_ns, hovers=hovers[index])
        found[sequence[index]] = flight.at(instant)
        after_ns = instant
    return found


def _closest(flight: Flight, stop: Floats, after_ns: int, until_ns: int, *, hovers: bool) -> int:
    """The instant in a window at which the track, straight between samples, is closest."""
    inside = (flight.t_ns > after_ns) & (flight.t_ns < until_ns)
    instants = np.concatenate(([after_ns], flight.t_ns[inside], [until_ns]))
    points = np.array([flight.at(int(t_ns)).true_ned_m[:2] for t_ns in instants]) - stop[:2]
    best_m, best_ns = float(np.linalg.norm(points[0])), after_ns
    nearest: list[tuple[float, int]] = [(best_m, best_ns)]
    for (a, b), (t_a, t_b) in zip(
        itertools.pairwise(points), itertools.pairwise(instants.tolist()), strict=True
    ):
        way = b - a
        square = float(way @ way)
        share = min(max(-float(a @ way) / square, 0.0), 1.0) if square > 0.0 else 0.0
        nearest.append((float(np.linalg.norm(a + share * way)), round(t_a + share * (t_b - t_a))))
    closest_m, instant = min(nearest)
    if hovers:
        return next(t_ns for away_m, t_ns in nearest if away_m <= closest_m + _ARRIVED_M)
    return instant


@asynccontextmanager
async def open_external(
    link: LinkConfig, *, mission: MissionConfig, area: Area, observers: Sequence[VehicleObserver]
) -> AsyncIterator[ExternalFlyer]:
    """Connect to the autopilot at `link.url`.

    A flight that ends otherwise than by landing is left holding its position.

    Raises:
        LinkLostError: no autopilot there in time, or one that does not say where it is.
        InputError: it is somewhere else than the area.
    """
    recorder = FlightRecorder()
    async with connect(
        link.url, stall_timeout_s=link.stall_timeout_s, timeout_s=link.connect_timeout_s
    ) as pilot:
        feed = TelemetryFeed(pilot, area=area, observers=(recorder, *observers))
        watch = asyncio.create_task(feed.watch())
        flyer = ExternalFlyer(pilot, feed, recorder, area=area, mission=mission)
        try:
            await feed.ask()
            await _locate(feed, area)
            yield flyer
        except (asyncio.CancelledError, AerofedError) as error:
            if pilot.armed and not isinstance(error, LinkLostError):
                with suppress(AerofedError, TimeoutError):
                    async with asyncio.timeout(HOLD_TIMEOUT_S):
                        await pilot.hold()
            raise
        finally:
            watch.cancel()
            with suppress(asyncio.CancelledError):
                await watch


async def look_at_vehicle(link: LinkConfig, *, mission: MissionConfig, area: Area) -> None:
    """Connect as for a flight, see that it could be flown, and part.

    Raises:
        LinkLostError, InputError: as `open_external`.
    """
    async with open_external(link, mission=mission, area=area, observers=()):
        pass


async def _locate(feed: TelemetryFeed, area: Area) -> None:
    """Wait for the first position, and see that it is where the devices are."""
    try:
        async with asyncio.timeout(FIRST_POSITION_S):
            place = await feed.first
    except TimeoutError:
        raise LinkLostError(
            f"the vehicle has not said in {FIRST_POSITION_S:g} s where it is"
        ) from None
    away = area.frame.to_ned(place.lat_deg, place.lon_deg, place.alt_msl_m)
    away_m = float(np.linalg.norm(away))
    if away_m > FARTHEST_M:
        raise InputError(
            f"the vehicle stands {away_m / 1e3:.0f} km from the area: set area.home_lat_deg and "
            f"area.home_lon_deg near {place.lat_deg:.4f}, {place.lon_deg:.4f}, or move the vehicle"
        )
