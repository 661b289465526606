"""Local training of a user's own beside ours, on the same data and from the same model."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from fl.arrays import Vector
from fl.config import LearningConfig
from fl.federation import rounds
from fl.federation.state import FederationState
from fl.training.local import DeviceData, LocalResult, TrainingDevice
from mission.config.loading import load_config
from mission.scenario.scenario import build_scenario

DENSE = {
    "communities.0.network": "convnet", "communities.0.convnet.channels": [],
    "communities.0.convnet.hidden": [], "communities.1.network": "convnet",
    "communities.1.convnet.channels": [], "communities.1.convnet.hidden": [],
    "learning.algorithm": "fedprox", "learning.mu": 0.3, "learning.batch_size": 10_000,
    "learning.local_epochs": 3, "learning.momentum": 0.5,
}  # fmt: skip
asked: list[tuple[str, int, int, float]] = []


class WholeBatches:
    """FedProx's local SGD on a dense layer, a step an epoch."""

    def __init__(self, learning: LearningConfig) -> None:
        self.learning = learning

    def train(
        self, device: TrainingDevice, model: Vector, data: DeviceData, rng: np.random.Generator
    ) -> LocalResult:
        asked.append((device.community, device.device, device.round, rng.random()))
        how, losses = device.settings, []
        (rows, columns), _ = device.shapes
        assert rows == device.classes
        start = torch.tensor(model)
        flat = start.clone().requires_grad_()
        optimiser = torch.optim.SGD([flat], how.learning_rate, how.momentum)
        for _ in range(how.epochs):
            weight, bias = flat.split([rows * columns, rows])
            x = torch.tensor(data.x).flatten(1)
            logits = torch.nn.functional.linear(x, weight.view(rows, columns), bias)
            loss = torch.nn.functional.cross_entropy(logits, torch.tensor(data.y))
            optimiser.zero_grad()
            (loss + how.mu / 2 * ((flat - start) ** 2).sum()).backward()
            optimiser.step()
            losses.append(loss.item())
        return LocalResult(flat.detach().numpy(), len(losses), float(np.mean(losses)))


def played(**more: object) -> tuple[FederationState, rounds.RoundLearning]:
    config = load_config(Path("quickstart"), {**DENSE, **more})
    federation = build_scenario(config, data_dir=None).federation
    delivered = np.arange(federation.p.size) % 2 == 0
    who = rounds.Participation(delivered, delivered)
    return rounds.play_round(federation, rounds.init(federation), who, workers=4)


def test_a_trainer_that_does_what_we_do_finds_what_we_find() -> None:
    asked.clear()
    ours, learnt = played()
    theirs, taught = played(**{"learning.trainer": partial(WholeBatches)})
    for mine, other in zip(ours.communities, theirs.communities, strict=True):
        assert other.model == pytest.approx(mine.model, rel=1e-4, abs=1e-6)
    assert taught.device_loss == pytest.approx(learnt.device_loss, rel=1e-4, nan_ok=True)
    # Only whose update arrives, in order, each with a stream of its own.
    assert [item[:3] for item in asked] == [
        (name, device, 1) for name in ("digits", "colour-shapes") for device in (0, 2, 4)
    ]
    assert len({item[3] for item in asked}) == 6
