"""Connection to an autopilot that can be flown: it answers, and its position is near the area."""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass

import numpy as np

from flightdyn.plant import Plant
from mission.base.area import Area
from mission.base.errors import FlightError, InputError
from mission.config.models import LinkConfig
from mission.flight.flyers.flyers import Say
from mission.flight.pilot.connection import connect
from mission.flight.pilot.feed import Known, TelemetryFeed
from mission.flight.pilot.pilot import Pilot
from sitl.block import following
from sitl.links import RawLink
from sitl.observer import VehicleEvent, VehicleObserver, VehicleSample

FARTHEST_M = 5_000.0  # the vehicle from the area's home, before anything flies
PATIENT_S = 3.0  # wall time before people are told what is waited for
_AIRBORNE_M = 0.5
POLL_S = 0.05  # wall time between looks at what telemetry has said


@dataclass(frozen=True)
class Milestones:
    """`VehicleObserver` that tells the plant of the events after which its faults may begin."""

    plant: Plant

    def sampled(self, sample: VehicleSample) -> None:
        if sample.armed:
            self.plant.happened("arming")
        if sample.truth.alt_rel_m > _AIRBORNE_M:
            self.plant.happened("take-off")

    def happened(self, event: VehicleEvent) -> None:
        if event.seq is not None:
            self.plant.happened(event.seq)


@asynccontextmanager
async def located(
    link: LinkConfig,
    *,
    area: Area,
    observers: Sequence[VehicleObserver],
    say: Say,
    raw_link: RawLink | None = None,
    known: Known | None = None,
) -> AsyncIterator[tuple[Pilot, TelemetryFeed]]:
    """Context manager: connect to a vehicle, wait for its position, give its pilot and feed.

    It is at the other end of `raw_link` where one is given, else at `link.url`.

    Raises:
        LinkLostError: no autopilot there in time.
        FlightError: it does not come to know where it is.
        InputError: it is farther than `FARTHEST_M` from the area's home.
    """
    async with connect(
        raw_link or link.url,
        stall_timeout_s=link.stall_timeout_s,
        timeout_s=link.connect_timeout_s,
    ) as pilot:
        feed = TelemetryFeed(pilot, area=area, observers=observers, known=known)
        pilot.clock = lambda: feed.now_s
        async with following(feed.watch(), name="telemetry feed"):
            await feed.ask()
            await _locate(feed, area, timeout_s=link.ready_timeout_s, say=say)
            yield pilot, feed


async def _locate(feed: TelemetryFeed, area: Area, *, timeout_s: float, say: Say) -> None:
    """Wait for the first valid position; refuse one beyond `FARTHEST_M` from the area's home."""
    said = asyncio.get_running_loop().call_later(
        PATIENT_S, lambda: say(f"waiting for the vehicle's position ({feed.readiness.missing})")
    )
    try:
        async with asyncio.timeout(timeout_s):
            place = await feed.first
    except TimeoutError:
        raise FlightError(
            f"the vehicle has not come to know in {timeout_s:g} s where it is "
            f"(link.ready_timeout_s): {feed.readiness.missing or 'it sends no position'}"
        ) from None
    finally:
        said.cancel()
    away = area.frame.to_ned(place.lat_deg, place.lon_deg, place.alt_msl_m)
    away_m = float(np.linalg.norm(away))
    if away_m > FARTHEST_M:
        raise InputError(
            f"the vehicle stands {away_m / 1e3:.0f} km from the area: set area.home_lat_deg and "
            f"area.home_lon_deg near {place.lat_deg:.4f}, {place.lon_deg:.4f}, or move the vehicle"
        )


async def until_ready(pilot: Pilot, feed: TelemetryFeed, *, timeout_s: float) -> None:
    """Wait until the vehicle knows where it is and says that it can be armed.

    Raises:
        FlightError: not in time; says what is missing.
    """
    try:
        async with asyncio.timeout(timeout_s):
            await until(lambda: not feed.readiness.missing and pilot.watch.armable)
    except TimeoutError:
        said = pilot.watch.last_warning
        why = feed.readiness.missing or (f"it said: {said}" if said else "it does not say why")
        raise FlightError(
            f"the vehicle cannot be armed after {timeout_s:g} s (link.ready_timeout_s): {why}"
        ) from None


async def until(met: Callable[[], bool]) -> None:
    """Wait for a condition that telemetry may meet."""
    while True:
        if met():
            return
        await asyncio.sleep(POLL_S)
