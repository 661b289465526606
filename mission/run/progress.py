"""What a person sees of a run or a flight: a live table on a terminal, or plain lines elsewhere."""

import math
import time
from collections import deque
from collections.abc import Sequence

from rich.console import Console, ConsoleOptions, RenderResult
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mission.base.console import PLAIN
from mission.log.records import RoundRecord
from sitl.observer import VehicleEvent, VehicleSample


class Progress:
    """Progress display of a run; this base class shows nothing."""

    def phase(self, name: str) -> None:
        """Show the phase under way."""

    def round_done(self, record: RoundRecord, *, real_time_factor: float) -> None:
        """Show a finished round."""

    def notice(self, text: str) -> None:
        """Show a message in a line of its own."""

    def close(self) -> None:
        """End the display; what it shows last stays on the terminal."""


class PlainLines(Progress):
    """Progress display for pipes and logs: a line for each round, and none for phases."""

    def __init__(self, console: Console, *, rounds: int, flown: bool) -> None:
        self._console, self._rounds, self._flown = console, rounds, flown

    def notice(self, text: str) -> None:
        self._console.print(text, **PLAIN)

    def round_done(self, record: RoundRecord, *, real_time_factor: float) -> None:
        accuracy = ", ".join(f"{name} {value:.3f}" for name, value in record.accuracy.items())
        flight = (
            f"at {record.start_t_s + record.duration_s:.0f} s ({real_time_factor:.0f}x real time), "
            f"objective {_objective(record.true_objective)} "
            f"(planned {_objective(record.plan_objective)}, {_change(record)})"
            if self._flown and _takes_time(record)
            else f"nothing flown, objective {_objective(record.true_objective)}"
        )
        height_m = _chosen_height_m(record)
        height = "" if height_m is None else f"{height_m:.0f} m high, "
        self.notice(
            f"round {record.round}/{self._rounds}: {height}{flight}, "
            f"delivered {record.delivered}/{record.scheduled}, accuracy {accuracy}"
        )


