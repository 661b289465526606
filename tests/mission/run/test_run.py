"""Whole runs: MAVSDK flies the autopilot, JSBSim flies, devices train, a folder is left behind."""

import gzip
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import small_runs
from drawing import drawn
from forked import Forked
from mcap.reader import make_reader
from patience import HANG_S, until
from serving import free_port
from small_runs import digests, refused, rows

from mission.cli import call

SMALL = (*small_runs.SMALL, "--set", "planner.gap=0.1")
UNFLOWN = ("--set", "mission.flight=none")
# What a climb and a landing take counts, or how the first round begins.
AS_USUAL = ("--set", "mission.altitude_m=60", "--set", "vehicle.parameters={}")


def fly(out: Path, *more: str, rounds: int = 2) -> int:
    words = small_runs.last_counts(*SMALL, *more)
    return call(["run", "--out", str(out), "--rounds", str(rounds), *words])


def begun(out: Path) -> bool:
    """Whether the run there has finished a round."""
    return (out / "rounds.csv").exists() and bool(rows(out / "rounds.csv"))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "first"
    with drawn():
        assert fly(out) == 0
    return out


@pytest.mark.slow
def test_a_run_leaves_what_it_promises(run: Path) -> None:
    assert {path.name for path in run.iterdir()} >= {
        "config.toml", "devices.csv", "rounds.csv", "aircraft.csv", "uplinks.csv", "flight.mcap",
        "summary.json",
        "figures", "checkpoint", "plans",
    }  # fmt: skip
    for picture in (run / "figures").iterdir():
        content = picture.read_bytes()
        assert content.startswith(b"\x89PNG")
        assert len(content) > 5000  # more than a dot
    rounds, uplinks = rows(run / "rounds.csv"), rows(run / "uplinks.csv")
    assert [row["round"] for row in rounds] == ["1", "2"]
    assert len(uplinks) == sum(int(row["scheduled"]) for row in rounds) > 0
    for row in rounds:
        assert 100 < float(row["flown_path_m"]) <= 1.02 * float(row["plan_path_m"]) + 5
        assert float(row["plan_path_m"]) <= 300 + 1e-3
        assert 0 < float(row["accuracy_digits"]) <= 1
        mine = [u for u in uplinks if u["round"] == row["round"]]
        for name in ("plan", "true"):
            total = sum(float(u["importance"]) * (1 - float(u[f"{name}_per"])) for u in mine)
            assert float(row[f"{name}_objective"]) == pytest.approx(total, abs=1e-9)
    # A round is charged what it flies, L_max at most.
    assert float(rounds[1]["budget_used_m"]) == pytest.approx(
        sum(min(float(row["flown_path_m"]), 300.0) for row in rounds)
    )
    summary = json.loads((run / "summary.json").read_text())
    assert (summary["status"], summary["rounds"], summary["seed"]) == ("finished", 2, 1)
    assert summary["real_time_factor"] > 1
    assert {"setup", "plan", "fly", "learn"} <= summary["wall_s"].keys()


@pytest.mark.slow
def test_slots_are_served_where_the_aircraft_truly_was(run: Path) -> None:
    uplinks = rows(run / "uplinks.csv")
    assert len(uplinks) == sum(int(row["scheduled"]) for row in rows(run / "rounds.csv")) > 0
    for uplink in uplinks:
        plan, true, est = (
            complex(float(uplink[f"{name}_x_m"]), float(uplink[f"{name}_y_m"]))
            for name in ("plan", "true", "est")
        )
        # The autopilot may cut a corner by 5 m of its belief, which GNSS puts a metre or two off.
        assert abs(est - plan) < 6.0
        assert 0.0 < abs(true - est) < 6.0
        assert abs(float(uplink["true_alt_m"]) - 30.0) < 2.0


@pytest.mark.slow
def test_the_log_opens_with_a_standard_reader(run: Path) -> None:
    with (run / "flight.mcap").open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        counts = {
            summary.channels[c].topic: n
            for c, n in summary.statistics.channel_message_counts.items()
        }
        assert {a.name for a in reader.iter_attachments()} >= {"config.toml", "devices.csv"}
    schemas = {schema.name for schema in summary.schemas.values()}
    assert {"foxglove.PoseInFrame", "foxglove.LocationFix", "foxglove.FrameTransform"} <= schemas
    assert counts["/tf"] > 100


