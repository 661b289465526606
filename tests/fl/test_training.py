"""Local training against torch's own modules and optimiser, and side by side against alone."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from reference_net import PlainNet, train_plainly

from fl.datasets import Split
from fl.models import ConvNet, make_network, parameter_count
from fl.training import LocalSettings, LocalTask, Scaling, correct_per_class, scaling_of, train

SETTINGS = LocalSettings(learning_rate=0.01, momentum=0.9, mu=0.1, batch_size=16, epochs=2)
# float32 sums in another order, over tens of steps; a larger rate would amplify it chaotically
TOLERANCE = {"rtol": 2e-3, "atol": 2e-4}


def rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def random_split(shape: tuple[int, int, int], count: int, *, classes: int = 10) -> Split:
    """Images that can be learnt: a bright patch whose place depends on the class."""
    r = rng(5)
    labels = r.integers(0, classes, count)
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
    ("mcmahan", (8, 8, 1)),
]


@pytest.mark.parametrize(("name", "shape"), CASES)
def test_training_is_textbook_fedprox(name: str, shape: tuple[int, int, int]) -> None:
    split = random_split(shape, 150)
    net = make_network(name, image_shape=shape, classes=10)
    assert isinstance(net, ConvNet)
    scaling = scaling_of(split)
    model = net.initial(rng(1))
    # Different amounts of data, none a multiple of the batch, one smaller than a batch.
    samples = [np.arange(0, 70), np.arange(70, 79), np.arange(79, 150)]
    results = train(
        net,
        split,
        model,
        [LocalTask(s, rng(10 + i)) for i, s in enumerate(samples)],
        scaling=scaling,
        settings=SETTINGS,
    )
    images = floats(split, scaling)
    for i, (s, result) in enumerate(zip(samples, results, strict=True)):
        plain = PlainNet(net).load(model)
        np.testing.assert_array_equal(plain.flat(), model)
        batches = batches_of(s, 10 + i, SETTINGS)
        loss = train_plainly(
            plain, images, split.labels, batches, learning_rate=0.01, momentum=0.9, mu=0.1
        )
        assert result.steps == len(batches)
        assert result.loss == pytest.approx(loss, rel=1e-4)
        moved = np.abs(result.model - model).max()
        assert moved > 10 * TOLERANCE["atol"]
        np.testing.assert_allclose(result.model, plain.flat(), **TOLERANCE)


@pytest.mark.parametrize(("name", "shape"), CASES)
def test_side_by_side_equals_one_by_one(name: str, shape: tuple[int, int, int]) -> None:
    split = random_split(shape, 120)
    net = make_network(name, image_shape=shape, classes=10)
    scaling, model = scaling_of(split), net.initial(rng(2))
    correction = 0.01 * rng(3).standard_normal(model.size).astype(np.float32)

    def tasks() -> list[LocalTask]:
        return [
            LocalTask(np.arange(0, 20), rng(1)),
            LocalTask(np.arange(20, 90), rng(2), correction),
            LocalTask(np.arange(90, 120), rng(3)),
        ]

    together = train(net, split, model, tasks(), scaling=scaling, settings=SETTINGS)
    alone = train(
        net, split, model, tasks(), scaling=scaling, settings=replace(SETTINGS, batched=False)
    )
    for one, other in zip(together, alone, strict=True):
        assert one.steps == other.steps
        assert one.loss == pytest.approx(other.loss, rel=1e-4)
        np.testing.assert_allclose(one.model, other.model, **TOLERANCE)
    lone = train(net, split, model, tasks()[1:2], scaling=scaling, settings=SETTINGS)[0]
    np.testing.assert_array_equal(lone.model, alone[1].model)


def test_correction_is_added_to_every_gradient() -> None:
    split = random_split((8, 8, 1), 40)
    net = make_network("lenet", image_shape=(8, 8, 1), classes=10)
    model, scaling = net.initial(rng(2)), scaling_of(split)
    shift = rng(3).standard_normal(model.size).astype(np.float32)
    one_step = LocalSettings(learning_rate=0.1, momentum=0.9, mu=0.1, batch_size=40, epochs=1)
    plain, corrected = (
        train(
            net, split, model, [LocalTask(np.arange(40), rng(1), c)],
            scaling=scaling, settings=one_step,
        )[0].model
        for c in (None, shift)
    )  # fmt: skip
    np.testing.assert_allclose(plain - corrected, 0.1 * shift, atol=1e-6)


def test_training_repeats_to_the_bit_whatever_the_thread_count() -> None:
    split = random_split((16, 16, 3), 80)
    net = make_network("lenet", image_shape=(16, 16, 3), classes=10)
    model, scaling = net.initial(rng(2)), scaling_of(split)

    def once() -> np.ndarray:
        tasks = [LocalTask(np.arange(i, 80, 3), rng(i)) for i in range(3)]
        done = train(net, split, model, tasks, scaling=scaling, settings=SETTINGS)
        return np.stack([result.model for result in done])

    before = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        first = once()
        torch.set_num_threads(2)
        second = once()
        assert torch.get_num_threads() == 2  # given back as it was
    finally:
        torch.set_num_threads(before)
    np.testing.assert_array_equal(first, second)


def test_lenet_is_lenet_and_mcmahan_is_mcmahans() -> None:
    def count(name: str, shape: tuple[int, int, int]) -> int:
        return parameter_count(make_network(name, image_shape=shape, classes=10))

    assert count("lenet", (28, 28, 1)) == 61_706  # LeNet-5
    assert count("lenet", (32, 32, 3)) == 62_006
    assert count("mcmahan", (28, 28, 1)) == 1_663_370  # the paper's own count
    assert count("mcmahan", (32, 32, 3)) == 2_156_490


def test_initial_parameters_are_torchs_default_distribution() -> None:
    net = make_network("lenet", image_shape=(32, 32, 3), classes=10)
    ours = PlainNet(net).load(net.initial(rng(1)))  # type: ignore[arg-type]  # it is a ConvNet
    torch_own = PlainNet(net)  # type: ignore[arg-type]
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


def test_correct_per_class_counts_what_the_plain_network_gets_right() -> None:
    split = random_split((28, 28, 1), 330)
    net = make_network("lenet", image_shape=(28, 28, 1), classes=10)
    scaling, start = scaling_of(split), net.initial(rng(4))
    model = train(
        net, split, start, [LocalTask(np.arange(330), rng(1))], scaling=scaling, settings=SETTINGS
    )[0].model
    plain = PlainNet(net).load(model)  # type: ignore[arg-type]  # it is a ConvNet
    with torch.no_grad():
        x = torch.from_numpy(floats(split, scaling)).permute(0, 3, 1, 2)
        guess = plain(x).argmax(dim=1).numpy()
    expected = [int(((guess == c) & (split.labels == c)).sum()) for c in range(10)]
    got = correct_per_class(net, split, model, scaling=scaling, classes=10)
    assert got.tolist() == expected
    assert got.sum() > 0
