"""A sweep's folder: what it was started with, how far it is, one sweep in it at a time."""

import json
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

from mission.base.errors import InputError
from mission.base.run_folder import RunFolder, alone_in, write_atomically
from mission.base.tables import dotted
from mission.base.user_files import read_json
from mission.config.preflight import code_digests, own_code
from mission.run.resume import other_code
from mission.sweep.grid import Axis, Grid, Point, SweepRun, points
from mission.sweep.results import RunResult, read_results, read_run, table_of, with_equals

_LOCK = ".lock"
_MAX_NAMED = 8  # changes in one message


class Manifest(TypedDict):
    """What a sweep was started with, as `sweep.json` says it."""

    format: int
    config: dict[str, object]
    data_dir: str | None
    plugins: dict[str, str | None]  # digests of their code
    axes: dict[str, list[Any]]  # strategies and seeds first, then the settings


@dataclass(frozen=True)
class SweepFolder:
    """The folder of a sweep: its runs, its manifest, its lock."""

    path: Path

    def run(self, run: Point) -> RunFolder:
        """The folder of one run, as `aerofed run` leaves one."""
        return RunFolder(self.runs / run.name)

    @property
    def runs(self) -> Path:
        """The folder that holds those of all runs."""
        return self.path / "runs"

    def done(self, run: Point) -> bool:
        """Whether the run's summary, which is written last, says that it was finished."""
        return self.run(run).status() == "finished"

    @property
    def manifest(self) -> Path:
        return self.path / "sweep.json"

    def lock(self) -> AbstractContextManager[None]:
        """Context manager: make the folder, and keep other sweeps out of it; see `alone_in`."""
        return alone_in(self.path, self.path / _LOCK, who="sweep", chosen=True)

    def check(self, grid: Grid, *, data_dir: Path | None) -> None:
        """Refuse a folder in which this sweep can neither start nor go on.

        More strategies, seeds and values may join a sweep that was started before.

        Raises:
            InputError: the folder holds something else, or what it was started with is changed.
        """
        new = _manifest(grid, data_dir=data_dir)
        for name, digest in new["plugins"].items():
            if digest is None:
                raise InputError(
                    f"plug-in {name!r} was passed from Python, and cannot be handed on to the "
                    "processes of a sweep: it cannot be pickled"
                )
        if self.manifest.exists():
            old = read_manifest(self.path)
            if changes := _changes(old, new):
                named = "; ".join(changes[:_MAX_NAMED])
                raise InputError(
                    f"{self.path}: the sweep in this folder was started with another "
                    f"configuration: {named}; give a new folder"
                )
            for run in grid.runs:
                self._check_run(run, new["plugins"])
            if left_out := _left_out(old, new):
                raise InputError(
                    f"{self.path}: the sweep in this folder has more runs than are asked for: "
                    f"{'; '.join(left_out)}; or give a new folder"
                )
        elif self.path.is_dir():
            others = [path.name for path in self.path.iterdir() if path.name != _LOCK]
            if others:
                raise InputError(
                    f"{self.path}: already used, and not by a sweep (it holds {others[0]}); "
                    "give a new or empty folder"
                )

    def _check_run(self, run: SweepRun, now: Mapping[str, str | None]) -> None:
        """Refuse to keep a run that was altered, or flown with other code than there is `now`."""
        summary = self.run(run).read_summary()
        if summary.get("status") != "finished":
            return
        self.run(run).check_unchanged()
        for _, name in own_code(run.config, told=False):
            if why := other_code(name, summary.get("plugins", {}).get(name), now[name]):
                raise InputError(
                    f"{self.run(run).path}: finished, but {why}: remove this folder to have the "
                    "run flown anew, or give the sweep a new folder"
                )

    def claim(self, grid: Grid, *, data_dir: Path | None) -> None:
        """Write down what the sweep is started with, or extended to."""
        values = _manifest(grid, data_dir=data_dir)
        write_atomically(self.manifest, json.dumps(values, indent=2) + "\n")


def read_manifest(folder: Path) -> Manifest:
    """What the sweep in a folder was started with.

    Raises:
        InputError: not a sweep's folder, or one of another version.
    """
    path = SweepFolder(folder).manifest
    if not path.exists():
        raise InputError(f"{folder}: not a sweep's folder: it has no {path.name}")
    values = read_json(path)
    axes = values.get("axes") if isinstance(values, dict) else None
    if (
        not isinstance(axes, dict)
        or list(axes)[:2] != ["strategy", "seed"]
        or not all(isinstance(item, list) for item in axes.values())
        or values.get("format") != 1
    ):
        raise InputError(f"{path}: not written by a sweep of this version")
    manifest: Manifest = values
    return manifest


def points_of(manifest: Manifest) -> tuple[Point, ...]:
    """The runs that a sweep consists of, in the order of its tables."""
    strategies, seeds, *axes = manifest["axes"].items()
    return points(strategies[1], seeds[1], [Axis(key, tuple(values)) for key, values in axes])


