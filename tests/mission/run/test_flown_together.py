"""`aerofed fly` of several plans."""

import asyncio
import json
from collections.abc import Mapping
from pathlib import Path

import pytest
from crossings import crossing, independent, plan
from small_runs import refused, without_its_end

from mission.analysis.load import LoadedRun, load_run
from mission.base.errors import AerofedError
from mission.cli import call
from mission.flight.serve.together import Departure, fly_together
from mission.log.reader import read_log
from sitl.pace import Simulation

pytestmark = pytest.mark.slow
QUICK = ("--no-figures", "--no-report", "--quiet")


def fly(*arguments: object) -> int:
    return call(["fly", *map(str, arguments)])


def test_three_are_flown_logged_apart_and_judged_together(tmp_path: Path) -> None:
    plans = [*crossing(tmp_path, 7.0), plan(tmp_path / "c.plan", (10, -40, 15), home=(10, 0))]
    own = ("--set", "vehicle-3:vehicle.aircraft.battery.initial=0.5")
    assert fly(*plans, "--after", 2, "--out", tmp_path / "one", *own, *QUICK) == 0
    logs = [tmp_path / "one" / f"vehicle-{i}" / "flight.mcap" for i in (1, 2, 3)]
    found = json.loads((tmp_path / "one" / "separation.json").read_text())
    pairs = {tuple(pair["pair"]): pair for pair in found["pairs"]}
    assert set(pairs) == {(f"vehicle-{i}", f"vehicle-{j}") for i, j in ((1, 2), (1, 3), (2, 3))}
    for i, j in ((1, 2), (1, 3), (2, 3)):
        least_m, t_s = independent([logs[i - 1], logs[j - 1]])
        pair = pairs[f"vehicle-{i}", f"vehicle-{j}"]
        assert pair["least_m"] == pytest.approx(least_m, abs=0.01)
        assert pair["t_s"] == pytest.approx(t_s, abs=0.1)
    begun = [read_log(log).flown_events[0].t_ns * 1e-9 for log in logs]
    assert [t - begun[0] for t in begun] == pytest.approx([0.0, 2.0, 4.0], abs=0.05)
    charges = [read_log(log).battery.remaining[0] for log in logs]
    assert charges == pytest.approx([1.0, 1.0, 0.5], abs=0.05)
    for i, source in enumerate(plans):
        summary = json.loads((logs[i].parent / "summary.json").read_text())
        assert (summary["status"], summary["plan"]) == ("finished", source.name)


def test_those_that_meet_are_lost_and_the_third_is_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plans = [plan(tmp_path / f"{n}.plan", (0, 60, 20), home=(5 * n, 0)) for n in range(2)]
    plans.append(plan(tmp_path / "c.plan", (10, -40, 15), home=(10, 0)))
    exact = ("--set", "vehicle.aircraft.sensors.kind=perfect")
    assert fly(*plans, "--out", tmp_path / "r", *exact, *QUICK) == 4
    said = capsys.readouterr().err
    assert "vehicle-1: the aircraft is lost" in said
    assert "vehicle-2: the aircraft is lost" in said
    assert "vehicle-3" not in said
    ends = [
        json.loads((tmp_path / "r" / f"vehicle-{i}" / "summary.json").read_text())["status"]
        for i in (1, 2, 3)
    ]
    assert ends == ["failed", "failed", "finished"]
    found = json.loads((tmp_path / "r" / "separation.json").read_text())
    assert [each["pair"] for each in found["collisions"]] == [["vehicle-1", "vehicle-2"]]


def statuses(out: Path) -> list[str]:
    each = (out, out / "vehicle-1", out / "vehicle-2")
    return [json.loads((one / "summary.json").read_text())["status"] for one in each]


def test_an_interruption_in_flight_is_that_of_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def cut_off(
        simulation: Simulation, departures: Mapping[str, Departure]
    ) -> Mapping[str, AerofedError]:
        flying = asyncio.ensure_future(fly_together(simulation, departures))
        while simulation.world.t_ns < 12e9:  # noqa: ASYNC110  time is of the world's making
            await asyncio.sleep(0)
        flying.cancel()
        return await flying

    monkeypatch.setattr("mission.run.together_flight.fly_together", cut_off)
    assert fly(*crossing(tmp_path, 7.0), "--out", tmp_path / "r", *QUICK) == 130
    assert statuses(tmp_path / "r") == ["interrupted"] * 3


