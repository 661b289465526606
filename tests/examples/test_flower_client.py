"""A Flower ClientApp as the training of the devices here; needs flwr."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cutting import check_resumed

pytest.importorskip("flwr", reason="Flower is not installed", exc_type=ImportError)

from flwr.app import ArrayRecord, Context, Message, RecordDict
from flwr.clientapp import ClientApp

from examples.flower_client import FlowerTrainer
from fl.config import LearningConfig
from fl.training.local import CustomTrainer, LocalResult, LocalSettings, LocalTask, TrainingDevice
from mission.config.loading import load_config
from mission.scenario.scenario import build_scenario

pytestmark = pytest.mark.real

DENSE: dict[str, Any] = {
    f"communities.{index}.{key}": value
    for index in (0, 1)
    for key, value in (("network", "convnet"), ("convnet.channels", []), ("convnet.hidden", []))
}
SMALL = {
    "mission.flight": "none", "mission.steps": 4, "mission.rounds": 3, "planner.gap": 0.1,
    "mission.path_budget_m": 400.0, "communities.0.devices": 4, "communities.1.devices": 3,
    "learning.local_epochs": 1, "learning.algorithm": "fedavg", **DENSE,
}  # fmt: skip
OURS = {**SMALL, "learning.trainer": "examples.flower_client:FlowerTrainer"}


def both(trainer: FlowerTrainer) -> tuple[LocalResult, LocalResult]:
    """What the app sends up, and what our own training does, of one device in whole batches."""
    scenario = build_scenario(load_config(Path("quickstart"), SMALL), data_dir=None)
    community = scenario.federation.communities[0]
    split, scaling = community.dataset.train, community.scaling
    settings = LocalSettings(0.05, 0.9, 0.0, batch_size=10_000, epochs=3)
    model = community.network.initial(np.random.default_rng(1))

    def task() -> LocalTask:
        rng = np.random.default_rng(2)
        return LocalTask(split, community.shares[2], scaling, model, settings, rng)

    device = TrainingDevice("digits", 2, 1, community.network.shapes, 10, settings, None)
    theirs = CustomTrainer("x:y", trainer).train(device, task())
    ours = community.network.train(task())
    return theirs, ours


def test_an_app_that_does_what_we_do_sends_up_what_we_do() -> None:
    theirs, ours = both(FlowerTrainer(LearningConfig()))
    assert theirs.model == pytest.approx(ours.model, rel=1e-4, abs=1e-5)
    assert theirs.loss == pytest.approx(ours.loss, rel=1e-4)
    assert theirs.steps == ours.steps == 3


def test_what_an_app_would_lose_is_refused() -> None:
    forgetful = ClientApp()

    @forgetful.train()  # type: ignore[untyped-decorator]
    def train(message: Message, context: Context) -> Message:
        context.state["moments"] = ArrayRecord([np.zeros(3)])
        return Message(RecordDict(), reply_to=message)

    with pytest.raises(Exception, match="keeps something in its context"):
        both(FlowerTrainer(LearningConfig(), forgetful))


@pytest.mark.slow
def test_it_flies_and_resumes_to_the_same_bytes(tmp_path: Path) -> None:
    whole = check_resumed(OURS, tmp_path)
    assert whole.learning["loss"].notna().any()
