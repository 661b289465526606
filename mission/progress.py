"""What a person sees of a run: a live line on a terminal, plain lines elsewhere, or nothing."""

from typing import Protocol

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mission.records import RoundRecord


class Progress(Protocol):
    """Shows a run as it goes."""

    def phase(self, name: str) -> None:
        """What is going on now."""
        ...

    def round_done(self, record: RoundRecord, *, rounds: int, real_time_factor: float) -> None:
        """A round is over."""
        ...

    def notice(self, text: str) -> None:
        """Something that a person should know."""
        ...

    def close(self) -> None:
        """Leave the terminal as it should stay."""
        ...


class Quiet:
    """Shows nothing."""

    def notice(self, text: str) -> None: ...

    def phase(self, name: str) -> None: ...

    def round_done(self, record: RoundRecord, *, rounds: int, real_time_factor: float) -> None: ...

    def close(self) -> None: ...


class PlainLines:
    """A line a round, for pipes and logs."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def phase(self, name: str) -> None:
        """Phases would only be noise in a file."""

    def notice(self, text: str) -> None:
        self._console.print(text, soft_wrap=True, highlight=False, markup=False)

    def round_done(self, record: RoundRecord, *, rounds: int, real_time_factor: float) -> None:
        accuracy = " ".join(f"{name} {value:.3f}" for name, value in record.accuracy.items())
        self._console.print(
            f"round {record.round}/{rounds}: t {record.start_t_s + record.duration_s:.0f} s, "
            f"{real_time_factor:.0f}x, objective planned {record.plan_objective:.3f} flown "
            f"{record.true_objective:.3f} ({_lost(record)} lost), "
            f"delivered {record.delivered}/{record.scheduled}, accuracy {accuracy}",
            soft_wrap=True, highlight=False, markup=False,
        )  # fmt: skip

    def close(self) -> None: ...


class LiveTable:
    """A table that grows by a row a round, with the present phase under it."""

    ROWS = 12  # of the newest rounds; a terminal has no room for hundreds

    def __init__(self, console: Console) -> None:
        self._records: list[RoundRecord] = []
        self._rounds = 0
        self._factor = 0.0
        self._phase = "starting"
        self._live = Live(console=console, get_renderable=self._render, refresh_per_second=8)
        self._live.start()

    def phase(self, name: str) -> None:
        self._phase = name

    def notice(self, text: str) -> None:
        self._live.console.print(text, highlight=False, markup=False)

    def round_done(self, record: RoundRecord, *, rounds: int, real_time_factor: float) -> None:
        self._records.append(record)
        self._rounds, self._factor = rounds, real_time_factor

    def close(self) -> None:
        self._phase = ""
        self._live.stop()

    def _render(self) -> Table:
        table = Table(box=None, pad_edge=False, header_style="bold")
        for name in ("round", "sim time", "speed", "planned", "flown", "lost", "delivered"):
            table.add_column(name, justify="right")
        communities = list(self._records[-1].accuracy) if self._records else []
        for name in communities:
            table.add_column(f"{name} accuracy", justify="right")
        for record in self._records[-self.ROWS :]:
            table.add_row(
                f"{record.round}/{self._rounds}",
                f"{record.start_t_s + record.duration_s:.0f} s",
                f"{self._factor:.0f}x",
                f"{record.plan_objective:.3f}",
                f"{record.true_objective:.3f}",
                _lost(record),
                f"{record.delivered}/{record.scheduled}",
                *(f"{record.accuracy[name]:.3f}" for name in communities),
            )
        if self._phase:
            table.caption = Text(f"{self._phase} ...", style="dim")
            table.caption_justify = "left"
        return table


def _lost(record: RoundRecord) -> str:
    """What of the planned objective the flight did not bring."""
    if record.plan_objective == 0.0:
        return "0.0 %"
    return f"{100 * (1 - record.true_objective / record.plan_objective):.1f} %"


def make_progress(console: Console, *, quiet: bool) -> Progress:
    """The progress that fits where it goes."""
    if quiet:
        return Quiet()
    return LiveTable(console) if console.is_terminal else PlainLines(console)
