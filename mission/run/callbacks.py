"""A researcher's own code that is told of every round: for TensorBoard, MLflow, W&B."""

from collections.abc import Sequence
from contextlib import ExitStack
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self

from fl.federation.rounds import RoundLearning
from mission.base.errors import UsersCodeError
from mission.base.user_code import make_from, users_code
from mission.config.models import RunConfig
from mission.log.records import RoundRecord, UplinkRecord

KEY = "callbacks"


@dataclass(frozen=True)
class CallbackContext:
    """What a callback's factory is given: `factory(context) -> Callback`."""

    folder: Path  # of the run: files that a callback leaves belong into it
    config: RunConfig


@dataclass(frozen=True)
class RoundReport:
    """A finished round, as callbacks are told of it."""

    round: RoundRecord  # its row in rounds.csv
    uplinks: tuple[UplinkRecord, ...]  # its rows in uplinks.csv
    learning: RoundLearning
    again: bool  # told before: a resumed run flies its finished rounds again


class Callback(Protocol):
    """Told of every finished round, in order. Nothing that it does alters the run."""

    def round_finished(self, report: RoundReport) -> None:
        """A round is over, and in the tables and the checkpoint."""

    def close(self) -> None:
        """No round follows: the run has ended, however it did."""


@dataclass(frozen=True)
class Callbacks:
    """All of a run's callbacks, with their names. One that fails ends the run with its name.

    A context manager: with its block they are closed, where they are not yet.
    """

    each: tuple[tuple[str, Callback], ...] = ()
    _closing: ExitStack = field(default_factory=ExitStack)  # of those that are not closed yet

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close them. What went wrong before counts for more than who fails at that."""
        try:
            self.close()
        except UsersCodeError:
            if kind is None:
                raise

    def round_finished(self, report: RoundReport) -> None:
        """Tell all of them.

        Raises:
            UsersCodeError: one of them failed; a resumed run goes on after this round.
        """
        for name, callback in self.each:
            doing = f"round_finished() of round {report.round.round}"
            with users_code(name, key=KEY, doing=doing):
                callback.round_finished(deepcopy(report))  # what it does to its own is its own

    def close(self) -> None:
        """Close all of them, also where one fails at it; twice is fine.

        Raises:
            UsersCodeError: one of them failed.
        """
        self._closing.close()


def make_callbacks(names: Sequence[str] | None, context: CallbackContext) -> Callbacks:
    """What the factories of these names make.

    Raises:
        InputError: one cannot be imported or called, or makes something else; those before it
            are closed.
    """
    made: list[tuple[str, Callback]] = []
    with ExitStack() as closing:
        for name in names or ():
            members = ("round_finished", "close")
            callback = make_from(name, context, key=KEY, members=members)
            closing.callback(_close, name, callback)
            made.append((name, callback))
        return Callbacks(tuple(made), closing.pop_all())


def _close(name: str, callback: Callback) -> None:
    with users_code(name, key=KEY, doing="close()"):
        callback.close()
