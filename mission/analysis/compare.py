"""Planned against flown: how far a run's flights were from their plans, and what it cost.

Errors are measured on the true track; what the autopilot believed has its own numbers. Corner
cutting is flown on purpose (the autopilot may cut a corner by its acceptance radius), so errors on
straights and at corners stand apart.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mission.analysis.holes import Hole
from mission.analysis.load import LoadedRun
from mission.analysis.measure import Leg, Measured, legs, measure, measure_pass
from mission.analysis.numbers import OF_PLAN, Comparison, Made, Told, told_numbers
from mission.analysis.spikes import spikes
from mission.analysis.told import FlightErrors, Stretch, Values, missing
from mission.analysis.whole import whole_flight
from mission.base.area import on_globe
from mission.base.arrays import mean
from mission.base.errors import InputError, NoFlightError
from mission.base.run_folder import VEHICLE
from mission.base.tables import annotated
from mission.log.records import LATE
from mission.log.values import NS_PER_S, FlightData


@dataclass(frozen=True)
class DeviceComparison:
    """One device over a run; means over the rounds in which it was scheduled and had something to
    send (`est_per`: and its slot was reached), NaN if never."""

    device: int
    community: str
    scheduled: int
    delivered: int
    late: int
    plan_per: float
    est_per: float
    true_per: float


@dataclass(frozen=True)
class RunComparison:
    """One run: every round, all of them together, and device by device."""

    run: LoadedRun
    measured: tuple[Measured, ...]  # round by round, what its numbers are made of
    rounds: tuple[Comparison, ...]
    total: Comparison
    devices: tuple[DeviceComparison, ...]
    flown: FlightErrors | None = (
        None  # against what the vehicle was told; None: it never left the ground
    )
    outside: tuple[Hole, ...] = ()  # holes of a flight without a pass

    @property
    def legs(self) -> tuple[Leg, ...]:
        """Legs of every pass through a mission, in order; none for a run."""
        return tuple(leg for measured in self.measured for leg in legs(measured))

    @property
    def holes(self) -> tuple[Hole, ...]:
        """Holes in the positions of every pass or round, in order."""
        by_start = {hole.start_s: hole for measured in self.measured for hole in measured.holes}
        return (*by_start.values(), *self.outside)

    @property
    def stretches(self) -> list[dict[str, Any]]:
        """A row a stretch of the flight: its errors against what was told, and its health."""
        return [self._stretch(item) for item in (self.flown.stretches if self.flown else ())]

    def _stretch(self, item: Stretch) -> dict[str, Any]:
        numbers, worst = told_numbers(item.series), {}
        for name, how in annotated(Comparison, Told):
            at_s = how.worst_s(item.series[how.of]) if how.of in item.series else math.nan
            if "tracking_max" in name and not math.isnan(at_s):
                worst[name] = {"t_s": at_s, **self.place(at_s)}
        for name, (of, by) in OF_PLAN.items():
            numbers[name] = by(item.series[of].values) if of in item.series else math.nan
        row = {key: value for key, value in vars(item).items() if key != "series"}
        return {**row, **numbers, "worst": worst}

    def place(self, at_s: float) -> dict[str, float]:
        """Where the vehicle was at an instant: latitude, longitude, and height above home."""
        data = self.run.data
        ((x, y, z),) = data.truth.at(np.array([round(at_s * NS_PER_S)])).pos_m.tolist()
        (place,) = on_globe(data.area, np.array([[x, y]]), z)
        return {"lat_deg": place.lat_deg, "lon_deg": place.lon_deg, "height_m": z}

    @property
    def values(self) -> dict[str, object]:
        """What `aerofed compare --json` prints."""
        judged, data = self.run.judged, self.run.data
        flown = self.flown
        of_a_flight: dict[str, object] = (
            {} if flown is None else {"stretches": self.stretches, "steps": flown.steps}
        )
        if data.planned is not None:
            of_a_flight |= {"log": data.source, "not_in_the_log": missing(data)}
        if judged is not None:
            of_a_flight |= {
                "plan": data.planned.source if data.planned else "",
                "not_compared_s": judged.apart,
                "items_left_out": judged.left_out,
                "legs": self.legs,
                "spikes": spikes(data, self.measured),
            }
        return {
            "source": self.run.path,
            "rounds": self.rounds,
            "total": self.total,
            "devices": self.devices,
            "holes": self.holes,
            **of_a_flight,
        }


def compare_run(loaded: LoadedRun, *, rounds: int | None = None) -> RunComparison:
    """Compare every finished round of a run with its plan, or those up to number `rounds`.

    Raises:
        InputError: a run in which no round was flown.
    """
    run = loaded.data
    if rounds is not None:
        run = replace(
            run,
            rounds=tuple(item for item in run.rounds if item.round <= rounds),
            uplinks=tuple(item for item in run.uplinks if item.round <= rounds),
        )
    plans = {plan.round: plan for plan in run.plans}
    records = [record for record in run.rounds if record.round in plans]
    if loaded.judged is None:
        measured = [
            measure(loaded.path, loaded.data, record, plans[record.round]) for record in records
        ]
    else:
        passes = loaded.judged.passes[: len(records)]
        measured = [measure_pass(loaded.data, found) for found in passes]
    try:
        flown, whole = whole_flight(loaded, measured)
    except InputError:
        if loaded.unjudged:
            raise
        flown, whole = None, {}
    if not measured and not loaded.unjudged:
        why = f": {loaded.notice}" if loaded.notice else ""
        raise NoFlightError(
            f"{loaded.path}: no round was flown, so there is nothing to compare{why}"
        )
    series = {} if flown is None else flown.series
    cut = rounds is not None and measured
    some = _during(series, -math.inf, _end_s(measured[-1])) if cut else series
    total = _made(measured, None, some)
    return RunComparison(
        run=loaded,
        measured=tuple(measured),
        rounds=tuple(
            _made([item], item.record.round, _during(series, item.record.start_t_s, _end_s(item)))
            for item in measured
        ),
        total=total if measured else replace(total, **whole),
        devices=tuple(
            _device(run, device, community)
            for device, community in enumerate(run.devices.community)
        ),
        flown=flown,
        outside=() if measured or flown is None else flown.holes,
    )


def _end_s(item: Measured) -> float:
    return item.record.start_t_s + item.record.duration_s


def _during(series: Mapping[str, Values], since_s: float, until_s: float) -> dict[str, Values]:
    return {name: of.between(since_s, until_s) for name, of in series.items()}


def _device(run: FlightData, device: int, community: str) -> DeviceComparison:
    uplinks = [item for item in run.uplinks if item.device == device]
    sent = [item for item in uplinks if item.outcome != LATE]
    return DeviceComparison(
        device=device,
        community=community,
        scheduled=len(uplinks),
        delivered=sum(item.delivered for item in uplinks),
        late=len(uplinks) - len(sent),
        plan_per=mean(np.array([item.plan_per for item in sent])),
        est_per=mean(np.array([i.est_per for i in sent if math.isfinite(i.slot_t_s)])),
        true_per=mean(np.array([item.true_per for item in sent])),
    )


def _made(
    items: Sequence[Measured], number: int | None, series: Mapping[str, Values]
) -> Comparison:
    made: dict[str, Any] = {
        name: how.by(items) if items else math.nan for name, how in annotated(Comparison, Made)
    }
    return Comparison(round=number, **made, **told_numbers(series))


def names_of(comparisons: Sequence[RunComparison]) -> list[str]:
    """Return names of the runs, with as many parent folders as tell them apart; logs of vehicles
    of one world have the names of their folders, where each has one."""
    paths = [item.run.path.resolve().parts for item in comparisons]
    folders = [path[-2] for path in paths if path[-2].startswith(VEHICLE)]
    if len({*folders}) == len(paths):
        return folders
    return ["/".join(path[-_telling(path, paths) :]) for path in paths]


def _telling(path: tuple[str, ...], others: Sequence[tuple[str, ...]]) -> int:
    counts = range(1, len(path))
    alike = {n: sum(other[-n:] == path[-n:] for other in others) for n in counts}
    return min(counts, key=lambda n: (alike[n], n), default=1)