@pytest.mark.slow
def test_compare_prints_the_errors(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["compare", str(run), "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    assert len(found["rounds"]) == 2
    assert 0.0 < found["total"]["cross_track_rms_m"] < 3.0
    assert call(["compare", str(run)]) == 0
    assert "cross" in capsys.readouterr().out.lower()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_on_a_loaded_machine(run: Path, tmp_path: Path) -> None:
    burn = [sys.executable, "-c", "while True: pass"]
    load = [subprocess.Popen(burn) for _ in range(os.cpu_count() or 1)]
    try:
        assert fly(tmp_path / "again", rounds=1) == 0
    finally:
        for process in load:
            process.kill()
            process.wait()
    for name in ("rounds.csv", "aircraft.csv", "uplinks.csv", "learning.csv"):
        first = [row for row in rows(run / name) if row["round"] in ("0", "1")]
        assert rows(tmp_path / "again" / name) == first
    assert digests(tmp_path / "again")["devices.csv"] == digests(run)["devices.csv"]


@pytest.mark.slow
def test_another_seed_gives_other_devices(run: Path, tmp_path: Path) -> None:
    assert fly(tmp_path / "other", "--seed", "2", *UNFLOWN, rounds=1) == 0
    assert digests(tmp_path / "other")["devices.csv"] != digests(run)["devices.csv"]


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["barycenter", "rectangular"])
def test_every_flying_strategy_flies(tmp_path: Path, strategy: str) -> None:
    out = tmp_path / strategy
    wanted = 2 if strategy == "barycenter" else 1
    assert fly(out, "--set", f"mission.strategy={strategy}", rounds=wanted) == 0
    rounds, uplinks = rows(out / "rounds.csv"), rows(out / "uplinks.csv")
    assert len(rounds) == wanted
    assert all(float(u["slot_t_s"]) > 0 for u in uplinks)
    if strategy == "barycenter":
        assert [float(row["budget_used_m"]) for row in rounds] == [100.0, 200.0]
        assert all(5.0 <= float(row["duration_s"]) < 12.0 for row in rounds)


@pytest.mark.slow
def test_ideal_takes_everybody_and_flies_nothing(tmp_path: Path) -> None:
    out = tmp_path / "ideal"
    assert fly(out, "--set", "mission.strategy=ideal", rounds=3) == 0
    assert [row["delivered"] for row in rows(out / "rounds.csv")] == ["6", "6", "6"]
    assert rows(out / "uplinks.csv") == []
    # What a round costs at least, without a limit, too: JSON knows no infinity.
    assert 0.0 < json.loads((out / "summary.json").read_text())["time_used_s"] < 120.0


@pytest.mark.slow
def test_the_mission_ends_when_the_budget_is_spent(tmp_path: Path) -> None:
    out = tmp_path / "budget"
    assert fly(out, "--set", "mission.total_budget_m=650", *UNFLOWN, rounds=9) == 0
    rounds = rows(out / "rounds.csv")
    # Of 300 m each; the 50 m that are left pay for no third one.
    assert len(rounds) == 2
    assert 570 <= float(rounds[-1]["budget_used_m"]) <= 612


@pytest.mark.slow
def test_a_flight_longer_than_its_plan_costs_no_round(tmp_path: Path) -> None:
    """Rounds this short are flown longer than planned: a waver of the track is a share of them."""
    out = tmp_path / "tight"
    tight = ("--set", "mission.path_budget_m=40", "--set", "mission.total_budget_m=120")
    waver = ("--set", "mission.acceptance_radius_m=0.5", *AS_USUAL)
    assert fly(out, *tight, *waver, rounds=9) == 0
    rounds = rows(out / "rounds.csv")
    assert len(rounds) == 3
    flown = [float(row["flown_path_m"]) for row in rounds]
    assert sum(flown[:2]) > 80.0  # so that less than a round is left, were all of it charged
    used = [float(row["budget_used_m"]) for row in rounds]
    assert np.diff([0.0, *used]) == pytest.approx(np.minimum(flown, 40.0))


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["barycenter", "ideal"])
def test_a_first_round_costs_no_more_than_the_whole_budget(tmp_path: Path, strategy: str) -> None:
    out = tmp_path / strategy
    few = ("--set", f"mission.strategy={strategy}", "--set", "mission.total_budget_m=60")
    assert fly(out, *few, rounds=9) == 0
    assert [float(row["budget_used_m"]) for row in rows(out / "rounds.csv")] == [60.0]


