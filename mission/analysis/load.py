"""A run read back: from its folder, or from its log alone; a killed one as far as it came."""

import json
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mission.base.errors import InputError
from mission.base.interrupted_files import InterruptedFiles
from mission.base.run_folder import RunFolder
from mission.log.errors import DamagedLogError
from mission.log.read.contents import load_damaged
from mission.log.read.reader import decode, read_log
from mission.log.records import RoundRecord
from mission.log.values import NS_PER_S, FlightData, Floats, Track

_FINISHED = "finished"
_FENCE_SHOWN = 2.2  # times the area: a larger one would make the rest of the map small


@dataclass(frozen=True)
class LoadedRun:
    """A run, and how far it came."""

    path: Path
    data: FlightData
    summary: dict[str, Any]  # empty for a bare log, or a folder without one
    cut: bool  # its log has no end: the writer was killed, or is still at work

    @property
    def name(self) -> str:
        """What the run is called in tables and figures: its folder, or its file."""
        return self.path.name or str(self.path.resolve().name)

    @property
    def about(self) -> str:
        """Which run, strategy and seed it is: a line for pictures."""
        return self.told("strategy", "seed")

    def told(self, *keys: str) -> str:
        """The name, and what summary or configuration say of `keys`."""
        config = self._config
        known = {**config.get("mission", {}), **config, **self.summary}
        return " · ".join([self.name, *(f"{key} {known[key]}" for key in keys if key in known)])

    @property
    def state(self) -> str:
        """Why the run is not finished; empty for one that is."""
        status = str(self.summary.get("status", _FINISHED))
        words = {
            _FINISHED: "",
            "running": "not finished: it was killed, or is still under way",
        }
        error = f" ({self.summary['error']})" if "error" in self.summary else ""
        return words.get(status, status) + error

    @property
    def notice(self) -> str:
        """What a reader has to know of a run that is not finished; empty for one that is."""
        if not self.state:
            return ""
        if not self._resumable:
            return f"{self.state}; this is what was flown"
        count = len(self.data.rounds)
        done = f"{count} {'round of it is' if count == 1 else 'rounds of it are'} here"
        return f"{self.state}; {done}; aerofed run --resume {self.path} goes on"

    @property
    def _config(self) -> dict[str, Any]:
        """What it was flown with; empty where the log's copy is missing or damaged."""
        try:
            return tomllib.loads(self.data.attachments.get("config.toml", b"").decode())
        except (UnicodeDecodeError, tomllib.TOMLDecodeError):
            return {}

    @property
    def _resumable(self) -> bool:
        """What another autopilot than ours flew cannot be flown again."""
        config = self._config
        external = config.get("link", {}).get("kind") == "external"
        firmware = config.get("vehicle", {}).get("autopilot", "built-in") != "built-in"
        return (self.path / "checkpoint").is_dir() and not external and not firmware


def load_run(path: Path) -> LoadedRun:
    """A run's folder or a log file by itself.

    Of a run that was killed, or is still under way, everything that was flushed is read.

    Raises:
        InputError: neither; the folder has no log; the log is damaged, or not one of ours.
    """
    if path.is_file():
        return LoadedRun(path, read_log(path), {}, cut=False)
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
        return LoadedRun(path, read_log(log), summary, cut=False)
    except DamagedLogError:
        if summary.get("status", _FINISHED) == _FINISHED:
            raise
    return LoadedRun(path, _whole_rounds(decode(load_damaged(log))), summary, cut=True)


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


def extent(run: FlightData, *, margin: float) -> tuple[Floats, Floats]:
    """The south-west and north-east corners (2,) of a map of a run: the area, everything planned
    and flown, the fence where it is not far away, and `margin` times the area's size around it.
    """
    size = np.array(run.area.size_m)
    points = [np.zeros((1, 2)), size[None], run.truth.pos_m[:, :2]]
    points += [plan.route_m for plan in run.plans]
    points += [
        zone.outline_m
        for zone in run.fence
        if np.all(np.ptp(zone.outline_m, axis=0) < _FENCE_SHOWN * size.max())
    ]
    every = np.vstack(points)
    air = margin * float(size.max())
    return every.min(axis=0) - air, every.max(axis=0) + air


def _whole_rounds(data: FlightData) -> FlightData:
    """Without what was flushed of a round that did not end."""
    ended = {record.round for record in data.rounds}
    return replace(data, uplinks=tuple(item for item in data.uplinks if item.round in ended))


def _summary(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    if not isinstance(values, dict):
        raise InputError(f"{path}: not a run's summary")
    return values
