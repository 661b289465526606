"""Several flights: loaded, compared with their plans each, and together where they were."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from mission.analysis.compare import RunComparison, compare_run
from mission.analysis.load import LoadedRun, load_flights, vehicles_of
from mission.analysis.together import Together, together
from mission.base.errors import InputError, NoFlightError
from mission.base.run_folder import RunFolder


@dataclass(frozen=True)
class Several:
    """Flights compared with their plans; `world` where they are judged together."""

    flights: tuple[RunComparison, ...]
    world: Together | None
    left_out: tuple[str, ...]  # logs that are not among them, and why
    # Those of them whose flight is not known, (file, why): no limit is met.
    unread: tuple[tuple[str, str], ...] = ()

    @property
    def together(self) -> Together:
        """The world, where it was asked for."""
        assert self.world is not None
        return self.world


NOTHING = Several((), None, ())


def load_several(
    given: Iterable[Path | LoadedRun],
    plan: Path | None = None,
    *,
    believed: bool = False,
    rounds: int | None = None,
    asked: bool = False,
    offsets: Mapping[str, float] | None = None,
) -> Several:
    """Load and compare runs, logs and folders of logs. They are judged together where that is
    `asked` for, and by themselves where they are one folder of one world's vehicles.

    Raises:
        InputError: as `load_flights`, `compare_run` and, where it is asked for, `together`.
    """
    paths = tuple(given)
    (first, *others) = paths
    asked = asked or bool(offsets)
    alone = isinstance(first, Path) and not others and bool(vehicles_of(first))
    folder = RunFolder(first) if alone and isinstance(first, Path) else None
    of_run = folder is not None and folder.rounds.is_file()
    at_once = folder is not None and folder.summary.is_file()  # by a run, or one `aerofed fly`
    loaded, left_out, unread = list[LoadedRun](), list[str](), list[tuple[str, str]]()
    for item in paths:
        flights, refused, apart = (
            ([item], [], [])
            if isinstance(item, LoadedRun)
            else load_flights(item, plan, believed=believed, together=asked or alone)
        )
        loaded += flights
        left_out += [*(str(error) for _, error in refused), *apart]
        unread += [_of_file(*one) for one in refused if at_once or _is_unknown(one[1])]
    comparisons = list[RunComparison]()
    for run in loaded:
        if of_run and not run.data.rounds:  # lost before its first was over, and among the others
            run = replace(run, unjudged="no round was flown")
        try:
            comparisons.append(compare_run(run, rounds=rounds))
        except InputError as error:  # it may have stayed on the ground
            if not alone:
                raise
            left_out.append(str(error))
            unread += [_of_file(run.path, error)] if _is_unknown(error) else []
    if not comparisons:
        raise InputError(left_out[0])
    world = None
    if asked or alone:
        try:
            by_itself = at_once or bool(unread)  # or with one that cannot be read
            world = together(comparisons, offsets, of_run=of_run, at_once=by_itself)
        except InputError:
            if asked:
                raise
        world = world and replace(world, left_out=tuple(left_out))
    return Several(tuple(comparisons), world, tuple(left_out), tuple(unread))


def _is_unknown(error: InputError) -> bool:
    """Whether there may be a flight in what is refused."""
    return not isinstance(error, NoFlightError)


def _of_file(path: Path, error: InputError) -> tuple[str, str]:
    """Return the file that is refused, which is at a path or in that folder, and why."""
    file, _, why = str(error).removeprefix(str(path)).partition(": ")
    return f"{path}{file}", why
