"""Experiments of several aircraft of which some, or all, are lost before a first round is over."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import small_runs
from described import charts

import aerofed
from mission.analysis.several import load_several
from mission.analysis.together import Together
from mission.base.errors import InputError
from mission.cli import call
from mission.figures.learning import learning_charts
from mission.figures.run import comparison_figure, fleet_pictures
from mission.figures.style import Chart
from mission.figures.together import timetable
from mission.run.recorder import FolderRecorder

pytestmark = pytest.mark.slow

BROKEN = '{{aircraft={{faults=[{{kind="motor_loss", at_s={}}}]}}}}'


def play(out: Path, vehicles: str, *keys: str) -> int:
    more = [word for key in (f"vehicles=[{vehicles}]", *keys) for word in ("--set", key)]
    words = small_runs.last_counts(*small_runs.SMALL, *more)
    return call(["run", "--out", str(out), "--rounds", "2", *words])


def judged(out: Path) -> Together:
    return load_several((out,)).together


def drawn_rows(chart: Chart) -> list[dict[str, object]]:
    return [row for values in chart["datasets"].values() for row in values]


@pytest.fixture(scope="module")
def first_lost(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of two the first falls before the second takes off."""
    out = tmp_path_factory.mktemp("runs") / "run"
    assert play(out, BROKEN.format(6) + ", {}") == 0
    return out


def test_all_that_are_lost_in_the_first_round_are_looked_into(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert play(out, ", ".join([BROKEN.format(30)] * 2)) == 4
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.startswith("aerofed: round 1, t ")
    assert [*fleet_pictures(out)] == ["map.png", "apart.png", "timetable.png"]
    assert call(["compare", str(out), "--json", "--limit", "separation_min_m=1"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [len(found["flights"]), len(found["pairs"])] == [2, 1]
    assert found["pairs"][0]["separation_min_m"] == pytest.approx(5.0, abs=1.5)
    assert call(["compare", str(out), "--limit", "slots_missed=0"]) == 6  # nobody knows
    assert call(["report", str(out)]) == 0


def test_none_that_left_the_ground_is_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert play(out, BROKEN.format(0) + ", {}", "mission.when_lost=end") == 4
    capsys.readouterr()
    assert call(["compare", str(out)]) == 2
    said = capsys.readouterr().err
    assert said == (
        f"aerofed: {out}/vehicle-uav1: it never left the ground, so there is nothing to compare\n"
    )


EMPTY = "{aircraft={battery={initial=0.02}}}"


def test_one_that_cannot_be_armed_is_lost_by_its_own_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At once, as time stands still, and nothing will change; the others go on."""
    said = list[str]()
    monkeypatch.setattr(FolderRecorder, "notice", lambda _, text, **__: said.append(text))
    assert play(tmp_path, f"{{}}, {EMPTY}") == 0
    lost = "take-off: uav2: the vehicle cannot be armed: battery critical; uav1 goes on"
    assert [line for line in said if "take-off" in line] == [lost]


def test_a_take_off_that_ends_on_the_ground_is_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The battery is looked at once it is armed, and has it land."""
    assert play(tmp_path, EMPTY) == 4
    assert (
        "the vehicle did not climb to 30 m and hold there (it said: Battery almost empty: 2 % left"
    ) in capsys.readouterr().err


def test_who_is_left_alone_has_its_page_and_pictures(first_lost: Path) -> None:
    assert call(["report", str(first_lost)]) == 0
    page = (first_lost / "report.html").read_text()
    assert "vehicle-uav2" in page
    assert len(charts(page)) > 2
    assert [*fleet_pictures(first_lost)] == ["map.png", "timetable.png", "learning.png"]
    found = load_several((first_lost,))
    assert len(found.flights) == 2
    assert not found.together.pairs
    assert comparison_figure(found.flights, found.world)


def test_python_reads_a_run_of_several(first_lost: Path) -> None:
    """What all did together, from the folder; of one, a line says where it is."""
    run = aerofed.load(first_lost)
    for name in ("rounds", "uplinks", "aircraft", "learning"):
        written = pd.read_csv(first_lost / f"{name}.csv", keep_default_na=False, na_values="nan")
        told = getattr(run, name)
        assert (len(told), [*told]) == (len(written), [*written]), name
    pd.testing.assert_frame_equal(run.rounds, pd.read_csv(first_lost / "rounds.csv"))
    assert {*run.uplinks["aircraft"]} == {"uav2"}
    assert run.summary["vehicles"] == ["vehicle-uav1", "vehicle-uav2"]
    assert (run.status, run.summary["seed"], len(run.config.aircraft)) == ("finished", 1, 2)
    assert len(aerofed.compare(run).flights) == 2
    assert run.figure("timetable").name == "timetable"
    with pytest.raises(InputError, match=r"no figure 'rounds'; there are: 'map', 'timetable'"):
        run.figure("rounds")
    with pytest.raises(InputError, match=r"'track' is in the log of each .*/vehicle-uav1$"):
        _ = run.track
    assert len(aerofed.load(first_lost / "vehicle-uav2").track)


def test_it_is_said_who_was_lost_when_and_why(
    first_lost: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By `compare` and on the page; not of who came home."""
    assert call(["report", str(first_lost)]) == 0
    assert call(["compare", str(first_lost)]) == 0
    (line,) = (one for one in capsys.readouterr().out.splitlines() if ": lost at " in one)
    assert re.fullmatch(r"vehicle-uav1: lost at \d+\.\d s: Crashed: hit the ground at .+ m/s", line)
    assert line in (first_lost / "report.html").read_text()


def test_a_limit_of_distance_that_nobody_could_break_is_said(
    first_lost: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["compare", str(first_lost), "--limit", "separation_min_m=5"]
    assert call(asked) == 0
    met = "1 limit met by all, but no two were in the air at the same time"
    assert capsys.readouterr().out.endswith(f"{met}\n")
    assert call([*asked, "--limit", "faults=1"]) == 0
    assert capsys.readouterr().out.endswith(met.replace("1 limit", "2 limits") + "\n")


def test_what_was_learnt_is_told_beyond_a_loss(first_lost: Path) -> None:
    """By who knows all rounds, and of the experiment, not of one aircraft."""
    chart = fleet_pictures(first_lost)["learning.png"]
    accuracy = [row for row in drawn_rows(chart) if row.get("series") == "digits"]
    assert {row["x"] for row in accuracy} == {0, 1, 2}
    assert str(chart["title"]).count(f"{first_lost.name} · ") == 1


def test_a_wreck_does_nothing(first_lost: Path) -> None:
    """On the ground an aircraft waits for nobody."""
    spans = [row for row in drawn_rows(timetable(judged(first_lost))) if "kind" in row]
    of_each = {
        name: [row for row in spans if row["vehicle"] == f"vehicle-{name}"]
        for name in ("uav1", "uav2")
    }
    fell_s = max(float(str(row["end"])) for row in of_each["uav1"])
    assert fell_s < min(float(str(row["begin"])) for row in of_each["uav2"])


def test_a_device_that_two_were_to_serve_is_one_of_a_round(first_lost: Path) -> None:
    *_, run = (flight.run.data for flight in load_several((first_lost,)).flights)
    again = replace(run, uplinks=tuple(replace(u, delivered=False) for u in run.uplinks))
    *_, updates = learning_charts(run, [again])
    told = [(row["series"], row["x"], row["y"]) for row in drawn_rows(updates)]
    assert sorted(told) == sorted(
        (name, record.round, getattr(record, name))
        for record in run.rounds
        for name in ("scheduled", "delivered")
    )
