"""Whole sweeps: real flights in worker processes, interrupted, killed, repeated and compared."""

import errno
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future
from pathlib import Path

import pytest
from drawing import outlined
from joblib.externals.loky.backend.queues import Queue
from joblib.externals.loky.process_executor import TerminatedWorkerError
from patience import HANG_S, until
from processes import writer_of
from small_runs import LOW, QUIET, refused, rows

from mission.base.errors import FlightError
from mission.cli import call
from mission.commands.options import load
from mission.sweep.execute.local import LocalEngine
from mission.sweep.execute.worker import RunEnd, RunOrder, execute

TINY = (
    "--set", "mission.steps=3", "mission.path_budget_m=100", "planner.gap=0.1",
    "learning.local_epochs=1", "communities.0.subset=0.2", "communities.1.subset=0.2",
    "communities.0.devices=2", "communities.1.devices=2",
    "communities.0.labels_per_device=5", "communities.1.labels_per_device=5", *LOW,
)  # fmt: skip
TABLES = ("runs.csv", "rounds.csv")
PROCFS = Path("/proc/self/fd")


def command(out: Path, *more: str, rounds: int = 2, seeds: int = 2) -> list[str]:
    return [
        "sweep", "configs/quickstart.toml", "--out", str(out), "--rounds", str(rounds),
        "--seeds", str(seeds), "--strategies", "cov,ideal", *TINY, *more,
    ]  # fmt: skip


def tables(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in TABLES}


class Inline:
    """Executes in this process, at once."""

    slots = 1

    def start(self, order: RunOrder) -> None:
        self.ended: dict[str, RunEnd | None] = {order.name: execute(order)}

    def wait(self, timeout_s: float) -> dict[str, RunEnd | None]:  # noqa: ARG002
        return self.ended

    def close(self) -> None: ...


