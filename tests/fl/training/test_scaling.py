"""How images and features are scaled, and in which batches a device meets its samples."""

import numpy as np
import pytest

from fl.data.dataset import Split
from fl.training.local import LocalSettings, LocalTask, Scaling, batch_order, scaling_of


def of_pixels(pixels: np.ndarray) -> Scaling:
    return scaling_of(Split(pixels, np.zeros(len(pixels), dtype=np.int64)))


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
@pytest.mark.parametrize("count", [7, 256, 600])
def test_each_channel_has_mean_0_and_deviation_1(kind: type, count: int) -> None:
    rng = np.random.default_rng(count)
    pixels = rng.integers(0, 256, (count, 3, 2, 3)) // np.array([1, 2, 5])
    pixels = pixels.astype(np.uint8) if kind is np.uint8 else (pixels / 255.0).astype(np.float32)
    found = of_pixels(pixels)
    each = pixels.reshape(-1, 3).astype(np.float64)
    assert found.scale == pytest.approx(1.0 / each.std(axis=0), rel=1e-5)
    assert found.shift == pytest.approx(-each.mean(axis=0) / each.std(axis=0), rel=1e-5)
    assert found.scale.dtype == found.shift.dtype == np.float32


def test_images_deviate_by_a_thousandth_of_their_range_at_least() -> None:
    for value, one in ((51, np.uint8(51)), (0.2, np.float32(0.2))):
        pixels = np.full((4, 2, 2, 1), one)
        thousandth = (255.0 if pixels.dtype == np.uint8 else 1.0) / 1000.0
        found = of_pixels(pixels)
        assert found.scale == pytest.approx([1.0 / thousandth], rel=1e-4)
        assert found.shift == pytest.approx([-value / thousandth], rel=1e-4)
    # What deviates by little more keeps its own.
    pixels = np.full((1000, 1, 2, 1), 0.5, dtype=np.float32)
    pixels[0] += 0.05
    assert of_pixels(pixels).scale == pytest.approx([1.0 / pixels.std(dtype=np.float64)], rel=1e-4)


def test_features_deviate_by_their_own_unless_that_is_lost_in_their_mean() -> None:
    """Tiny and huge ones alike; of what is the same in all, nothing is made large."""
    rng = np.random.default_rng(3)
    features = rng.normal(0.0, 1.0, (500, 4)) * [1e-6, 1e6, 1e-3, 0.0] + [0.0, 3e6, 900.0, 7.0]
    features[:, 2] = 900.0 + 1e-6 * rng.normal(size=500)  # all alike in 32 bits
    pixels = features[:, None, None, :].astype(np.float32)
    found = of_pixels(pixels)
    deviation = features.std(axis=0)
    assert found.scale == pytest.approx([1 / deviation[0], 1 / deviation[1], 1.0, 1.0], rel=1e-4)
    assert found.shift[2:] == pytest.approx([-900.0, -7.0])


@pytest.mark.parametrize(
    ("samples", "batch", "steps", "padded"),
    [(10, 4, 3, 2), (8, 4, 2, 0), (9, 4, 3, 3), (3, 4, 1, 0), (1, 1, 1, 0)],
)
def test_each_epoch_has_every_sample_once_in_another_order(samples, batch, steps, padded) -> None:
    split = Split(np.zeros((99, 2, 2, 1), np.uint8), np.zeros(99, dtype=np.int64))
    settings = LocalSettings(learning_rate=0.1, momentum=0.0, mu=0.0, batch_size=batch, epochs=5)
    own = 3 * np.arange(samples)
    task = LocalTask(split, own, of_pixels(split.images), np.zeros(1, np.float32), settings,
                     np.random.default_rng(1))  # fmt: skip
    order = batch_order(task)
    assert order.shape == (5 * steps, min(batch, samples))
    epochs = order.reshape(5, -1)
    for epoch in epochs:
        assert sorted(epoch[epoch >= 0]) == own.tolist()
        assert (epoch[len(epoch) - padded :] == -1).all()
        assert (epoch[: len(epoch) - padded] >= 0).all()
    if samples > 3:
        assert len({tuple(epoch) for epoch in epochs}) == 5
