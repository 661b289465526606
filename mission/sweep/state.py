"""How far a sweep is: the runs that are done, with their results, and what became of the others."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mission.base.errors import InputError
from mission.base.run_folder import RunFolder
from mission.sweep.folder import SweepFolder, points_of, read_manifest
from mission.sweep.results import RunResult, read_results, read_run, table_of, with_equals

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
