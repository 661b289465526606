"""Training and counting with a module of one's own, against the formulas of softmax regression."""

import numpy as np
import pytest
from torch import Tensor, nn

from fl.data.dataset import Split
from fl.training.local import LocalSettings, LocalTask, Scaling
from fl.training.networks import CustomNetwork
from fl.training.torch_module import ModuleNetwork

CLASSES, PIXELS, COUNT = 4, 12, 23
SCALING = Scaling(*np.array([[0.01, 0.02, 0.005], [-0.5, 0.25, 0.0]], dtype=np.float32))


class Linear(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.dense = nn.Linear(PIXELS, CLASSES)

    def forward(self, x: Tensor) -> Tensor:
        out: Tensor = self.dense(x.flatten(1))
        return out


def rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def drawn() -> tuple[ModuleNetwork, Split, np.ndarray]:
    """The network, images of 2 by 2 pixels of 3 channels, and the images as it sees them."""
    network = ModuleNetwork(CustomNetwork("Linear", Linear), image_shape=(2, 2, 3), classes=CLASSES)
    images = rng(1).integers(0, 256, (COUNT, 2, 2, 3)).astype(np.uint8)
    split = Split(images, rng(2).integers(0, CLASSES, COUNT))
    scaled = images * SCALING.scale + SCALING.shift
    return network, split, scaled.transpose(0, 3, 1, 2).reshape(COUNT, PIXELS)


def logits_of(model: np.ndarray, x: np.ndarray) -> np.ndarray:
    return x @ model[:-CLASSES].reshape(CLASSES, PIXELS).T + model[-CLASSES:]


@pytest.mark.parametrize("corrected", [False, True])
def test_local_sgd_is_that_of_the_formulas(corrected: bool) -> None:
    network, split, x = drawn()
    settings = LocalSettings(learning_rate=0.1, momentum=0.9, mu=0.5, batch_size=8, epochs=2)
    size = CLASSES * (PIXELS + 1)
    model = rng(3).normal(0.0, 0.3, size).astype(np.float32)
    correction = rng(4).normal(0.0, 0.1, size).astype(np.float32) if corrected else None
    samples = np.arange(2, 21)  # 19 of them: 8, 8 and 3
    task = LocalTask(split, samples, SCALING, model, settings, rng(5), correction)
    result = network.train(task)

    order, weights = rng(5), model.astype(np.float64)
    velocity, losses = np.zeros(size), []
    for _ in range(2):
        drawn_order = order.permutation(samples)
        for begin in (0, 8, 16):
            chosen = drawn_order[begin : begin + 8]
            logits = logits_of(weights, x[chosen])
            shares = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
            one = np.eye(CLASSES)[split.labels[chosen]]
            losses.append(-np.log((shares * one).sum(axis=1)).mean())
            slope = (shares - one).T / len(chosen)
            step = np.concatenate([(slope @ x[chosen]).ravel(), slope.sum(axis=1)])
            step += 0.5 * (weights - model) + (0.0 if correction is None else correction)
            velocity = 0.9 * velocity + step
            weights = weights - 0.1 * velocity
    assert result.steps == 6
    assert result.loss == pytest.approx(np.mean(losses), rel=1e-5)
    np.testing.assert_allclose(result.model, weights, rtol=1e-4, atol=1e-6)
    assert np.abs(weights - model).max() > 0.1


def test_what_it_gets_right_is_counted_by_class() -> None:
    network, split, x = drawn()
    model = rng(6).normal(0.0, 0.3, CLASSES * (PIXELS + 1)).astype(np.float32)
    guessed = logits_of(model, x).argmax(axis=1)
    right = [int(((guessed == c) & (split.labels == c)).sum()) for c in range(CLASSES)]
    assert network.correct_per_class(split, model, scaling=SCALING).tolist() == right
    assert 0 < sum(right) < COUNT
