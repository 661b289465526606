"""What a person sees of a run: in place on a terminal, a line a round in a file."""

import io
import math
import re
import time
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

from rich.console import Console

from mission.base.console import Stopwatch
from mission.log.records import UNKNOWN_ROUND, RoundRecord
from mission.run.progress import LiveTable, PlainLines, PlanProgress, Progress, make_progress
from mission.run.recorder import FolderRecorder


def record(number: int, *, flown: bool = True, planned: float = 2.0) -> RoundRecord:
    return replace(
        UNKNOWN_ROUND, round=number, start_t_s=60.0, duration_s=70.0 if flown else 0.0,
        plan_objective=planned,
        est_objective=1.9, true_objective=1.9, upper_bound=2.0, plan_path_m=800.0,
        flown_path_m=801.0, budget_used_m=801.0, scheduled=12, delivered=9, battery_remaining=0.9,
        accuracy={"digits": 0.125, "colour-shapes": 0.5}, cov={},
    )  # fmt: skip


def shown(
    *,
    terminal: bool,
    flown: bool = True,
    planned: float = 2.0,
    flies: bool = True,
    altitude_m: float | None = None,
) -> str:
    file = io.StringIO()
    console = Console(file=file, force_terminal=terminal, width=80, no_color=True)
    progress: Progress = make_progress(console, rounds=50, flown=flies)
    assert isinstance(progress, LiveTable if terminal else PlainLines)
    progress.phase("round 1/50: flying")
    height_m = math.nan if altitude_m is None else altitude_m
    done = replace(record(1, flown=flown, planned=planned), plan_altitude_m=height_m)
    progress.round_done(done, real_time_factor=42.0)
    progress.notice("by the way")
    progress.close()
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", file.getvalue())


def test_a_file_gets_a_line_a_round_and_no_phases() -> None:
    assert shown(terminal=False) == (
        "round 1/50: at 130 s (42x real time), objective 1.900 (planned 2.000, -5.0 %), "
        "delivered 9/12, accuracy digits 0.125, colour-shapes 0.500\nby the way\n"
    )


def test_nothing_flown_has_no_flight_in_its_line() -> None:
    assert shown(terminal=False, flown=False).startswith(
        "round 1/50: nothing flown, objective 1.900, delivered 9/12, accuracy"
    )
    for word in ("time", "speed", "planned"):
        assert word not in shown(terminal=True, flown=False)


def test_rounds_that_meet_their_plan_without_a_vehicle_are_not_called_flown() -> None:
    assert "nothing flown, objective 1.900, delivered" in shown(terminal=False, flies=False)
    assert "planned" not in shown(terminal=True, flies=False)


def test_a_change_that_rounds_to_nothing_has_no_sign_of_a_loss() -> None:
    assert "(planned 1.900, +0.0 %)" in shown(terminal=False, planned=1.9000001)


def test_a_plan_that_reaches_nobody_divides_by_nothing() -> None:
    assert "(planned 0.000, 0.0 %)" in shown(terminal=False, planned=0.0)


def test_small_objectives_keep_their_digits() -> None:
    assert "(planned 0.000123, " in shown(terminal=False, planned=0.00012345)
    assert re.search(r" 0\.000123 +1\.900 ", shown(terminal=True, planned=0.00012345))


def test_two_communities_fit_a_terminal() -> None:
    text = shown(terminal=True)
    assert "colour-shapes" in text
    assert "…" not in text
    assert re.search(
        r"1/50 +130 {2,}42x {2,}2\.000 {2,}1\.900 {2,}-5\.0 % +9/12 +0\.125 +0\.500", text
    )
    assert "by the way" in text
    assert "flying" not in text.splitlines()[-1]


def test_the_altitude_is_said_where_rounds_choose_it() -> None:
    line = shown(terminal=False, altitude_m=85.4)
    assert line.startswith("round 1/50: 85 m high, at 130 s (42x real time), objective 1.900")
    table = shown(terminal=True, altitude_m=85.4)
    assert re.search(r"1/50 +85 +130 +42x +2\.000 +1\.900 +-5\.0 % +9/12 +0\.125 +0\.500", table)
    assert "colour-shapes" in table
    for terminal in (False, True):
        assert "high" not in shown(terminal=terminal, altitude_m=math.nan)


def test_every_row_keeps_its_own_speed() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=80, no_color=True)
    progress = LiveTable(console, rounds=50, flown=True)
    for number in range(1, LiveTable.ROWS + 3):
        progress.round_done(record(number), real_time_factor=10.0 * number)
    progress.close()
    with console.capture() as caught:
        console.print(progress)
    shown_rows = re.findall(r"(\d+)/50 +130 +(\d+)x", caught.get())
    assert shown_rows == [(str(n), str(10 * n)) for n in range(3, LiveTable.ROWS + 3)]