@pytest.mark.slow
def test_the_same_flight_over_udp(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("mission.flight.flyers.built_in.RawLink")  # nothing passes by the port
    port = free_port()
    out = tmp_path / "udp"
    assert fly(out, "--set", "link.kind=udp", "--set", f"link.udp_port={port}", rounds=1) == 0
    assert rows(out / "uplinks.csv") == [u for u in rows(run / "uplinks.csv") if u["round"] == "1"]


@pytest.mark.slow
def test_ctrl_c_keeps_what_was_flown(tmp_path: Path) -> None:
    out = tmp_path / "cut"
    process = Forked("run", "--out", str(out), "--rounds", "500", *SMALL, pictures=True)
    until(lambda: process.poll() is not None or begun(out))
    process.send_signal(signal.SIGINT)
    code, _, errors = process.ended()
    assert code == 130, errors
    assert "Traceback" not in errors
    assert json.loads((out / "summary.json").read_text())["status"] == "interrupted"
    with (out / "flight.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics.message_count > 100
    assert list((out / "figures").glob("*.png"))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--set", "mission.stepz=3"], ["mission.stepz", "did you mean steps?"]),
        (["--set", "mission.steps=many"], ["mission.steps", "'many'"]),
        (["--set", "mission.speed_mps=99"], ["mission.speed_mps = 99", "22"]),
        (["--set", "mission"], ["--set mission", "KEY=VALUE"]),
        (["--data-dir", "nowhere"], ["--data-dir nowhere", "no such folder"]),
        (["--seed", "-1"], ["--seed -1", "equal to 0"]),
        (["--sed", "1"], ["--sed"]),
    ],
)
def test_wrong_input_is_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], words: list[str]
) -> None:
    assert fly(tmp_path / "out", *more) == 2
    refused(capsys, *words)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_used_folder_is_refused(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = digests(run)
    assert fly(run) == 2
    refused(capsys, str(run), "already used")
    assert digests(run) == before


def test_a_file_as_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("mine")
    assert fly(tmp_path / "file") == 2
    refused(capsys, str(tmp_path / "file"), "Not a directory", "name another folder")
    assert (tmp_path / "file").read_text() == "mine"


def test_an_unwritable_folder_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    # Root may write anywhere but here.
    assert fly(Path("/proc/aerofed")) == 2
    refused(capsys, "/proc/aerofed", "cannot write")


def test_a_port_in_use_is_a_link_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        more = ("--set", "link.kind=udp", "--set", f"link.udp_port={port}")
        assert fly(tmp_path / "out", *more) == 5
    refused(capsys, str(port), "in use")
    assert not (tmp_path / "out").exists()


PAPER = ("--set", "communities.0.task=mnist", "--set", "communities.1.task=digits")


def test_missing_data_files_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "data").mkdir()
    assert fly(tmp_path / "out", *PAPER, "--data-dir", str(tmp_path / "data")) == 2
    refused(capsys, "mnist", str(tmp_path / "data"), "train-images-idx3-ubyte")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("damage", ["truncated", "header"])
def test_a_damaged_data_file_is_named(
    tmp_path: Path, shared_data: Path, capsys: pytest.CaptureFixture[str], damage: str
) -> None:
    shutil.copytree(shared_data / "small" / "mnist", tmp_path / "data")
    (tmp_path / "data").chmod(0o755)
    path = tmp_path / "data" / "train-images-idx3-ubyte.gz"
    path.chmod(0o644)
    if damage == "truncated":
        path.write_bytes(path.read_bytes()[:-1000])
    else:
        path.write_bytes(gzip.compress(b"\0\0\x0d\x03" + gzip.decompress(path.read_bytes())[4:]))
    assert fly(tmp_path / "out", *PAPER, "--data-dir", str(tmp_path / "data")) == 2
    refused(capsys, "train-images-idx3-ubyte.gz")
    assert not (tmp_path / "out").exists()