class LiveTable(Progress):
    """Progress display on a terminal: a row for each recent round; below, the present phase."""

    ROWS = 12  # of the newest rounds; a terminal has no room for hundreds

    def __init__(self, console: Console, *, rounds: int, flown: bool) -> None:
        self._rounds, self._flown = rounds, flown
        # The newest rounds, each with how much faster than real time it was flown.
        self._newest: deque[tuple[RoundRecord, float]] = deque(maxlen=self.ROWS)
        self._phase, self._since_s = "starting", time.monotonic()
        self._live = Live(self, console=console, refresh_per_second=8)
        self._live.start()

    def phase(self, name: str) -> None:
        self._phase, self._since_s = name, time.monotonic()

    def notice(self, text: str) -> None:
        self._live.console.print(text, **PLAIN)

    def round_done(self, record: RoundRecord, *, real_time_factor: float) -> None:
        self._newest.append((record, real_time_factor))

    def close(self) -> None:
        self._phase = ""
        self._live.stop()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The rounds so far, and the present phase."""
        if self._newest:
            yield self._table()
        if self._phase:
            seconds = time.monotonic() - self._since_s
            # Told once it takes long enough to be wondered at.
            waited = f", {seconds:.0f} s" if seconds >= 2.0 else ""
            yield Text(f"{self._phase} ...{waited}", style="dim")

    def _table(self) -> Table:
        newest, _ = self._newest[-1]
        flown = self._flown and _takes_time(newest)
        flight = ("time\ns", "speed", "planned", "flown", "change") if flown else ()
        communities = list(newest.accuracy)
        chosen = any(_chosen_height_m(record) is not None for record, _ in self._newest)
        height = ("high\nm",) if chosen else ()
        # Narrow enough for two communities in 80 columns.
        apart = (0, 1 if chosen else 2, 0, 0)
        table = Table(box=None, pad_edge=False, padding=apart, header_style="bold")
        for name in (
            "round",
            *height,
            *flight,
            "arrived",
            *(f"accuracy\n{name}" for name in communities),
        ):
            table.add_column(name, justify="right", vertical="bottom")
        for record, real_time_factor in self._newest:
            cells = (
                f"{record.start_t_s + record.duration_s:.0f}",
                f"{real_time_factor:.0f}x",
                _objective(record.plan_objective),
                _objective(record.true_objective),
                _change(record),
            )
            height_m = _chosen_height_m(record)
            table.add_row(
                f"{record.round}/{self._rounds}",
                *(("" if height_m is None else f"{height_m:.0f}",) if chosen else ()),
                *(cells if flown else ()),
                f"{record.delivered}/{record.scheduled}",
                *(f"{record.accuracy[name]:.3f}" for name in communities),
            )
        return table


def _chosen_height_m(record: RoundRecord) -> float | None:
    """Return the height above home that the round chose; None where it is configured."""
    return record.plan_altitude_m if math.isfinite(record.plan_altitude_m) else None


def _takes_time(record: RoundRecord) -> bool:
    """Whether the round is one of flight: a hover takes time, `ideal` takes none."""
    return record.duration_s > 0.0


def _objective(value: float) -> str:
    """Format an objective with three decimals; a small one with three significant digits."""
    return f"{value:.3f}" if value == 0.0 or abs(value) >= 0.1 else f"{value:.3g}"


def _change(record: RoundRecord) -> str:
    """Format the change from planned to true objective, in percent of the planned one."""
    if record.plan_objective == 0.0:
        return "0.0 %"
    share = 100 * (record.true_objective / record.plan_objective - 1)
    return f"{round(share, 1) + 0.0:+.1f} %"  # never -0.0


def make_progress(console: Console, *, rounds: int, flown: bool) -> Progress:
    """Make the display that fits the console: none if quiet, a live table, or plain lines."""
    if console.quiet:
        return Progress()
    kind = LiveTable if console.is_terminal else PlainLines
    return kind(console, rounds=rounds, flown=flown)


_NOTICE = 5  # MAV_SEVERITY; what is less severe is for logs
_EACH_NS = 1_000_000_000


class PlanProgress:
    """A vehicle observer that shows how far a plan is; `order`: its items in order of flight."""

    def __init__(self, progress: Progress, name: str, order: Sequence[int]) -> None:
        self._progress = progress
        self._name, self._order, self._passed = name, order, 0
        self._due_ns = 0
        self._now: VehicleSample | None = None
        self._item = "on the way to the first place"

    def sampled(self, sample: VehicleSample) -> None:
        """Show where the vehicle is, once a second of its time."""
        self._now = sample
        if sample.t_ns >= self._due_ns:
            self._due_ns = sample.t_ns + _EACH_NS
            self._progress.phase(f"flying {self._name}: {self._item}, {_state(sample)}")

    def happened(self, event: VehicleEvent) -> None:
        """Show that a place was reached, or what the vehicle says."""
        now = self._now
        if now is not None and event.t_ns < now.t_ns:
            return  # found out afterwards
        at = f"t {event.t_ns / 1e9:.1f} s"
        if event.seq in self._order[self._passed :]:  # a vehicle may leave out some
            before, self._passed = self._passed, self._order.index(event.seq, self._passed) + 1
            self._item = f"item {event.seq} ({self._passed} of {len(self._order)})"
            tenths = [10 * passed // len(self._order) for passed in (before, self._passed)]
            if now is not None and tenths[0] < tenths[1]:
                self._progress.notice(f"{at}: {self._item}, {_state(now)}")
        elif event.kind in ("status", "failsafe", "fault") and event.severity <= _NOTICE:
            self._progress.notice(f"{at}: {event.text}")


def _state(sample: VehicleSample) -> str:
    charge = 100 * sample.battery.remaining
    told = "unknown" if math.isnan(charge) else f"{charge:.0f} %"
    return f"{0.0 - round(sample.belief.pos_ned_m[2]):.0f} m high, battery {told}"