def test_a_round_s_speed_is_its_own() -> None:
    """100 s of flight, take-off among them, in 2 s; then 60 s in 3 s."""
    stopwatch, parts = Stopwatch(), Mock()
    all_parts: list[Any] = [parts, (), *[parts] * 4, parts.progress, stopwatch]
    recorder = FolderRecorder(*all_parts)
    speeds = []
    for number, start_s, duration_s, fly_wall_s in ((1, 20.0, 80.0, 2.0), (2, 100.0, 60.0, 5.0)):
        stopwatch.wall_s["fly"] = fly_wall_s
        one = replace(record(number), start_t_s=start_s, duration_s=duration_s)
        recorder.finished(Mock(round=one, again=True), Mock(), Mock())
        speeds.append(parts.progress.round_done.call_args.kwargs["real_time_factor"])
    assert speeds == [50.0, 20.0]


def test_a_long_phase_says_for_how_long(monkeypatch) -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=80)
    progress = LiveTable(console, rounds=3, flown=True)
    progress.phase("round 1/3: training")
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + 12.0)
    with console.capture() as caught:
        console.print(progress)
    monkeypatch.undo()
    progress.close()
    assert "round 1/3: training ..., 12 s" in caught.get()


def test_a_plan_file_shows_item_height_battery_and_what_is_said() -> None:
    progress = Mock(spec=Progress)
    watch = PlanProgress(progress, "survey.plan", (1, 2, 1, 4))

    def seen(t_s: float, remaining: float) -> None:
        belief, battery = Mock(pos_ned_m=(0.0, 0.0, -49.6)), Mock(remaining=remaining)
        watch.sampled(Mock(t_ns=round(t_s * 1e9), belief=belief, battery=battery))

    def told(t_s: float, kind: str, text: str, seq: int | None = None, severity: int = 6) -> None:
        watch.happened(
            Mock(t_ns=round(t_s * 1e9), kind=kind, text=text, seq=seq, severity=severity)
        )

    seen(1.0, math.nan)
    seen(1.1, 0.97)  # not every sample
    told(1.2, "reached", "item 1", 1)
    seen(2.1, 0.97)
    told(2.2, "status", "item 3: reported", 3)
    told(2.2, "status", "Geofence loaded")
    told(2.3, "failsafe", "Battery low", severity=2)
    told(1.5, "reached", "item 2", 2)  # found out afterwards
    told(2.4, "status", "item 4: reported", 4)  # PX4 leaves out items that lie near each other
    told(2.5, "status", "item 4: reported", 4)
    assert [str(call.args[0]) for call in progress.phase.call_args_list] == [
        "flying survey.plan: on the way to the first place, 50 m high, battery unknown",
        "flying survey.plan: item 1 (1 of 4), 50 m high, battery 97 %",
    ]
    assert [str(call.args[0]) for call in progress.notice.call_args_list] == [
        "t 1.2 s: item 1 (1 of 4), 50 m high, battery 97 %",
        "t 2.3 s: Battery low",
        "t 2.4 s: item 4 (4 of 4), 50 m high, battery 97 %",
    ]


def test_of_many_places_each_tenth_is_told_and_notices_but_no_less() -> None:
    progress = Mock(spec=Progress)
    watch = PlanProgress(progress, "x.plan", tuple(range(20)))
    belief, battery = Mock(pos_ned_m=(0.0, 0.0, 0.4)), Mock(remaining=0.004)
    for t_s in (0.0, 0.999, 1.0, 1.5, 2.0):
        watch.sampled(Mock(t_ns=round(t_s * 1e9), belief=belief, battery=battery))
    assert progress.phase.call_count == 3  # once a second
    assert progress.phase.call_args.args[0].endswith("first place, 0 m high, battery 0 %")
    for seq in range(20):
        watch.happened(Mock(t_ns=2 * 10**9, kind="reached", text="", seq=seq, severity=6))
    told = [str(call.args[0]) for call in progress.notice.call_args_list]
    assert [words.split(" (")[0] for words in told] == [
        f"t 2.0 s: item {seq}" for seq in range(1, 20, 2)
    ]
    assert "(20 of 20)" in told[-1]
    progress.notice.reset_mock()
    for kind, severity in (("status", 5), ("status", 6), ("fault", 4), ("mode", 2), ("armed", 2)):
        watch.happened(Mock(t_ns=2 * 10**9, kind=kind, text=kind, seq=None, severity=severity))
    told = [str(call.args[0]) for call in progress.notice.call_args_list]
    assert told == ["t 2.0 s: status", "t 2.0 s: fault"]


def test_a_phase_is_timed_from_two_seconds_on_and_a_quiet_console_shows_nothing(
    monkeypatch,
) -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=80)
    monkeypatch.setattr(time, "monotonic", lambda: 100.0)
    progress = LiveTable(console, rounds=3, flown=True)
    progress.phase("planning")
    shown_at = {}
    for after_s in (1.99, 2.0):
        monkeypatch.setattr(time, "monotonic", lambda after_s=after_s: 100.0 + after_s)
        with console.capture() as caught:
            console.print(progress)
        shown_at[after_s] = caught.get()
    monkeypatch.undo()
    progress.close()
    assert "s" not in shown_at[1.99].partition("...")[2].replace("\x1b[0m", "")
    assert "planning ..., 2 s" in shown_at[2.0]
    quiet = make_progress(Console(file=io.StringIO(), quiet=True), rounds=1, flown=True)
    assert type(quiet) is Progress
