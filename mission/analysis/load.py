"""A run read back: from its folder, or from its log alone; a killed one as far as it came."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from fl.plugin_code import label_of
from mission.base.errors import InputError, NoFlightError
from mission.base.run_folder import VEHICLE, RunFolder, RunSummary
from mission.base.user_files import read_json
from mission.log import SPOILT, DamagedLogError, ForeignLogError
from mission.log.contents import load_damaged
from mission.log.reader import decode, read_log
from mission.log.records import RoundRecord
from mission.log.values import HEIGHTS, FlightData, PlannedPlaces, Track

if TYPE_CHECKING:
    from mission.analysis.passes import Judged

_FINISHED = "finished"
_READ = "folders of runs, .mcap logs, .ulg of PX4, .bin of ArduPilot, .tlog of ground stations"
FOREIGN = (".ulg", ".bin", ".tlog")  # logs of PX4, of ArduPilot, of ground stations


@dataclass(frozen=True)
class LoadedRun:
    """A run read back: its log, its summary, and whether it was finished."""

    path: Path
    data: FlightData
    summary: RunSummary  # empty for a bare log, or a folder without one
    judged: "Judged | None" = None  # a flight that is no run: what was matched with its plan
    unjudged: str = ""  # or why nothing was

    @property
    def name(self) -> str:
        """What the run is called in tables and figures: its folder, or its file."""
        return self.path.name or str(self.path.resolve().name)

    @property
    def about(self) -> str:
        """Which run it is, with strategy or plan file, and seed: a line for pictures."""
        config, planned = self.data.config, self.data.planned
        known = {**config.get("mission", {}), **config, **self.summary}
        keys = ("strategy", "seed") if planned is None else ("seed",)
        facts = [f"{key} {label_of(str(known[key]))}" for key in keys if key in known]
        source = [f"plan {planned.source}"] if planned is not None and planned.source else []
        if planned is not None and self.data.source.only is not None:
            kind = self.data.source.only
            source.append("heights only" if kind == HEIGHTS else f"{kind} positions only")
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
        """Notice that a run is not finished, and how to resume it; empty if it is finished."""
        if not self.state:
            return ""
        if not (self.summary.get("resumable") and RunFolder(self.path).resumable):
            return f"{self.state}; this is what was flown"
        count = len(self.data.rounds)
        done = f"{count} {'round of it is' if count == 1 else 'rounds of it are'} here"
        return f"{self.state}; {done}; aerofed run --resume {self.path} goes on"


def load_run(path: Path, plan: Path | None = None, *, believed: bool = False) -> LoadedRun:
    """Load a run from its folder, or a flight from a log file of ours or of another program.

    Of a run that was killed, or is still under way, everything that was flushed is read. A flight
    that is no run is matched with `plan`, a plan file, or else with the missions in its log.
    `believed` takes the positions that the autopilot believed also where the true ones are known.

    Raises:
        InputError: no such path; the folder has no log; the log is damaged, or of an unknown kind;
            the plan cannot be read, or is of another place.
    """
    loaded = _load(path)
    data = loaded.data
    external = data.config.get("link", {}).get("kind") == "external"
    if (believed or external) and data.source.only is None:
        data = replace(data, truth=data.belief, source=replace(data.source, only="believed"))
    if plan is None and (data.rounds or data.devices.community):
        return replace(loaded, data=data)
    # Only for such flights: pymavlink and the vehicle's rules take 130 ms to import.
    from mission.analysis.passes import Plan, judged
    from mission.flight.missions.plan_file import read_plan_file

    given = None if plan is None else Plan(plan.name, read_plan_file(plan).items, logged=False)
    try:
        found = judged(path, data, given)
    except InputError as error:
        if plan is not None:
            raise
        data = replace(data, planned=PlannedPlaces("", {}, (), frozenset()))
        return replace(loaded, data=data, unjudged=str(error))
    return replace(loaded, data=found.data, judged=found)


def load_flights(
    path: Path, plan: Path | None = None, *, believed: bool = False, together: bool = False
) -> tuple[list[LoadedRun], list[tuple[Path, InputError]], list[str]]:
    """Load a run or a log, or all logs of a folder, as `load_run`: those to compare, and why others
    of the folder are not: they cannot be read, or have no mission, as some have. Of flights that
    are judged `together` none is left out for the latter.

    Raises:
        InputError: as `load_run`, of the first log, where none can be read.
    """
    loaded, refused = list[LoadedRun](), list[tuple[Path, InputError]]()
    for each in _flights_in(path):
        try:
            loaded.append(load_run(each, plan, believed=believed))
        except InputError as error:
            refused.append((each, error))
    if not loaded:
        raise refused[0][1]
    if together:
        return loaded, refused, []
    judged = [flight for flight in loaded if not flight.unjudged]
    apart = [flight.unjudged for flight in loaded if flight.unjudged and judged]
    return judged or loaded, refused, apart


def vehicles_of(path: Path) -> list[Path]:
    """The folders of the vehicles of one world, `vehicle-1` and on, in a folder; else none."""
    found = (each for each in path.glob(f"{VEHICLE}*") if each.is_dir())
    return sorted(found, key=lambda each: (len(each.name), each.name))


def _flights_in(path: Path) -> list[Path]:
    """Return a folder's flight logs, by name; the path alone if it is a run, a file or has none."""
    if not path.is_dir() or RunFolder(path).log.is_file():
        return [path]
    if vehicles := vehicles_of(path):
        named = [path / name for name in summary_in(path).get("vehicles") or ()]
        gone = [vehicle for vehicle in named if not vehicle.exists()]  # which is an error to load
        return [*(log for vehicle in vehicles for log in _flights_in(vehicle)), *gone]
    logs = (file for file in path.iterdir() if file.suffix.lower() in (".mcap", *FOREIGN))
    return sorted(logs) or [path]