def test_an_interruption_while_pictures_are_drawn_is_one_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of further vehicles none are drawn, and nothing is judged."""
    drawn = []

    def draw(folder: Path) -> None:
        drawn.append(folder.name)
        raise KeyboardInterrupt

    monkeypatch.setattr("mission.figures.run.draw_run", draw)
    limit = ("--limit", "separation_min_m=1")
    assert fly(*crossing(tmp_path, 7.0), "--out", tmp_path / "r", *limit) == 130
    assert capsys.readouterr().out.endswith("\ninterrupted\n")
    assert drawn == ["vehicle-1"]
    assert statuses(tmp_path / "r") == ["interrupted", "interrupted", "finished"]


def test_one_that_cannot_be_armed_is_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It has a log, in which nothing is to be drawn."""
    empty = ("--set", "vehicle-2:vehicle.aircraft.battery.initial=0.02")
    assert fly(*crossing(tmp_path, 7.0), "--out", tmp_path / "r", "--no-report", *empty) == 4
    said = "aerofed: vehicle-2: the vehicle cannot be armed: battery critical; the files are in "
    assert capsys.readouterr().err == f"{said}{tmp_path}/r\n"
    assert statuses(tmp_path / "r") == ["failed", "finished", "failed"]


@pytest.mark.parametrize(("east_m", "after_s"), [(20, 60), (9000, 0)])
def test_those_that_could_not_meet_have_their_page_and_verdict(
    east_m: int, after_s: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One is down before the other begins, or they fly 9 km apart."""
    plans = [plan(tmp_path / f"{x}.plan", (x, 9, 5), home=(x, 0)) for x in (0, east_m)]
    limit, out = ("--limit", "separation_min_m=5"), tmp_path / "r"
    asked = ("--after", after_s, "--no-figures", *limit, "--out", out)
    assert fly(*plans, *asked) == 0
    assert (out / "together.html").is_file()
    met = "1 limit met by all" + ", but no two were in the air at the same time" * (after_s > 0)
    assert capsys.readouterr().out.endswith(f"\n{met}\n")
    assert call(["compare", str(out), *limit]) == 0
    assert capsys.readouterr().out.endswith(f"\n{met}\n")


def test_one_that_misses_its_end_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def second_without(path: Path) -> LoadedRun:
        run = load_run(path)
        return without_its_end(run) if path.name == "vehicle-2" else run

    monkeypatch.setattr("mission.run.plan_flight.load_run", second_without)
    plans = [plan(tmp_path / f"{n}.plan", (0, 10, 5), home=(30 * n, 0)) for n in range(2)]
    out = tmp_path / "out"
    assert fly(*plans, "--out", out, *QUICK) == 4
    assert "aerofed: vehicle-2: item 2 was never reached" in capsys.readouterr().err
    ends = [json.loads((out / f"vehicle-{i}" / "summary.json").read_text()) for i in (1, 2)]
    assert [end["status"] for end in ends] == ["finished", "failed"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--after", "-1"), "--after -1: simulated seconds"),
        (("--vehicle", "udpin://0.0.0.0:14540"), "2 plans: flown by the built-in autopilot"),
        (("--set", "vehicle-3:seed=2"), "no vehicle 'vehicle-3' of these: vehicle-1, vehicle-2"),
    ],
)
def test_what_is_refused(
    options: tuple[str, ...], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plans = crossing(tmp_path)
    assert fly(*plans, *options) == 2
    refused(capsys, words)


def test_homes_on_top_of_each_other_and_options_of_several_for_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, _ = crossing(tmp_path)
    assert fly(one, one) == 2
    refused(capsys, "vehicle-1 and vehicle-2 stand 0.00 m apart", "give them homes farther apart")
    for options in (("--after", "3"), ("--set", "a:seed=3")):
        assert fly(one, *options) == 2
        refused(capsys, "for several plans")
