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
    unread: tuple[str, ...] = ()  # those of them whose flight is not known: no limit is met

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
    loaded, left_out, unread = list[LoadedRun](), list[str](), list[str]()
    for item in paths:
        flights, refused, apart = (
            ([item], [], [])
            if isinstance(item, LoadedRun)
            else load_flights(item, plan, believed=believed, together=asked or alone)
        )
        loaded += flights
        left_out += [*map(str, refused), *apart]
        unread += [str(e) for e in refused if at_once or not isinstance(e, NoFlightError)]
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
            unread += [str(error)] if not isinstance(error, NoFlightError) else []
    if not comparisons:
        raise InputError(left_out[0])
    world = None
    if asked or alone:
        try:
            world = together(comparisons, offsets, of_run=of_run, at_once=at_once)
        except InputError:
            if asked:
                raise
        world = world and replace(world, left_out=tuple(left_out))
    return Several(tuple(comparisons), world, tuple(left_out), tuple(unread))
