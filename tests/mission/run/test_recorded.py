"""What every flight has around it, whatever is flown."""

import io
import itertools
import json
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from mission.base.console import RunConsole
from mission.base.run_folder import RunFolder
from mission.base.stopwatch import Stopwatch
from mission.run.budget import RunTotals
from mission.run.recorded import fly_recorded
from mission.run.summary import Summary


class Flight:
    """Flies nothing; it shows how long that took."""

    def __init__(self, stopwatch: Stopwatch) -> None:
        self.totals = RunTotals.before(0)
        self.stopwatch = stopwatch

    async def run(self) -> None:
        pass

    def conclude(self, summary: Summary) -> None:
        pass

    def show(self, console: RunConsole) -> None:
        console.say(f"{self.stopwatch.total_s} {json.dumps(self.stopwatch.wall_s)}")


def test_terminal_page_and_summary_tell_the_same_wall_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = SimpleNamespace(perf_counter=itertools.count().__next__)  # each a second later
    monkeypatch.setattr("mission.base.stopwatch.time", looks)
    stopwatch, folder, screen = Stopwatch(), RunFolder(tmp_path), io.StringIO()
    seen: list[object] = []

    def page(path: Path) -> None:
        looks.perf_counter()
        seen.append(RunFolder(path).told()["wall_s"])

    code = fly_recorded(
        nullcontext(Flight(stopwatch)),
        Summary(folder),
        console=RunConsole(Console(file=screen, width=200)),
        stopwatch=stopwatch,
        figures=False,
        page=page,
    )
    assert code == 0
    total_s, wall_s = screen.getvalue().splitlines()[0].split(" ", 1)
    told = {**json.loads(wall_s), "total": int(total_s)}
    assert seen == [told]
    assert folder.told()["wall_s"] == told
