"""Flower's own strategies as algorithms here; needs flwr."""

from pathlib import Path

import numpy as np
import pytest
from cutting import check_resumed

pytest.importorskip("flwr", reason="Flower is not installed", exc_type=ImportError)

from flwr.common import Parameters
from flwr.server.strategy import FedAdam, FedAvg, FedAvgM, Krum, Strategy

from examples.flower import FlowerAlgorithm
from fl.federation import algorithms
from fl.federation.algorithms import Update

pytestmark = pytest.mark.real

SMALL = {
    "mission.flight": "none", "mission.steps": 4, "mission.rounds": 3, "planner.gap": 0.1,
    "mission.path_budget_m": 400.0, "communities.0.devices": 4, "communities.1.devices": 3,
    "learning.local_epochs": 1, "learning.algorithm": "examples.flower:make",
}  # fmt: skip
RNG = np.random.default_rng(1)
MODEL = RNG.standard_normal(20).astype(np.float32)
SENT = [
    Update(k, p, MODEL + RNG.standard_normal(20).astype(np.float32), 3, MODEL)
    for k, p in enumerate((0.1, 0.2, 0.3))
]


def average(at: Parameters) -> Strategy:
    return FedAvg(initial_parameters=at)


def momentum(at: Parameters) -> Strategy:
    return FedAvgM(initial_parameters=at, server_momentum=0.5, server_learning_rate=0.7)


def test_flowers_average_is_ours() -> None:
    theirs = FlowerAlgorithm(average, 0.9)
    after, _ = theirs.apply(theirs.init(MODEL, 3), MODEL, SENT)
    ours, _ = algorithms.FedAvg(momentum=0.9).apply({}, MODEL, SENT)
    assert after == pytest.approx(ours, rel=1e-5, abs=1e-6)


def test_flowers_momentum_is_ours_over_rounds() -> None:
    theirs, ours = (
        FlowerAlgorithm(momentum, 0.9),
        algorithms.FedAvgM(momentum=0.9, server_learning_rate=0.7, server_momentum=0.5),
    )
    one = two = MODEL
    state, known = theirs.init(MODEL, 3), ours.init(MODEL, 3)
    for _ in range(3):
        one, state = theirs.apply(state, one, SENT)
        two, known = ours.apply(known, two, SENT)
    assert one == pytest.approx(two, rel=1e-4, abs=1e-5)


def test_what_a_strategy_keeps_is_in_the_state() -> None:
    theirs = FlowerAlgorithm(lambda at: FedAdam(initial_parameters=at), 0.9)
    one, state = theirs.apply(theirs.init(MODEL, 3), MODEL, SENT)
    assert set(state) == {"rounds", "m_t", "v_t"}
    alone = FedAdam(initial_parameters=Parameters([], ""))
    assert alone.m_t is None
    two, later = theirs.apply(state, one, SENT)
    fresh, _ = theirs.apply(theirs.init(MODEL, 3), one, SENT)
    assert later["rounds"][0] == 2
    assert not np.allclose(two, fresh)  # the moments count


def test_krum_leaves_the_outlier_out() -> None:
    theirs = FlowerAlgorithm(
        lambda at: Krum(initial_parameters=at, num_malicious_clients=1, num_clients_to_keep=1), 0.9
    )
    wild = Update(3, 0.4, MODEL + 100.0, 3, MODEL)
    after, _ = theirs.apply(theirs.init(MODEL, 4), MODEL, [*SENT, wild])
    assert np.abs(after - MODEL).max() < 10.0


@pytest.mark.slow
def test_it_flies_and_resumes_to_the_same_bytes(tmp_path: Path) -> None:
    check_resumed(SMALL, tmp_path)
