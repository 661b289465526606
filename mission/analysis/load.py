"""A run read back: from its folder, or from its log alone; a killed one as far as it came."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fl.plugin_code import label_of
from mission.base import polyline
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.base.interrupted_files import InterruptedFiles
from mission.base.run_folder import RunFolder, RunSummary
from mission.base.user_files import read_json
from mission.log import DamagedLogError
from mission.log.contents import load_damaged
from mission.log.reader import decode, read_log
from mission.log.records import UNKNOWN_ROUND, RoundRecord
from mission.log.values import NS_PER_S, BatteryTrack, EventRecord, FlightData, Track

if TYPE_CHECKING:
    from mission.analysis.passes import Judged

_FINISHED = "finished"
FOREIGN = (".ulg", ".bin", ".tlog")  # logs of PX4, of ArduPilot, of ground stations


@dataclass(frozen=True)
class LoadedRun:
    """A run read back: its log, its summary, and whether it was finished."""

    path: Path
    data: FlightData
    summary: RunSummary  # empty for a bare log, or a folder without one
    cut: bool  # its log has no end: the writer was killed, or is still at work
    judged: "Judged | None" = None  # a flight that is no run: what was matched with its plan
    unjudged: str = ""  # or why nothing was

    @property
    def name(self) -> str:
        """What the run is called in tables and figures: its folder, or its file."""
        return self.path.name or str(self.path.resolve().name)

    @property
    def about(self) -> str:
        """Which run it is, with strategy or plan file, and seed: a line for pictures."""
        config, plan_file = self.data.config, self.data.plan_file
        known = {**config.get("mission", {}), **config, **self.summary}
        keys = ("strategy", "seed") if plan_file is None else ("seed",)
        facts = [f"{key} {label_of(str(known[key]))}" for key in keys if key in known]
        source = [] if plan_file is None else [f"plan {plan_file.source}"]
        if self.judged is not None and self.data.source.only is not None:
            source.append(f"{self.data.source.only} positions only")
        return " · ".join([self.name, *facts, *source])

    @property
    def state(self) -> str:
        """Why the run is not finished; empty for one that is."""
        status = str(self.summary.get("status", _FINISHED))
        words = {_FINISHED: "", "running": "not finished: it was killed, or is still under way"}
        error = f" ({self.summary['error']})" if "error" in self.summary else ""
        return words.get(status, status) + error

    @property
    def notice(self) -> str:
        """What a reader has to know of a run that is not finished; empty for one that is."""
        if not self.state:
            return ""
        if not (self.summary.get("resumable") and RunFolder(self.path).resumable):
            return f"{self.state}; this is what was flown"
        count = len(self.data.rounds)
        done = f"{count} {'round of it is' if count == 1 else 'rounds of it are'} here"
        return f"{self.state}; {done}; aerofed run --resume {self.path} goes on"


def load_run(path: Path, plan: Path | None = None, *, believed: bool = False) -> LoadedRun:
    """A run's folder or a log file by itself, of ours or of another program.

    Of a run that was killed, or is still under way, everything that was flushed is read. A flight
    that is no run is matched with `plan`, a plan file, or else with the missions in its log.
    `believed` takes the positions that the autopilot believed also where the true ones are known.

    Raises:
        InputError: neither; the folder has no log; the log is damaged, or of no kind that is known;
            the plan cannot be read, or is of another place.
    """
    loaded = _load(path)
    data = loaded.data
    if believed and data.source.only is None:
        data = replace(data, truth=data.belief, source=replace(data.source, only="believed"))
    if plan is None and (data.rounds or data.plan_file is not None or path.is_dir()):
        return replace(loaded, data=data)
    # Only for such flights: pymavlink takes half a second to import.
    from mission.analysis.passes import Plan, judged
    from mission.flight.plan_file import read_plan_file

    given = None if plan is None else Plan(plan.name, read_plan_file(plan).items, logged=False)
    try:
        found = judged(path, data, given)
    except InputError as error:
        if plan is not None:
            raise
        return replace(loaded, data=data, unjudged=str(error))
    return replace(loaded, data=found.data, judged=found)


def _load(path: Path) -> LoadedRun:
    if path.is_file():
        if path.suffix.lower() in FOREIGN:
            from mission.flight.logs.reading import read_flight

            return LoadedRun(path, read_flight(path), {}, cut=False)
        return LoadedRun(path, _with_its_flight(read_log(path)), {}, cut=False)
    if not path.is_dir():
        raise InputError(f"{path}: no such run folder or log file")
    folder = RunFolder(path)
    # A resumed run keeps its longer log until it has caught up with it.
    kept = InterruptedFiles(folder).path / folder.log.name
    log = kept if kept.is_file() else folder.log
    if not log.is_file():
        raise InputError(f"{path}: not a run folder: it has no {log.name}")
    summary = _summary(folder.summary)
    try:
        return LoadedRun(path, _with_its_flight(read_log(log)), summary, cut=False)
    except DamagedLogError:
        if summary.get("status", _FINISHED) == _FINISHED:
            raise
    data = _with_its_flight(_whole_rounds(decode(load_damaged(log))))
    return LoadedRun(path, data, summary, cut=True)


def reached(run: FlightData) -> dict[int, EventRecord]:
    """The first passage of each place of a plan file that was reached, by number of the item."""
    places = run.plan_file.places_m if run.plan_file else {}
    passed: dict[int, EventRecord] = {}
    for event in run.events:
        if event.kind == "reached" and event.seq is not None and event.seq in places:
            passed.setdefault(event.seq, event)
    return passed


def arrival(run: FlightData) -> EventRecord | None:
    """When the last place of a plan file was reached, for the last time that it leads there."""
    order = run.plan_file.order if run.plan_file else ()
    passed = [e for e in run.events if e.kind == "reached" and order and e.seq == order[-1]]
    visits = order.count(order[-1]) if order else 1
    return passed[visits - 1] if len(passed) >= visits else None


def flown(run: FlightData, record: RoundRecord, *, track: Track | None = None) -> Track:
    """The part of the true track (or of `track`) that belongs to a round."""
    start_ns = round(record.start_t_s * 1e9)
    end_ns = round((record.start_t_s + record.duration_s) * 1e9)
    return (track or run.truth).between(start_ns, end_ns)


def ground_speed(track: Track) -> Floats:
    """(n,) m/s of each sample, by the true positions beside it."""
    if len(track.t_ns) < 2:
        return np.zeros(len(track.t_ns))
    velocity = np.gradient(track.pos_m[:, :2], track.t_ns / NS_PER_S, axis=0)
    return np.asarray(np.linalg.norm(velocity, axis=1), dtype=np.float64)


def _whole_rounds(data: FlightData) -> FlightData:
    """The data without the records of a last round that did not end."""
    ended = {record.round for record in data.rounds}
    return replace(data, uplinks=tuple(item for item in data.uplinks if item.round in ended))


def _with_its_flight(data: FlightData) -> FlightData:
    """A plan file's flight as a round that serves nobody: to its last place, or as far as it came.

    No round where the vehicle never got as far as its mission.
    """
    if data.config.get("link", {}).get("kind") == "external":
        data = replace(data, source=replace(data.source, only="believed"))
    if data.plan_file is None or not data.plans or not len(data.truth.t_ns):
        return data
    plan = data.plans[0]
    last = arrival(data)
    end_ns = int(data.truth.t_ns[-1]) if last is None else last.t_ns
    track = data.truth.between(plan.t_ns, end_ns)
    if not len(track.t_ns):
        return data
    flown_m = polyline.length(track.pos_m[:, :2])
    battery, energy_j = data.battery.remaining, _energy_j(data.battery, plan.t_ns, end_ns)
    record = replace(
        UNKNOWN_ROUND,
        round=plan.round,
        start_t_s=plan.t_ns / NS_PER_S,
        duration_s=(end_ns - plan.t_ns) / NS_PER_S,
        plan_path_m=plan.path_m,
        flown_path_m=flown_m,
        budget_used_m=flown_m,
        time_used_s=(end_ns - plan.t_ns) / NS_PER_S,
        energy_j=energy_j,
        energy_used_j=energy_j,
        battery_remaining=float(battery[-1]) if len(battery) else math.nan,
    )
    return replace(data, plans=(plan,), rounds=(record,))


def _energy_j(battery: BatteryTrack, start_ns: int, end_ns: int) -> float:
    """What the battery gave in a time; NaN where nobody knows."""
    during = (battery.t_ns >= start_ns) & (battery.t_ns <= end_ns)
    charge_mah, voltage_v = battery.consumed_mah[during], battery.voltage_v[during]
    energy_j = float((np.diff(charge_mah) * 3.6 * voltage_v[1:]).sum())
    return energy_j if energy_j > 0.0 else math.nan


def _summary(path: Path) -> RunSummary:
    if not path.is_file():
        return {}
    summary: RunSummary = read_json(path)
    if not isinstance(summary, dict):
        raise InputError(f"{path}: not a run's summary")
    return summary
