"""The experiment on an external autopilot: our own, served by another process."""

import asyncio
import json
import math
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import small_runs
from forked import Forked
from patience import until
from serving import free_port, served
from small_runs import refused, rows

from mission.analysis.load import load_run
from mission.cli import call
from mission.flight.pilot.connection import connect

pytestmark = pytest.mark.slow

QUICKSTART = str(Path(__file__).parents[3] / "configs" / "quickstart.toml")  # where a run flies
SMALL = (*small_runs.OF_ANY_VEHICLE, "--set", "planner.gap=0.1")


@pytest.fixture(scope="module")
def slow_vehicle() -> Iterator[str]:
    """The URL of one that flies 8 m/s at most, for tests one after another."""
    port = free_port()
    slow = ("--set", "vehicle.parameters={MPC_XY_VEL_MAX=8}")
    with served(QUICKSTART, "--udp", str(port), "--speed", "16", *slow):
        yield f"udpin://127.0.0.1:{port}"


def test_an_autopilot_elsewhere_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], slow_vehicle: str
) -> None:
    out = tmp_path / "out"
    elsewhere = ("--set", "area.home_lat_deg=47.4")
    assert call(["run", "--vehicle", slow_vehicle, "--out", str(out), *SMALL, *elsewhere]) == 2
    error = capsys.readouterr().err
    assert "421 km" in error
    assert "area.home_lat_deg" in error
    assert "43.6145" in error
    assert not out.exists()


def test_two_rounds_on_an_autopilot_in_another_process(tmp_path: Path) -> None:
    port, out = free_port(), tmp_path / "out"
    url = f"udpin://127.0.0.1:{port}"
    with served(QUICKSTART, "--udp", str(port), "--speed", "8"):
        assert call(["run", "--vehicle", url, "--out", str(out), "--rounds", "2", *SMALL]) == 0
    rounds, uplinks = rows(out / "rounds.csv"), rows(out / "uplinks.csv")
    assert [row["round"] for row in rounds] == ["1", "2"]
    for row in rounds:
        plan_m, flown_m = float(row["plan_path_m"]), float(row["flown_path_m"])
        assert 100 < plan_m <= 300 + 1e-3
        assert abs(flown_m - plan_m) < 0.05 * plan_m + 5
        # Simulated seconds, as the vehicle's clock has them: about 20 m/s, stops included.
        assert plan_m / 20 < float(row["duration_s"]) < plan_m / 20 + 25
    assert len(uplinks) == sum(int(row["scheduled"]) for row in rounds) > 0
    for uplink in uplinks:
        plan, true, est = (
            complex(float(uplink[f"{name}_x_m"]), float(uplink[f"{name}_y_m"]))
            for name in ("plan", "true", "est")
        )
        assert true == est  # nobody knows better than the autopilot
        # A corner may be cut by 5 m, and positions come every 8 m at this speed.
        assert abs(true - plan) < 10.0
        assert abs(float(uplink["true_alt_m"]) - 60) < 2
    for number in ("1", "2"):
        slots = [float(u["slot_t_s"]) for u in uplinks if u["round"] == number]
        assert all(map(math.isfinite, slots))
        assert slots == sorted(slots)
    # The second round starts where the first ended.
    plans = [json.loads((out / "plans" / f"round-00{n}.plan").read_text()) for n in (1, 2)]
    end, start = (
        np.array(plan["mission"]["items"][index]["params"][4:6])
        for plan, index in zip(plans, (-1, 0), strict=True)
    )
    assert np.abs((end - start) * (111_000, 80_000)).max() < 3
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "finished"
    assert "telemetry" in summary["position_source"]


def test_what_the_vehicle_cannot_do_is_said_and_timed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], slow_vehicle: str
) -> None:
    out = tmp_path / "out"
    talking = [word for word in SMALL if word != "--quiet"]
    command = ["run", "--vehicle", slow_vehicle, "--out", str(out), "--rounds", "1"]
    assert call([*command, *talking]) == 0
    said = [line for line in capsys.readouterr().out.splitlines() if "will not fly" in line]
    assert len(said) == 1
    assert "8 m/s at most (MPC_XY_VEL_MAX = 8), 20 asked; link.set_parameters" in said[0]
    (plan,) = load_run(out).data.plans
    assert plan.speed_mps == 8.0
    # At that speed, and with corners; waypoints within half a metre of one another are one stop.
    assert plan.path_m / 8.0 - 0.5 < plan.slot_s[-1] < 1.15 * plan.path_m / 8.0


def test_parameters_are_set_back_after_an_interruption(tmp_path: Path, slow_vehicle: str) -> None:
    out = tmp_path / "out"
    may = ("--set", "link.set_parameters=true")
    process = Forked("run", "--vehicle", slow_vehicle, "--out", str(out), *SMALL, *may)
    plan = out / "plans" / "round-001.plan"
    until(lambda: plan.exists() or process.poll() is not None, "no round began")
    assert plan.exists()
    process.send_signal(signal.SIGINT)
    assert process.ended()[0] == 130
    assert asyncio.run(_parameter(slow_vehicle, "MPC_XY_VEL_MAX")) == 8.0
    texts = [event.text for event in load_run(out).data.events]
    assert "parameter MPC_XY_VEL_MAX: 8 -> 20 for the flight" in texts


async def _parameter(url: str, name: str) -> float | None:
    async with connect(url) as pilot:
        return await pilot.parameters.get(name)


def test_nobody_there_is_a_lost_link(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    url, out = f"udpin://127.0.0.1:{free_port()}", tmp_path / "out"
    impatient = ("--set", "link.connect_timeout_s=0.5")
    talking = [word for word in SMALL if word != "--quiet"]
    assert call(["run", "--vehicle", url, "--out", str(out), *impatient, *talking]) == 5
    printed = capsys.readouterr()
    assert printed.out == f"waiting for a vehicle on {url} (Ctrl-C ends)\n"
    assert printed.err == f"aerofed: no vehicle answered on {url} in 0.5 s\n"
    assert not out.exists()


def test_a_used_folder_is_refused_before_the_wait(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    url = f"udpin://127.0.0.1:{free_port()}"
    assert call(["run", "--vehicle", url, "--out", str(tmp_path), *SMALL]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


@pytest.mark.parametrize(
    "url", ["http://here", "14540", "udpin://0.0.0.0", "udpin://:14540", "serial:///dev/ttyACM0"]
)
def test_a_url_of_another_kind_is_refused_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], url: str
) -> None:
    out = tmp_path / "out"
    assert call(["run", "--vehicle", url, "--out", str(out), *SMALL]) == 2
    refused(capsys, "--vehicle ", url, "udpin://HOST:PORT", "serial:///DEVICE:BAUD")
    assert not out.exists()
