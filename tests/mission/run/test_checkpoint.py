"""A killed run goes on and ends like one that was never killed."""

import json
import random
import shutil
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from forked import Forked
from patience import until
from small_runs import digests, refused, rows
from test_run import SMALL, UNFLOWN, fly

import aerofed
from mission.base.run_folder import RunFolder
from mission.cli import call
from mission.run.resume import SEAL, sealed

ROUNDS = 2


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole") / "run"
    assert fly(out, rounds=ROUNDS) == 0
    return out


@pytest.fixture(scope="module")
def unflown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For what goes wrong before the first flight."""
    out = tmp_path_factory.mktemp("unflown") / "run"
    assert fly(out, *UNFLOWN, rounds=ROUNDS) == 0
    return out


def killed(out: Path, *, after_rounds: int, delay_s: float) -> None:
    """Start a run and kill it without warning, some time after it finished so many rounds."""
    process = Forked("run", "--out", str(out), "--rounds", str(ROUNDS), *SMALL)

    def far_enough() -> bool:
        return (out / "uplinks.csv").exists() and len(rows(out / "rounds.csv")) >= after_rounds

    until(lambda: process.poll() is not None or far_enough(), poll_s=0.01)
    time.sleep(delay_s)
    process.send_signal(signal.SIGKILL)
    process.ended()


# 20 of these were killed at random moments by hand; CI has time for a few.
@pytest.mark.slow
@pytest.mark.parametrize("after_rounds", [0, 1])
def test_resume_after_a_kill_ends_the_same(whole: Path, tmp_path: Path, after_rounds: int) -> None:
    out = tmp_path / "killed"
    killed(out, after_rounds=after_rounds, delay_s=random.Random(after_rounds).uniform(0.0, 0.3))
    assert call(["run", "--resume", str(out), "--quiet"]) == 0
    assert digests(out) == digests(whole)
    assert json.loads((out / "summary.json").read_text())["status"] == "finished"


def kill_writing(nth: int, command: Sequence[str]) -> None:
    """Run a command, killed when it is about to have the nth of its writes on the disk."""
    code, _, errors = Forked(*command, killed_at=nth).ended()
    assert code == -signal.SIGKILL, errors


# The configuration, the learning's state and the first checkpoint are what is written first.
@pytest.mark.slow
def test_the_same_command_begins_again_what_died_before_its_first_checkpoint(
    unflown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outs = {nth: tmp_path / f"killed{nth}" for nth in (1, 3)}
    more = ("--rounds", str(ROUNDS), *SMALL, *UNFLOWN)
    commands = {nth: ["run", "--out", str(out), *more] for nth, out in outs.items()}
    for nth, out in outs.items():
        kill_writing(nth, commands[nth])
        assert out.exists()
        assert call(["run", "--resume", str(out)]) == 2
        refused(capsys, "ended before its first checkpoint; the command that began it begins it ")
        assert call(commands[nth]) == 0
        assert digests(out) == digests(unflown)


def test_a_folder_of_somebody_elses_is_not_taken_for_a_run_that_died(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "config.toml").write_text("mine = true")
    assert call(["run", "--out", str(tmp_path)]) == 2
    refused(capsys, "already used")
    (tmp_path / "checkpoint").mkdir()
    (tmp_path / "checkpoint" / ".lock").touch()
    (tmp_path / "mine.txt").touch()
    assert call(["run", "--out", str(tmp_path)]) == 2
    refused(capsys, "already used")
    assert (tmp_path / "config.toml").read_text() == "mine = true"


@pytest.mark.slow
def test_a_run_that_can_go_on_is_said_to(stopped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["run", "--out", str(stopped)]) == 2
    refused(
        capsys,
        f"already used; give a new or empty one, or go on with it: aerofed run --resume {stopped}",
    )


def of_so_many(out: Path, whole: Path) -> None:
    """See that a run that was lengthened is one that began with so many rounds."""
    assert digests(out) == digests(whole)
    assert (out / "config.toml").read_bytes() == (whole / "config.toml").read_bytes()
    named = {path.name for path in (out / "plans").iterdir()}
    assert named == {path.name for path in (whole / "plans").iterdir()}
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["status"], summary["rounds"]) == ("finished", ROUNDS)
    assert not (out / "checkpoint" / "interrupted").exists()


@pytest.mark.slow
def test_a_finished_run_is_lengthened_as_if_it_had_begun_so(
    unflown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "short"
    assert fly(out, *UNFLOWN, rounds=1) == 0
    assert call(["run", "--resume", str(out), "--rounds", str(ROUNDS), "--quiet"]) == 0
    of_so_many(out, unflown)
    assert call(["run", "--resume", str(out), "--rounds", str(ROUNDS)]) == 0
    assert "nothing to resume; --rounds N gives it more" in capsys.readouterr().out
    assert call(["run", "--resume", str(out), "--rounds", "1"]) == 2
    refused(capsys, f"--rounds 1: {out} has {ROUNDS} rounds already; give more")
    assert call(["run", "--resume", str(out), "--rounds", "1000000"]) == 2
    refused(capsys, "--rounds 1000000: must be less than or equal to 100000")
    of_so_many(out, unflown)


@pytest.mark.slow
def test_killed_while_it_is_lengthened_it_goes_on(unflown: Path, tmp_path: Path) -> None:
    short = tmp_path / "short"
    assert fly(short, *UNFLOWN, rounds=1) == 0
    for nth in range(1, 7):
        shutil.copytree(short, out := tmp_path / f"short{nth}")
        longer = ["run", "--resume", str(out), "--rounds", str(ROUNDS), "--quiet"]
        kill_writing(nth, longer)
        assert call(longer) == 0
        of_so_many(out, unflown)


@pytest.mark.slow
def test_python_lengthens_a_run_that_was_begun_with_more(unflown: Path, tmp_path: Path) -> None:
    out = tmp_path / "long"
    kill_writing(9, ["run", "--out", str(out), "--rounds", "50", *SMALL, *UNFLOWN])
    done = len(json.loads((out / "checkpoint" / "rounds.json").read_text())["rounds"])
    assert done <= ROUNDS
    assert aerofed.resume(out, rounds=2).status == "finished"
    of_so_many(out, unflown)


@pytest.mark.slow
def test_a_finished_run_needs_no_resume(whole: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = digests(whole)
    assert call(["run", "--resume", str(whole)]) == 0
    assert "nothing to resume" in capsys.readouterr().out
    assert digests(whole) == before


@pytest.fixture
def stopped(whole: Path, tmp_path: Path) -> Path:
    """A run that says it is still running."""
    out = tmp_path / "stopped"
    shutil.copytree(whole, out)
    summary = json.loads((out / "summary.json").read_text()) | {"status": "running"}
    (out / "summary.json").write_text(json.dumps(summary))
    return out


def test_resume_refuses_a_changed_configuration(
    stopped: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = stopped / "config.toml"
    path.write_text(path.read_text().replace("steps = 5", "steps = 6"))
    assert call(["run", "--resume", str(stopped)]) == 2
    refused(capsys, "config.toml", "changed")


def test_resume_refuses_a_damaged_checkpoint(
    stopped: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (state,) = (stopped / "checkpoint").glob("*.bin")
    state.write_bytes(state.read_bytes()[:-3] + b"abc")
    assert call(["run", "--resume", str(stopped)]) == 2
    refused(capsys, state.name, "damaged", f"it anew in another folder, aerofed run {stopped}")


def unsealed(path: Path) -> dict[str, Any]:
    values = json.loads(path.read_text())
    del values[SEAL]
    return dict(values)


@pytest.mark.parametrize(
    "change",
    [
        lambda v: v["rounds"][0]["learnt"]["accuracy"].update(digits=0.99),  # a made-up accuracy
        lambda v: v["rounds"][0].update(learnt={}),
        lambda v: v["rounds"][0].update(sortie=None),
        lambda v: v.update(rounds=[]),
        lambda v: v.update(learning="../../../etc/passwd"),
        lambda v: v.update(sha256=None),
        lambda v: v.pop("sha256"),
        lambda v: v.update(libraries=[]),
    ],
)
def test_resume_refuses_an_edited_checkpoint(
    stopped: Path, capsys: pytest.CaptureFixture[str], change: Callable[[dict[str, Any]], object]
) -> None:
    path = stopped / "checkpoint" / "rounds.json"
    values = json.loads(path.read_text())
    change(values)
    path.write_text(json.dumps(values))
    before = digests(stopped)
    assert call(["run", "--resume", str(stopped)]) == 2
    refused(capsys, "rounds.json: damaged: its checksum differs")
    assert digests(stopped) == before


@pytest.mark.parametrize("content", ["[" * 100_000, '{"a":' * 100_000, "\0", "1" * 5_000])
def test_resume_refuses_what_is_no_json(
    stopped: Path, capsys: pytest.CaptureFixture[str], content: str
) -> None:
    (stopped / "checkpoint" / "rounds.json").write_text(content)
    assert call(["run", "--resume", str(stopped)]) == 2
    way_out = f"begin it anew in another folder, aerofed run {stopped / 'config.toml'}\n"
    refused(capsys, "rounds.json: damaged: not valid JSON, so it was changed or cut short", way_out)


def test_resume_refuses_other_versions(stopped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = stopped / "checkpoint" / "rounds.json"
    values = unsealed(path)
    values["libraries"]["jsbsim"] = "0.9"
    path.write_bytes(sealed(values))
    assert call(["run", "--resume", str(stopped)]) == 2
    refused(capsys, "versions of libraries differ: jsbsim was 0.9, is ")


@pytest.mark.slow
def test_resume_says_when_a_round_cannot_be_flown_again_alike(
    stopped: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = stopped / "checkpoint" / "rounds.json"
    values = unsealed(path)
    values["rounds"][0]["true_objective"] += 1e-12
    path.write_bytes(sealed(values))
    assert call(["run", "--resume", str(stopped), "--quiet"]) == 4
    refused(capsys, "round 1, t ", "flown again, the round differs")


def test_resume_refuses_another_format(stopped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = stopped / "checkpoint" / "rounds.json"
    values = json.loads(path.read_text())
    values["format"], values["libraries"]["aerofed"] = 9, "7.0"
    path.write_text(json.dumps(values))
    assert call(["run", "--resume", str(stopped)]) == 2
    refused(capsys, "of format 9, written by aerofed 7.0", "reads format 5")


@pytest.mark.parametrize("content", ["[]", "{}", "{", '{"libraries": {}}'])
def test_resume_refuses_another_file(
    stopped: Path, capsys: pytest.CaptureFixture[str], content: str
) -> None:
    (stopped / "checkpoint" / "rounds.json").write_text(content)
    assert call(["run", "--resume", str(stopped)]) == 2
    refused(capsys, "rounds.json: damaged")


@pytest.mark.parametrize(
    ("made", "given", "words"),
    [
        (
            "run/x.txt",
            "run",
            "not a folder that aerofed run left: it has no checkpoint/rounds.json",
        ),
        ("run/sweep.json", "run", "it holds a sweep"),
        ("run/checkpoint/rounds.json", "run/checkpoint", "it is the checkpoint itself; give "),
        ("run/x.txt", "run/x.txt", "a file; give the folder that aerofed run left"),
        ("run/x.txt", "other", "no such folder"),
    ],
)
def test_resume_of_what_is_no_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], made: str, given: str, words: str
) -> None:
    (tmp_path / made).parent.mkdir(parents=True)
    (tmp_path / made).touch()
    assert call(["run", "--resume", str(tmp_path / given)]) == 2
    refused(capsys, f"{tmp_path / given}", words)


def test_no_two_runs_in_one_folder(stopped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = digests(stopped)
    with RunFolder(stopped).lock():
        assert call(["run", "--resume", str(stopped)]) == 2
    refused(
        capsys, str(stopped), "aerofed run is at work in this folder; wait until it has ended\n"
    )
    assert digests(stopped) == before


@pytest.mark.parametrize("other", [["--seed", "3"], ["--no-report"]])
def test_resume_takes_no_other_setting(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], other: list[str]
) -> None:
    assert call(["run", "--resume", str(tmp_path), *other]) == 2
    refused(capsys, f"--resume takes no other setting, and not {other[0]}:")