def _load(path: Path) -> LoadedRun:
    if path.is_file():
        if path.suffix.lower() in FOREIGN:
            return LoadedRun(path, _read_flight(path), {})
        try:
            return LoadedRun(path, read_log(path), {})
        except ForeignLogError as error:
            if path.suffix.lower() == ".mcap":
                raise
            raise InputError(f"{error}; what is read: {_READ}") from None
    if not path.is_dir():
        wrong = "neither a folder nor a file" if path.exists() else "no such run folder or log file"
        raise InputError(f"{path}: {wrong}")
    folder = RunFolder(path)
    # A resumed run keeps its longer log until it has caught up with it.
    kept = folder.kept / folder.log.name
    log = kept if kept.is_file() else folder.log
    if not log.is_file():
        raise no_log_in(path)
    summary = summary_in(path)
    try:
        return LoadedRun(path, read_log(log), summary)
    except DamagedLogError:
        if summary.get("status", _FINISHED) == _FINISHED:
            raise
    return LoadedRun(path, _whole_rounds(decode(load_damaged(log))), summary)


def no_log_in(path: Path) -> InputError:
    """Return the error of a folder that has no log of its own, with one that may be meant."""
    first, name, others = _flights_in(path)[0], RunFolder(path).log.name, ", nor another flight log"
    if first != path:
        others = f"; give one of its logs, as {first}"
    elif runs := [*path.glob(f"*/{name}"), *path.glob(f"*/*/{name}")]:  # a sweep, say
        others = f"; give one of its runs, as {min(runs).parent}"
    return NoFlightError(f"{path}: not a run folder: it has no {name}{others}")


def _read_flight(path: Path) -> FlightData:
    """A flight of a PX4 ULog (.ulg), an ArduPilot DataFlash log (.bin) or a telemetry log (.tlog).

    Raises:
        InputError: it cannot be read, is none, or holds no flight.
    """
    kind = path.suffix.lower()
    if not path.stat().st_size:
        raise InputError(f"{path}: the file is empty")
    try:  # pymavlink takes 90 ms, which nobody waits for who has a log of ours
        if kind == ".ulg":
            from mission.flight.logs.ulog import KIND
        elif kind == ".bin":
            from mission.flight.logs.dataflash import KIND
        else:
            from mission.flight.logs.tlog import KIND
        return KIND.flight(path)
    except (*SPOILT, MemoryError) as error:  # for what a broken one says that it holds
        what = " ".join(str(error).split())[:100]
        raise InputError(
            f"{path}: cannot be read as a {kind} flight log: damaged, cut off, "
            f"or of another kind ({type(error).__name__}: {what})"
        ) from None


def flown(run: FlightData, record: RoundRecord) -> Track:
    """The part of the true track that belongs to a round."""
    start_ns = round(record.start_t_s * 1e9)
    end_ns = round((record.start_t_s + record.duration_s) * 1e9)
    return run.truth.between(start_ns, end_ns)


def _whole_rounds(data: FlightData) -> FlightData:
    """Return the data without the uplinks of a last round that did not end."""
    ended = {record.round for record in data.rounds}
    return replace(data, uplinks=tuple(item for item in data.uplinks if item.round in ended))


def summary_in(folder: Path) -> RunSummary:
    """What a run's `summary.json` says; {} without one. InputError: it is none."""
    path = RunFolder(folder).summary
    if not path.is_file():
        return {}
    summary: RunSummary = read_json(path)
    if not isinstance(summary, dict):
        raise InputError(f"{path}: not a run's summary")
    return summary
