"""Fairness and importance of a run, recomputed from its tables alone, without code of ours."""

import math
from pathlib import Path

import pytest
from small_runs import QUIET, rows

from mission.cli import call

PERIOD, BOOST, FLOOR = 2, 1.5, 0.1


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "run"
    few = ["communities.0.devices=4", "communities.1.devices=4", "learning.local_epochs=1"]
    hard = ["channel.extra_gain_db=-9", f"learning.cov_period_rounds={PERIOD}"]
    path = ["mission.steps=4", "mission.path_budget_m=250", "planner.gap=0.1"]
    path += ["planner.max_nodes=20", "mission.flight=none"]
    sets = ("--set", *few, *hard, *path)
    assert call(["run", "--out", str(out), "--rounds", "6", *QUIET, *sets]) == 0
    return out


def test_psi_and_delta_of_every_round_follow_from_the_tables(folder: Path) -> None:
    devices, rounds = rows(folder / "devices.csv"), rows(folder / "rounds.csv")
    uplinks, learning = rows(folder / "uplinks.csv"), rows(folder / "learning.csv")
    p = [float(row["p"]) for row in devices]
    of = [row["community"] for row in devices]
    eps = {(int(r["round"]), int(r["device"])): float(r["accuracy"]) for r in learning}
    arrived = {(int(u["round"]), int(u["device"])) for u in uplinks if u["delivered"] == "true"}
    assert len(arrived) < len(uplinks), "nothing was lost: the test shows too little"

    received: dict[int, float] = {}
    psi = dict.fromkeys(of, 1.0)
    missed = [True] * len(p)
    for m in range(1, len(rounds) + 1):
        for uplink in (u for u in uplinks if int(u["round"]) == m):
            k = int(uplink["device"])
            delta = p[k] * max(psi[of[k]], FLOOR) * (BOOST if missed[k] else 1.0)
            assert float(uplink["importance"]) == pytest.approx(delta, rel=1e-12)
        for k in range(len(p)):
            if (m, k) in arrived:
                down = range(max(1, m - PERIOD), m)  # rounds; the model after the one before each
                models = [j - 1 for j in down] or [0]
                received[k] = sum(eps[j, k] for j in models) / len(models)
            missed[k] = (m, k) not in arrived
        for row in (r for r in learning if int(r["round"]) == m):
            mine = received.get(int(row["device"]), math.nan)
            assert float(row["received_accuracy"]) == pytest.approx(mine, rel=1e-12, nan_ok=True)
        if m % PERIOD == 0:
            for name in psi:
                heard = [k for k in received if of[k] == name]
                whole = sum(p[k] for k in heard)
                mean = sum(p[k] * received[k] for k in heard) / whole if heard else 0.0
                spread = math.sqrt(sum((received[k] - mean) ** 2 for k in heard))
                psi[name] = spread / mean if mean else 1.0
        for name, value in psi.items():
            assert float(rounds[m - 1][f"cov_{name}"]) == pytest.approx(value, rel=1e-12)
    assert len(set(psi.values()) - {1.0}) == 2


def test_the_table_begins_with_the_untrained_models(folder: Path) -> None:
    first = [row for row in rows(folder / "learning.csv") if row["round"] == "0"]
    assert len(first) == 8
    assert {row["received_accuracy"] for row in first} == {"nan"}
    assert {row["loss"] for row in first} == {"nan"}
    assert all(0.0 <= float(row["accuracy"]) <= 1.0 for row in first)