def test_the_paper_s_experiment_runs_on_real_data(tmp_path: Path, shared_data: Path) -> None:
    out = tmp_path / "paper"
    code = call(
        ["run", "configs/paper.toml", "--data-dir", str(shared_data / "small"), "--rounds", "1",
         "--out", str(out), "--quiet"]
    )  # fmt: skip
    assert code == 0
    assert {"accuracy_cifar10", "accuracy_mnist"} <= rows(out / "rounds.csv")[0].keys()


def test_a_vehicle_setting_that_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fly(tmp_path / "out", "--set", "vehicle.parameters.NO_SUCH=1") == 2
    refused(capsys, "NO_SUCH")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_training_that_diverges_is_a_run_that_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert fly(out, "--set", "learning.learning_rate=10", *UNFLOWN) == 4
    refused(capsys, "learning diverged", "round ", "smaller learning rate", str(out))
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["status"], summary["rounds"]) == ("failed", len(rows(out / "rounds.csv")))
    assert "learning diverged" in summary["error"]


@pytest.mark.slow
def test_a_live_view_changes_no_byte(run: Path, tmp_path: Path) -> None:
    assert fly(tmp_path / "live", "--live", "--live-port", "0") == 0
    assert digests(tmp_path / "live") == digests(run)


def test_a_live_port_in_use(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert fly(tmp_path / "out", "--live", "--live-port", str(port)) == 5
    refused(capsys, f"127.0.0.1:{port}", "in use")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_battery_is_changed_between_rounds(tmp_path: Path) -> None:
    out = tmp_path / "battery"
    # A round takes about a fifth of this one, and so does coming back from the change.
    more = ("--set", "vehicle.aircraft.battery.capacity_mah=600", "--set",
            "mission.battery_reserve=0.7")  # fmt: skip
    assert fly(out, *more, rounds=3) == 0
    left = [float(row["battery_remaining"]) for row in rows(out / "rounds.csv")]
    changes = json.loads((out / "summary.json").read_text())["battery_changes"]
    assert changes >= 1
    assert left[2] > left[1]
    assert all(float(u["slot_t_s"]) > 0 for u in rows(out / "uplinks.csv"))


@pytest.mark.slow
def test_a_battery_is_changed_that_does_not_pay_for_another_round(tmp_path: Path) -> None:
    out, small = tmp_path / "battery", "vehicle.aircraft.battery.capacity_mah=400"
    # A round takes more than a quarter, so that the second leaves little more than the reserve.
    assert fly(out, "--set", small, *AS_USUAL, rounds=3) == 0
    left = [float(row["battery_remaining"]) for row in rows(out / "rounds.csv")]
    assert json.loads((out / "summary.json").read_text())["battery_changes"] == 1
    assert left[2] > left[1] > 0.25


# The process has what it has, and of that only pieces below 64 kB are left when figures are drawn.
DRAWS_WITHOUT_MEMORY = """
import resource, sys
from contextlib import suppress
from pathlib import Path
from mission.cli import call
from mission.figures import run as figures

draw, taken = figures.draw_run, []

def starved(folder):
    room = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (room, resource.RLIM_INFINITY))
    for size in (2**24, 2**20, 2**16):
        with suppress(MemoryError):
            while True:
                taken.append(bytearray(size))
    draw(folder)

figures.draw_run = starved
sys.exit(call(sys.argv[1:]))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited by way of /proc")
def test_figures_without_memory_end_in_one_line_and_lose_nothing(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "starved"
    ended = subprocess.run(
        [sys.executable, "-c", DRAWS_WITHOUT_MEMORY, "run", "--out", str(out), "--rounds", "2",
         *SMALL],
        capture_output=True, text=True, check=False, timeout=HANG_S,
    )  # fmt: skip
    assert ended.returncode == 1, ended.stderr
    assert ended.stderr == (
        f"aerofed: figures: out of memory; the files are in {out}; "
        f"aerofed run --resume {out} goes on\n"
    )
    assert json.loads((out / "summary.json").read_text())["status"] == "failed"
    assert digests(out) == digests(run)
