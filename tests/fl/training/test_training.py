"""Local training against torch's own modules, autograd and optimiser."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from reference_net import PlainNet, train_plainly

from fl.config import ConvNetConfig
from fl.data.dataset import Split
from fl.training.local import LocalResult, LocalSettings, LocalTask, Scaling, scaling_of
from fl.training.networks import ConvNet, make_network

SETTINGS = LocalSettings(learning_rate=0.01, momentum=0.9, mu=0.1, batch_size=16, epochs=2)
# float32 sums in another order, over tens of steps; a larger rate would amplify it chaotically
TOLERANCE: dict[str, Any] = {"rtol": 2e-3, "atol": 2e-4}


def rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def random_split(shape: tuple[int, int, int], count: int) -> Split:
    """Images that can be learnt: a bright patch whose place depends on the class."""
    r = rng(5)
    labels = r.integers(0, 10, count)
    images = r.integers(0, 120, (count, *shape)).astype(np.uint8)
    for image, label in zip(images, labels, strict=True):
        row, column = divmod(int(label), 5)
        size = shape[0] // 5
        image[row * 2 * size : row * 2 * size + size, column * size : (column + 1) * size] += 120
    return Split(images, labels.astype(np.int64))


def floats(split: Split, scaling: Scaling) -> np.ndarray:
    return (split.images * scaling.scale + scaling.shift).astype(np.float32)


def batches_of(samples: np.ndarray, seed: int, settings: LocalSettings) -> list[np.ndarray]:
    r = rng(seed)
    batches = []
    for _ in range(settings.epochs):
        order = r.permutation(samples)
        batches += [
            order[i : i + settings.batch_size] for i in range(0, len(order), settings.batch_size)
        ]
    return batches


CASES = [
    ("lenet", (28, 28, 1)),
    ("lenet", (32, 32, 3)),
    ("lenet", (8, 8, 1)),
    ("lenet", (16, 16, 3)),
    ("lenet", (19, 26, 2)),  # nothing of it divides by two
    ("mcmahan", (8, 8, 1)),
    ("mcmahan", (9, 14, 3)),
    (ConvNetConfig(), (12, 13, 3)),
    (ConvNetConfig(channels=(5, 9, 12), kernel=3, hidden=(20, 11)), (9, 14, 2)),
    (ConvNetConfig(channels=(7,), kernel=5, hidden=()), (8, 8, 1)),
    (ConvNetConfig(channels=(), hidden=(30,)), (8, 8, 1)),
]


def conv_net(name: str | ConvNetConfig, shape: tuple[int, int, int]) -> ConvNet:
    if isinstance(name, ConvNetConfig):
        net = make_network("convnet", convnet=name, image_shape=shape, classes=10)
    else:
        net = make_network(name, image_shape=shape, classes=10)
    assert isinstance(net, ConvNet)
    return net


@pytest.mark.slow
@pytest.mark.parametrize("batch_size", [5, 16, 40])
@pytest.mark.parametrize(("name", "shape"), CASES)
def test_training_is_textbook_fedprox(
    name: str | ConvNetConfig, shape: tuple[int, int, int], batch_size: int
) -> None:
    split = random_split(shape, 150)
    net = conv_net(name, shape)
    scaling = scaling_of(split)
    model = net.initial(rng(1))
    settings = replace(SETTINGS, batch_size=batch_size)
    images = floats(split, scaling)
    # No multiple of the batch, and less than a batch.
    for samples in (np.arange(0, 42), np.arange(40, 44)):
        result = net.train(LocalTask(split, samples, scaling, model, settings, rng(10)))
        plain = PlainNet(net).load(model)
        batches = batches_of(samples, 10, settings)
        loss = train_plainly(
            plain, images, split.labels, batches, learning_rate=0.01, momentum=0.9, mu=0.1
        )
        assert result.steps == len(batches)
        assert result.loss == pytest.approx(loss, rel=1e-4)
        moved = np.abs(result.model - model).max()
        assert moved > 10 * TOLERANCE["atol"]
        np.testing.assert_allclose(result.model, plain.flat(), **TOLERANCE)


@pytest.mark.parametrize("name", ["lenet", ConvNetConfig(channels=(8, 16, 32), hidden=(64, 32))])
def test_one_step_follows_the_gradient_to_rounding(name: str | ConvNetConfig) -> None:
    split = random_split((32, 32, 3), 16)
    net = conv_net(name, (32, 32, 3))
    model, scaling = net.initial(rng(1)), scaling_of(split)
    step = LocalSettings(learning_rate=1.0, momentum=0.0, mu=0.0, batch_size=16, epochs=1)
    moved = net.train(LocalTask(split, np.arange(16), scaling, model, step, rng(1)))
    plain = PlainNet(net).load(model).double()
    x = torch.from_numpy(floats(split, scaling).astype(np.float64)).permute(0, 3, 1, 2)
    loss = torch.nn.functional.cross_entropy(plain(x), torch.from_numpy(split.labels.copy()))
    slopes = torch.autograd.grad(loss, list(plain.parameters()))
    exact = torch.cat([slope.reshape(-1) for slope in slopes]).numpy()
    np.testing.assert_allclose(model - moved.model, exact, rtol=1e-4, atol=2e-7)


def test_correction_is_added_to_every_gradient() -> None:
    split = random_split((8, 8, 1), 40)
    net = conv_net("lenet", (8, 8, 1))
    model, scaling = net.initial(rng(2)), scaling_of(split)
    shift = rng(3).standard_normal(model.size).astype(np.float32)
    one_step = LocalSettings(learning_rate=0.1, momentum=0.9, mu=0.1, batch_size=40, epochs=1)
    plain, corrected = (
        net.train(LocalTask(split, np.arange(40), scaling, model, one_step, rng(1), c))
        for c in (None, shift)
    )
    np.testing.assert_allclose(plain.model - corrected.model, 0.1 * shift, atol=1e-6)


def test_training_repeats_to_the_bit_in_any_number_of_threads() -> None:
    split = random_split((16, 16, 3), 80)
    net = conv_net("lenet", (16, 16, 3))
    model, scaling = net.initial(rng(2)), scaling_of(split)

    def train(k: int) -> LocalResult:
        return net.train(LocalTask(split, np.arange(k, 80, 3), scaling, model, SETTINGS, rng(k)))

    alone = [train(k) for k in range(3)]
    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(train, range(3)))
    for one, other in zip(alone, together, strict=True):
        assert one.loss == other.loss
        np.testing.assert_array_equal(one.model, other.model)


def test_lenet_is_lenet_and_mcmahan_is_mcmahans() -> None:
    def count(name: str, shape: tuple[int, int, int]) -> int:
        return make_network(name, image_shape=shape, classes=10).initial(rng(1)).size

    assert count("lenet", (28, 28, 1)) == 61_706  # LeNet-5
    assert count("lenet", (32, 32, 3)) == 62_006
    assert count("mcmahan", (28, 28, 1)) == 1_663_370  # the paper's own count
    assert count("mcmahan", (32, 32, 3)) == 2_156_490


def test_initial_parameters_are_torchs_default_distribution() -> None:
    net = conv_net("lenet", (32, 32, 3))
    ours = PlainNet(net).load(net.initial(rng(1)))
    torch_own = PlainNet(net)
    pairs = zip(ours.state_dict().values(), torch_own.state_dict().values(), strict=True)
    for mine, theirs in pairs:
        if mine.numel() > 500:
            assert float(mine.std()) == pytest.approx(float(theirs.std()), rel=0.1)
            assert float(mine.abs().max()) == pytest.approx(float(theirs.abs().max()), rel=0.05)


def test_scaling_gives_zero_mean_unit_variance_per_channel() -> None:
    split = random_split((16, 16, 3), 200)
    scaled = floats(split, scaling_of(split)).reshape(-1, 3)
    np.testing.assert_allclose(scaled.mean(axis=0), 0.0, atol=1e-4)
    np.testing.assert_allclose(scaled.std(axis=0), 1.0, atol=1e-4)
    dark = Split(np.zeros((4, 8, 8, 1), np.uint8), np.zeros(4, np.int64))
    assert np.isfinite(floats(dark, scaling_of(dark))).all()


def test_features_of_any_magnitude_are_scaled_and_constant_ones_left() -> None:
    rng, each = np.random.default_rng(3), (300, 1, 1, 1)
    features = [rng.normal(mean, dev, each) for mean, dev in ((5e-7, 1e-7), (1.7e9, 1e4), (4.0, 0))]
    split = Split(np.concatenate(features, axis=3).astype(np.float32), np.zeros(300, np.int64))
    scaled = floats(split, scaling_of(split)).reshape(-1, 3)
    np.testing.assert_allclose(scaled.mean(axis=0), 0.0, atol=0.02)  # of 32 bits
    np.testing.assert_allclose(scaled.std(axis=0), (1.0, 1.0, 0.0), atol=1e-3)


def test_correct_per_class_counts_what_the_plain_network_gets_right() -> None:
    split = random_split((28, 28, 1), 330)
    net = conv_net("lenet", (28, 28, 1))
    scaling, start = scaling_of(split), net.initial(rng(4))
    model = net.train(LocalTask(split, np.arange(330), scaling, start, SETTINGS, rng(1))).model
    plain = PlainNet(net).load(model)
    with torch.no_grad():
        x = torch.from_numpy(floats(split, scaling)).permute(0, 3, 1, 2)
        guess = plain(x).argmax(dim=1).numpy()
    expected = [int(((guess == c) & (split.labels == c)).sum()) for c in range(10)]
    got = net.correct_per_class(split, model, scaling=scaling)
    assert got.tolist() == expected
    assert got.sum() > 0