def call_inline(tokens: list[str]) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mission.sweep.execute.engine.EngineChoice.make", lambda *_, **__: Inline())
        return call(tokens)


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two strategies and two seeds, without worker processes: what every engine has to find."""
    out = tmp_path_factory.mktemp("sweeps") / "one"
    with outlined():
        assert call_inline(command(out)) == 0
    return out


@pytest.mark.slow
def test_a_sweep_leaves_runs_tables_and_figures(swept: Path) -> None:
    runs, rounds = rows(swept / "runs.csv"), rows(swept / "rounds.csv")
    assert [(run["strategy"], run["seed"]) for run in runs] == [
        ("cov", "1"), ("ideal", "1"), ("cov", "2"), ("ideal", "2"),
    ]  # fmt: skip
    assert len(rounds) == 8
    for run in runs:
        folder = swept / "runs" / run["run"]
        own = rows(folder / "rounds.csv")
        mine = [r for r in rounds if (r["strategy"], r["seed"]) == (run["strategy"], run["seed"])]
        assert [r["accuracy_digits"] for r in mine] == [r["accuracy_digits"] for r in own]
        assert run["final_accuracy_digits"] == own[-1]["accuracy_digits"]
        assert int(run["delivered"]) == sum(int(r["delivered"]) for r in own)
        assert float(run["participation"]) == pytest.approx(int(run["delivered"]) / 8)
        assert json.loads((folder / "summary.json").read_text())["status"] == "finished"
        assert (folder / "figures" / "learning.png").is_file()
    ideal = next(run for run in runs if run["strategy"] == "ideal")
    assert (ideal["participation"], ideal["true_per"], ideal["flown_m"]) == ("1.0", "nan", "0.0")
    assert {path.name for path in (swept / "figures").iterdir()} == {
        "accuracy-rounds.png", "accuracy-distance.png", "accuracy-time.png", "participation.png",
        "per.png", "fairness.png", "final.png", "gains.png",
    }  # fmt: skip


@pytest.mark.slow
def test_a_run_of_a_sweep_is_an_ordinary_run(swept: Path, tmp_path: Path) -> None:
    config = swept / "runs" / "cov-seed2" / "config.toml"
    assert call(["run", str(config), "--out", str(tmp_path / "alone"), *QUIET]) == 0
    for name in ("rounds.csv", "aircraft.csv", "uplinks.csv", "flight.mcap"):
        alone = (tmp_path / "alone" / name).read_bytes()
        assert (swept / "runs" / "cov-seed2" / name).read_bytes() == alone


@pytest.mark.slow
def test_a_finished_sweep_flies_nothing_again(
    swept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = tables(swept)
    flown = {path: path.stat().st_mtime_ns for path in swept.glob("runs/*/*")}
    assert call(command(swept)) == 0
    assert tables(swept) == before
    assert {path: path.stat().st_mtime_ns for path in swept.glob("runs/*/*")} == flown
    printed = capsys.readouterr().out
    assert "cov" in printed
    assert "digits" in printed


@pytest.mark.slow
def test_a_changed_sweep_is_one_line(swept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for more in ([], ["--json"]):
        assert call(command(swept, *more, rounds=5)) == 2
        refused(capsys, "mission.rounds was 2, is 5")  # and not what the sweep before it found


@pytest.mark.slow
@pytest.mark.skipif(not PROCFS.exists(), reason="needs Linux's list of child processes")
def test_a_killed_worker_s_run_is_repeated(
    swept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "killed"

    def kill() -> None:
        log = out / "runs" / "cov-seed1" / "flight.mcap"
        until(lambda: log.is_file() and log.stat().st_size > 0)
        os.kill(writer_of(log), signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    code = call(command(out, "--jobs", "2", "--no-run-figures", "--no-report"))
    killer.join()
    assert code == 0
    printed = capsys.readouterr().out
    assert printed.count("its worker died") == 1  # it took no other with it
    assert "cov-seed1: its worker died; another takes the run" in printed
    # And two workers find what this process found, killed or not, and without figures of runs.
    assert tables(out) == tables(swept)
    assert not list((out / "runs").glob("*/figures"))
    assert (out / "figures" / "final.png").is_file()


@pytest.mark.slow
def test_ctrl_c_ends_it_and_the_same_command_goes_on(swept: Path, tmp_path: Path) -> None:
    out = tmp_path / "cut"
    tokens = command(out, "--jobs", "1", "--no-run-figures", "--no-report", seeds=1)
    process = subprocess.Popen(
        [sys.executable, "-m", "mission", *tokens],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    first = out / "runs" / "cov-seed1"
    until((first / "flight.mcap").is_file)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
    printed, errors = process.communicate(timeout=HANG_S)
    assert process.returncode == 130, errors
    assert errors == ""
    assert "interrupted; 0 of 2 runs are done; the same command goes on from here" in printed
    assert json.loads((first / "summary.json").read_text())["status"] == "running"
    # No worker goes on in the background.
    size = (first / "flight.mcap").stat().st_size
    time.sleep(0.5)
    assert (first / "flight.mcap").stat().st_size == size
    assert call_inline(tokens) == 0
    for name in ("runs.csv", "rounds.csv"):
        assert rows(out / name) == [row for row in rows(swept / name) if row["seed"] == "1"]


@pytest.mark.slow
def test_a_sweep_that_is_not_over_tells_what_is_missing(
    swept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = tmp_path / "part"
    shutil.copytree(swept, part)
    shutil.rmtree(part / "runs" / "ideal-seed2")
    summary = part / "runs" / "cov-seed2" / "summary.json"
    summary.write_text(json.dumps({"status": "running"}))
    assert call(["report", str(part)]) == 0
    page = (part / "report.html").read_text()
    assert "cov-seed2</td><td>begun: at work, or cut off, after 2 rounds" in page
    assert "ideal-seed2</td><td>not begun" in page
    (part / "runs" / "cov-seed1" / "uplinks.csv").write_text("nothing\n")
    assert call(["report", str(part)]) == 2
    assert "uplinks.csv" in capsys.readouterr().err


def test_the_ideal_has_the_rounds_that_the_budget_pays_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ("mission.strategy=ideal", "mission.total_budget_m=250", "--rounds", "9")
    assert call(["run", "--out", str(tmp_path / "ideal"), *TINY, *more]) == 0
    used = [float(row["budget_used_m"]) for row in rows(tmp_path / "ideal" / "rounds.csv")]
    assert used == [100.0, 200.0]
    *_, totals, times, _ = capsys.readouterr().out.splitlines()
    assert totals == "2 rounds, nothing flown, 8/8 updates delivered"
    assert " s: setup " in times
    assert len(times) <= 80, "one line of a terminal"


class Deadly(Inline):
    """Its workers always die."""

    def start(self, order: RunOrder) -> None:
        self.ended = {order.name: None}


def test_a_run_whose_worker_always_dies_is_given_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mission.sweep.execute.engine.EngineChoice.make", lambda *_, **__: Deadly())
    assert call(command(tmp_path / "dead", seeds=1)) == 1
    printed = capsys.readouterr()
    assert printed.out.count("cov-seed1: its worker died; another takes the run") == 2
    assert "run cov-seed1 failed: its worker died 3 times" in printed.err
    assert "run ideal-seed1 failed" in printed.err


@pytest.mark.slow
def test_a_run_that_fails_is_named_and_the_others_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "diverged"
    tokens = command(out, "--set", "learning.learning_rate=0.01,10", "--jobs", "1", seeds=1)
    assert call_inline([token.replace("cov,ideal", "ideal") for token in tokens]) == 4
    printed = capsys.readouterr()
    assert "run ideal-learning_rate=10-seed1 failed" in printed.err
    assert "learning diverged" in printed.err
    assert "1 of 2 runs are done; missing: ideal-learning_rate=10-seed1." in printed.out
    assert [run["learning.learning_rate"] for run in rows(out / "runs.csv")] == ["0.01"]
    assert call(["report", str(out)]) == 0
    assert "<td>failed: learning diverged" in (out / "report.html").read_text()


@pytest.mark.slow
def test_a_run_whose_folder_cannot_be_replaced_is_named_and_the_others_go_on(
    swept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = tmp_path / "part"
    shutil.copytree(swept, part)
    for name in ("ideal-seed1", "ideal-seed2"):
        shutil.rmtree(part / "runs" / name)
    in_the_way = part / "runs" / "ideal-seed1"
    in_the_way.write_text("no folder")
    assert call_inline(command(part)) == 2
    printed = capsys.readouterr()
    assert (
        f"run ideal-seed1 failed: {in_the_way}: cannot write the output folder: Not a directory"
        in printed.err
    )
    assert "run 4/4 ideal-seed2: 2 rounds" in printed.out
    assert {row["run"] for row in rows(part / "runs.csv")} == {
        "cov-seed1", "cov-seed2", "ideal-seed2",
    }  # fmt: skip
    in_the_way.unlink()
    assert call_inline(command(part)) == 0
    assert tables(part) == tables(swept)


def test_a_full_disk_is_the_end_of_a_run_and_not_of_the_sweep(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fly_session(*_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("mission.run.session.fly_session", fly_session)
    out = tmp_path / "full"
    assert call_inline(command(out, seeds=1)) == 2
    errors = capsys.readouterr().err
    for name in ("cov-seed1", "ideal-seed1"):
        assert f"run {name} failed: {out}/runs/{name}: No space left on device" in errors


def test_a_single_run_that_fails_says_why_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fly_session(*_: object, **__: object) -> int:
        raise FlightError("a tree")

    monkeypatch.setattr("mission.run.session.fly_session", fly_session)
    tokens = command(tmp_path / "one", seeds=1)
    assert call_inline([token.replace("cov,ideal", "ideal") for token in tokens]) == 4
    printed = capsys.readouterr()
    assert (printed.out + printed.err).count("a tree") == 1
    assert "1 run, 1 at a time" in printed.out
    assert call_inline([*command(tmp_path / "two", seeds=1), "--json"]) == 4
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("a tree")) == ("", 2)


@pytest.mark.slow
def test_the_engine_is_closed_where_the_sweep_cannot_begin(
    swept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    closed = []

    class Noted(Inline):
        def close(self) -> None:
            closed.append(self)

    monkeypatch.setattr("mission.sweep.execute.engine.EngineChoice.make", lambda *_, **__: Noted())
    part = tmp_path / "part"
    shutil.copytree(swept, part)
    shutil.rmtree(part / "runs" / "ideal-seed2")
    (part / "runs" / "cov-seed1" / "uplinks.csv").write_text("nothing\n")
    file = part / "runs" / "cov-seed1" / "summary.json"  # as an earlier version left it
    summary = json.loads(file.read_text())
    file.write_text(json.dumps({key: summary[key] for key in summary if key != "sha256"}))
    assert call(command(part)) == 2
    assert "uplinks.csv" in capsys.readouterr().err
    assert len(closed) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("rounds.csv", "\n1,", "\n2,", "altered"),
        ("uplinks.csv", "0.", "0.1", "altered"),
        ("learning.csv", "0.", "0.9", "altered"),
        ("devices.csv", ",", ",1", "altered"),
        ("config.toml", "seed = 1", "seed = 2", "altered"),
        ("learning.csv", "", "", "gone"),
    ],
)
def test_an_altered_file_of_a_finished_run_is_found(
    swept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    name: str, old: str, new: str, words: str,
) -> None:  # fmt: skip
    part = tmp_path / "part"
    shutil.copytree(swept, part)
    file = part / "runs" / "cov-seed1" / name
    digest = json.loads((file.parent / "summary.json").read_text())["sha256"][name]
    assert digest == hashlib.sha256(file.read_bytes()).hexdigest()
    if words == "gone":
        file.unlink()
    else:
        text = file.read_text()
        assert old in text
        file.write_text(text.replace(old, new, 1))
    for tokens in (command(part), ["report", str(part)]):
        assert call(tokens) == 2
        said = capsys.readouterr().err
        assert f"{name}: {words} since the run ended; remove the run's folder" in said
        assert said.count("\n") == 1


def test_an_engine_that_is_not_there_leaves_nothing_that_blocks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    out = tmp_path / "s"
    assert call(["sweep", "quickstart", "--engine", "ray", "--out", str(out)]) == 2
    assert "Ray is not installed" in capsys.readouterr().err
    assert not (out / "sweep.json").exists()


class Finished:
    """A pool whose runs are over at once; those of a name with a bug raise."""

    def __init__(self, **_: object) -> None: ...

    def submit(self, _: object, order: RunOrder) -> Future[RunEnd]:
        future = Future[RunEnd]()
        if order.name == "bug":
            future.set_exception(ZeroDivisionError("a bug"))
        else:
            future.set_result(RunEnd(0))
        return future

    def shutdown(self, *, kill_workers: bool) -> None: ...


def test_what_others_finished_is_told_before_a_bug(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mission.sweep.execute.local.ProcessPoolExecutor", Finished)
    engine = LocalEngine(9)
    names = ["a", "b", "bug", "c", "d", "e"]
    config = load(None, ())
    for name in names:
        engine.start(RunOrder(name, config, tmp_path / name, None, tmp_path))
    assert set(engine.wait(0.0)) == {*names} - {"bug"}
    with pytest.raises(ZeroDivisionError):
        engine.wait(0.0)
    engine.close()


@pytest.mark.slow
def test_a_worker_killed_while_idle_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mission.sweep.execute.local.execute", lambda _: RunEnd(os.getpid()))
    engine = LocalEngine(1)
    order = RunOrder("a", load(None, ()), tmp_path / "a", None, tmp_path)

    def worker() -> int:
        engine.start(order)
        (end,) = engine.wait(HANG_S).values()
        assert end is not None
        return end.exit_code

    def refuses() -> bool:
        try:
            engine._free[0].submit(int)
        except TerminatedWorkerError:
            return True
        return False

    killed = worker()
    assert worker() == killed
    os.kill(killed, signal.SIGKILL)
    until(refuses)
    assert worker() != killed
    engine.close()


@pytest.mark.slow
def test_a_closed_engine_leaves_no_thread_at_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    feed, done = Queue._feed, threading.Event()

    def feed_and_linger(*given: object) -> None:
        feed(*given)
        time.sleep(0.5)  # the end of a process cut it off here, one semaphore too early
        done.set()

    monkeypatch.setattr(Queue, "_feed", staticmethod(feed_and_linger))
    engine = LocalEngine(1)
    engine.start(RunOrder("a", load(None, ()), tmp_path / "a", None, tmp_path))
    engine.close()
    assert done.is_set()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--jobs", "0"], ["jobs = 0", "at least 1"]),
        (["--address", "x:1"], ["address = x:1", "engine = ray"]),
        (["--engine", "ray", "--address", "ray://x:1"], ["ray://x:1", "HOST:PORT", "ray start"]),
        (["--strategies", "cov,,ideal"], ["--strategies cov,,ideal"]),
        (["--data-dir", "nowhere"], ["nowhere", "no such folder"]),
        (["--engine", "slurm"], ["slurm"]),
    ],
)
def test_wrong_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], words: list[str]
) -> None:
    assert call(["sweep", "configs/quickstart.toml", "--out", str(tmp_path / "s"), *more]) == 2
    refused(capsys, *words)
    assert not (tmp_path / "s").exists()


def test_a_run_of_code_that_was_edited_meanwhile_is_not_flown(tmp_path: Path) -> None:
    config = load(None, ("radio.truth=examples.rician:make",))
    began = {"examples.rician:make": "0" * 64}
    end = execute(RunOrder("a", config, tmp_path / "a", None, tmp_path, plugins=began))
    assert end.exit_code == 2
    assert end.message.startswith("the code of plug-in 'examples.rician:make', or of what it imp")
    assert end.message.endswith("while the sweep was at work; give it a new folder")
    assert not (tmp_path / "a").exists()
