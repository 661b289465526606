"""Many missions in a row and one long mission at the highest speed: time-outs, progress, memory.

One thing grows with one long mission, by some 0.56 kB a simulated second (2 MB an hour): the track,
which a flight hands back whole. Between rounds it begins anew.
"""

import asyncio
import logging
import os
from contextlib import suppress
from pathlib import Path

from flight_chain import Cost, Meter, configuration, hovering, zigzag
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync

from mission.base.errors import AerofedError
from mission.flight.flyers.built_in import BuiltInFlyer
from mission.flight.missions.round_mission import FlightPlan
from mission.planner.flyable import Stop
from sitl.observer import VehicleEvent, VehicleSample

_MISSION_M = 320.0
_WAIT_S = 0.1  # wall time for the last word on a mission's progress


def resident_mb() -> float:
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class Complaints(logging.Handler):
    """Counts what MAVSDK itself complains about: time-outs, lost and repeated messages."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.timeouts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep what speaks of time."""
        text = record.getMessage()
        if "timeout" in text.lower() or "timed out" in text.lower():
            self.timeouts.append(text)


class Progress:
    """The mission's progress as MAVSDK tells it."""

    def __init__(self, flyer: BuiltInFlyer) -> None:
        self._mission = MissionRawAsync(flyer.pilot.system)
        self.told: set[int] = set()

    async def follow(self) -> None:
        """Until cancelled."""
        async for progress in self._mission.subscribe_mission_progress():
            self.told.add(progress.current)

    async def missing(self, places: int) -> int:
        """How many steps of a mission of so many items did not come through; forgets them."""
        await asyncio.sleep(_WAIT_S)
        told, self.told = self.told, set()
        return len(set(range(1, places + 1)) - told)


class MemoryMeter:
    """A vehicle observer that notes the resident memory once a simulated minute."""

    def __init__(self) -> None:
        self.resident: list[float] = []
        self._due_ns = 0

    def sampled(self, sample: VehicleSample) -> None:
        """Note it when it is due."""
        if sample.t_ns >= self._due_ns:
            self._due_ns = sample.t_ns + 60_000_000_000
            self.resident.append(resident_mb())

    def happened(self, event: VehicleEvent) -> None:
        """Nothing to note."""


def onward(flyer: BuiltInFlyer, plan: FlightPlan) -> FlightPlan:
    """The plan, begun where the aircraft believes it is, as rounds are."""
    here = flyer.area.from_ned(flyer.here().est_ned_m)
    return FlightPlan(
        (Stop(here, ()), *plan.stops[1:]), plan.alt_rel_m, plan.speed_mps, plan.acceptance_m
    )


async def many_missions(count: int) -> None:
    """Fly `count` missions in one flight and print what went wrong."""
    complaints = Complaints()
    logger = logging.getLogger("mission.flight.pilot")
    logger.setLevel(logging.INFO)
    logger.addHandler(complaints)
    failures: list[str] = []
    unreached = untold = 0
    resident: list[float] = []
    costs: list[Cost] = []
    async with hovering() as flyer:
        progress = Progress(flyer)
        task = asyncio.create_task(progress.follow())
        plan = zigzag(configuration(), _MISSION_M)
        for _ in range(count):
            meter = Meter(lambda: flyer.t_ns)
            try:
                leg = onward(flyer, plan)
                await flyer.upload(leg)
                flight = await flyer.fly(leg)
            except AerofedError as error:
                failures.append(str(error))
                continue
            costs.append(meter.read())
            unreached += None in flight.passages
            untold += await progress.missing(len(plan.stops) + 1)  # and the speed item
            resident.append(resident_mb())
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
    sim_s, wall_s = sum(c.sim_s for c in costs), sum(c.wall_s for c in costs)
    cpu_s = sum(c.cpu_s for c in costs)
    print(f"missions flown          {len(costs)} of {count}, {len(plan.stops)} places each")
    print(f"failed                  {len(failures)} {failures[:3]}")
    print(f"MAVSDK time-outs        {len(complaints.timeouts)} {complaints.timeouts[:3]}")
    print(f"places not reached in   {unreached}")
    print(f"progress steps lost     {untold} of {len(costs) * (len(plan.stops) + 1)}")
    tenth = len(resident) // 10
    print(
        f"memory                  {resident[0]:.1f} MB after the first mission, "
        f"{resident[tenth]:.1f} after {tenth + 1}, {resident[-1]:.1f} after the last"
    )
    print(
        f"{sim_s:.0f} simulated seconds, uploads included: {sim_s / cpu_s:.0f}x real time by CPU, "
        f"{sim_s / wall_s:.0f}x by wall; load {os.getloadavg()[0]:.1f}"
    )


async def long_mission(length_m: float) -> None:
    """Fly one mission of `length_m` and print the memory on the way."""
    memory = MemoryMeter()
    async with hovering() as flyer:
        flyer.vehicle.add_observer(memory)
        meter = Meter(lambda: flyer.t_ns)
        plan = zigzag(configuration(), length_m)
        await flyer.upload(plan)
        flight = await flyer.fly(plan)
        cost = meter.read()
    found = memory.resident
    print(f"{flight.flown_m:.0f} m in {cost.sim_s:.0f} simulated seconds, one mission")
    points = {"start": 0, "a tenth": len(found) // 10, "middle": len(found) // 2, "end": -1}
    told = ", ".join(f"{name} {found[index]:.1f}" for name, index in points.items())
    track_mb = sum(a.nbytes for a in (flight.t_ns, flight.true_ned_m, flight.est_ned_m)) / 1e6
    print(f"memory in MB: {told}; the track handed back is {track_mb:.1f} MB of it")
    print(
        f"{cost.sim_s / cost.cpu_s:.0f}x real time by CPU, "
        f"{cost.sim_s / cost.wall_s:.0f}x by wall; load {os.getloadavg()[0]:.1f}"
    )
