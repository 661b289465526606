"""A researcher's own code that is told of every round: for TensorBoard, MLflow, W&B."""

from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self

from fl.federation.rounds import RoundLearning
from fl.plugins import PlugIn
from mission.base.errors import CallbackError, UsersCodeError
from mission.config.models import RunConfig
from mission.log.records import AircraftRecord, RoundRecord, UplinkRecord


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
    aircraft: tuple[AircraftRecord, ...]  # its rows in aircraft.csv
    again: bool  # told before: a resumed run flies its finished rounds again


class Callback(Protocol):
    """An observer that receives every finished round, in order; it alters no result."""

    def round_finished(self, report: RoundReport) -> None:
        """Receive a finished round, once it is in the tables and the checkpoint."""

    def close(self) -> None:
        """Clean up at the end of the run, however it ended; no round follows."""


class CustomCallback(PlugIn):
    """A researcher's own callback. One that fails ends the run with its name."""

    setting = "callbacks"
    error = CallbackError
    members = ("round_finished", "close")


@dataclass(frozen=True)
class Callbacks:
    """All of a run's callbacks.

    A context manager: with its block they are closed, where they are not yet.
    """

    each: tuple[CustomCallback, ...] = ()
    _closing: ExitStack = field(default_factory=ExitStack)  # of those that are not closed yet

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close all callbacks; an error of closing is dropped if the block failed before."""
        try:
            self._closing.close()
        except UsersCodeError:
            if kind is None:
                raise

    def round_finished(self, report: RoundReport) -> None:
        """Report a finished round to every callback.

        Raises:
            UsersCodeError: one of them failed; a resumed run goes on after this round.
        """
        for callback in self.each:
            callback.ask("round_finished", report, of=f" of round {report.round.round}")


def make_callbacks(context: CallbackContext) -> Callbacks:
    """Make the callbacks whose factories the configuration names.

    Raises:
        UsersCodeError: one cannot be imported or called, or makes no callback; those before it
            are closed.
    """
    made: list[CustomCallback] = []
    with ExitStack() as closing:
        for name in context.config.callbacks or ():
            made.append(CustomCallback.made(name, context))
            closing.callback(made[-1].ask, "close")
        return Callbacks(tuple(made), closing.pop_all())