def _manifest(grid: Grid, *, data_dir: Path | None) -> Manifest:
    return {
        "format": 1,
        "config": grid.base.model_dump(mode="json", exclude={"mission": {"strategy"}}),
        "data_dir": None if data_dir is None else str(data_dir.resolve()),
        "plugins": code_digests(*(run.config for run in grid.runs)),
        "axes": {
            "strategy": list(grid.strategies),
            "seed": list(grid.seeds),
            **{axis.key: list(axis.values) for axis in grid.axes},
        },
    }


def _changes(old: Manifest, new: Manifest) -> list[str]:
    before, after = (
        {**dotted(values["config"]), "data folder": values["data_dir"]} for values in (old, new)
    )
    changes = [
        f"{key} was {before.get(key)!r}, is {after.get(key)!r}"
        for key in sorted(before.keys() | after.keys())
        if before.get(key) != after.get(key)
    ]
    for key in sorted(old["axes"].keys() | new["axes"].keys()):
        was, now = old["axes"].get(key), new["axes"].get(key)
        if was is None or now is None:
            changes.append(f"{key} was {'swept' if now is None else 'not swept'}")
    return changes


def _left_out(old: Manifest, new: Manifest) -> list[str]:
    """What a sweep in a folder has and a command leaves out, with how to ask for it again."""
    more = []
    for key, was in old["axes"].items():
        now = new["axes"][key]
        missing = [value for value in was if value not in now]
        if missing:
            lacks = f"{key} {', '.join(map(str, missing))} {'is' if len(missing) == 1 else 'are'}"
            more.append(f"{lacks} there too, so give {_option(key, [*now, *missing])}")
    return more


def _option(key: str, values: list[Any]) -> str:
    """The option of `aerofed sweep` that asks for all these values of a key."""
    if key == "seed":  # they count up from the configuration's
        return f"--seeds {max(values) - min(values) + 1}"
    listed = ",".join(value if isinstance(value, str) else json.dumps(value) for value in values)
    return f"--strategies {listed}" if key == "strategy" else f"--set {key}={listed}"


_NAMED = 6  # runs that are missing, in one line


@dataclass(frozen=True)
class Missing:
    """A run that is not finished, and why."""

    run: str
    label: str  # the group that it belongs to: strategy and settings
    why: str


@dataclass(frozen=True)
class SweepState:
    """A sweep as its folder shows it, at work or not."""

    config: Mapping[str, object]  # what its runs have in common
    results: tuple[RunResult, ...]  # of the runs that are done
    missing: tuple[Missing, ...]

    @property
    def planned(self) -> int:
        """Number of runs that the sweep consists of."""
        return len(self.results) + len(self.missing)

    def seeds(self, label: str) -> str:
        """How many seeds of a group are done: `3`, or `2 of 3`."""
        done = sum(result.point.label == label for result in self.results)
        missing = sum(item.label == label for item in self.missing)
        return f"{done} of {done + missing}" if missing else str(done)

    @property
    def progress(self) -> str:
        """Progress as a sentence: `All 4 runs are done.`, or how many are and which are not."""
        if not self.missing:
            return f"All {self.planned} runs are done."
        names = [item.run for item in self.missing]
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        return (
            f"{len(self.results)} of {self.planned} runs are done; "
            f"missing: {', '.join(names[:_NAMED])}{more}."
        )


def read_sweep(path: Path) -> SweepState:
    """Read the state of the sweep in `path`, from its tables where the folders of runs are gone.

    Raises:
        InputError: not a sweep's folder, or none of its runs is done, or one is damaged.
    """
    manifest, folder = read_manifest(path), SweepFolder(path)
    points = points_of(manifest)
    results: list[RunResult] = []
    missing: list[Missing] = []
    if table_of(path, "runs").is_file() and not folder.runs.is_dir():
        results += read_results(path, points)
        done = {result.point.name for result in results}
        left = [point for point in points if point.name not in done]
        missing += [Missing(point.name, point.label, "not in the tables") for point in left]
    else:
        for point in points:
            if folder.done(point):
                results.append(read_run(folder.run(point), point))
            else:
                missing.append(Missing(point.name, point.label, _why(folder.run(point))))
    if not results:
        raise InputError(f"{path}: none of the {len(missing)} runs of this sweep is done")
    return SweepState(manifest["config"], with_equals(results), tuple(missing))


def _why(run: RunFolder) -> str:
    if not (summary := run.read_summary()):
        return "not begun"
    if "error" in summary:
        return f"failed: {summary['error']}"
    return f"begun: at work, or cut off, after {rounds_in(run)} rounds"


def rounds_in(run: RunFolder) -> int:
    """Rounds that a run has flown so far; 0 where its table cannot be read."""
    try:
        return max(0, run.rounds.read_bytes().count(b"\n") - 1)
    except OSError:
        return 0
