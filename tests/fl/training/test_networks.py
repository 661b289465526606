"""A user's own torch module, by import path: trained, refused, repeatable."""

import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from reference_net import PlainNet
from torch import nn

from fl.config import ConvNetConfig
from fl.data.dataset import Split
from fl.training.local import CustomTrainer, LocalSettings, LocalTask, scaling_of
from fl.training.networks import ConvNet, make_network
from native.errors import InputError, SettingError, UsersCodeError

SHAPE = (8, 8, 1)
ONE = LocalSettings(learning_rate=0.05, momentum=0.9, mu=0.1, batch_size=16, epochs=1)


class Small(nn.Module):
    """What a user might bring, with dropout."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Flatten(), nn.Linear(64, 20), nn.ReLU(), nn.Dropout(0.3), nn.Linear(20, 10)
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        assert x.shape[1:] == (1, 8, 8)
        return self.layers(x)


class Lazy(nn.Module):
    """Layers that have their sizes from the first images; without dropout."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Flatten(), nn.LazyBatchNorm1d(), nn.LazyLinear(10))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.layers(x)


def sized() -> nn.Module:
    return nn.Sequential(nn.Flatten(), nn.BatchNorm1d(64), nn.Linear(64, 10))


class NeverUsed(Small):
    def __init__(self) -> None:
        super().__init__()
        self.spare = nn.LazyLinear(3)


def needs_a_file() -> nn.Module:
    raise FileNotFoundError("weights.pt")


def gives_up() -> nn.Module:
    raise SystemExit(3)


class TooFew(Small):
    def __init__(self) -> None:
        super().__init__()
        self.layers[4] = nn.Linear(20, 9)


class WrongImage(Small):
    def __init__(self) -> None:
        super().__init__()
        self.layers[1] = nn.Linear(63, 20)


def needs_argument(width: int) -> nn.Module:
    return nn.Linear(width, 10)


def not_a_module() -> int:
    return 3


def double() -> nn.Module:
    return Small().double()


def frozen() -> nn.Module:
    module = Small()
    module.layers[1].weight.requires_grad_(False)
    return module


def empty() -> nn.Module:
    return nn.Flatten()


def rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def bright_spots(count: int) -> Split:
    labels = rng(1).integers(0, 10, count)
    images = rng(2).integers(0, 100, (count, *SHAPE)).astype(np.uint8)
    images[np.arange(count), labels // 2, 3 + labels % 2] = 255
    return Split(images, labels.astype(np.int64))


def test_a_users_module_trains_repeatably_whoever_else_trains() -> None:
    net = make_network(f"{__name__}:Small", image_shape=SHAPE, classes=10)
    split = bright_spots(200)
    model, scaling = net.initial(rng(3)), scaling_of(split)
    assert model.size == 64 * 20 + 20 + 20 * 10 + 10
    np.testing.assert_array_equal(model, net.initial(rng(3)))
    settings = LocalSettings(learning_rate=0.05, momentum=0.9, mu=0.1, batch_size=16, epochs=10)

    def run(devices: list[int]) -> list[np.ndarray]:
        before = torch.random.get_rng_state()
        results = [
            net.train(LocalTask(split, np.arange(k, 200, 2), scaling, model, settings, rng(50 + k)))
            for k in devices
        ]
        assert torch.equal(before, torch.random.get_rng_state())  # nobody else's draws change
        assert results[0].loss < 2.0
        return [result.model for result in results]

    both = run([0, 1])
    np.testing.assert_array_equal(both[1], run([1])[0])
    np.testing.assert_array_equal(both[0], run([0])[0])


def lenet() -> nn.Module:
    return PlainNet(built_in())


def built_in() -> ConvNet:
    net = make_network("lenet", image_shape=SHAPE, classes=10)
    assert isinstance(net, ConvNet)
    return net


@pytest.mark.parametrize("corrected", [False, True])
def test_a_users_lenet_trains_like_the_built_in_one(corrected: bool) -> None:
    own = make_network(f"{__name__}:lenet", image_shape=SHAPE, classes=10)
    net = built_in()
    assert own.shapes == net.shapes
    split = bright_spots(70)
    model, scaling = net.initial(rng(3)), scaling_of(split)
    shift = 0.01 * rng(4).standard_normal(model.size).astype(np.float32) if corrected else None
    settings = LocalSettings(learning_rate=0.01, momentum=0.9, mu=0.1, batch_size=16, epochs=2)
    mine, theirs = (
        network.train(LocalTask(split, np.arange(70), scaling, model, settings, rng(1), shift))
        for network in (own, net)
    )
    assert (mine.steps, theirs.steps) == (10, 10)
    assert mine.loss == pytest.approx(theirs.loss, rel=1e-4)
    np.testing.assert_allclose(mine.model, theirs.model, rtol=2e-3, atol=2e-4)
    counts = [
        network.correct_per_class(split, mine.model, scaling=scaling) for network in (own, net)
    ]
    np.testing.assert_array_equal(counts[0], counts[1])


def test_lazy_layers_have_their_sizes_before_parameters_are_counted() -> None:
    lazy, plain = (
        make_network(f"{__name__}:{name}", image_shape=SHAPE, classes=10)
        for name in ("Lazy", "sized")
    )
    assert lazy.shapes == plain.shapes
    model = lazy.initial(rng(3))
    np.testing.assert_array_equal(model, lazy.initial(rng(3)))
    np.testing.assert_array_equal(model, plain.initial(rng(3)))
    split = bright_spots(70)
    mine, theirs = (
        network.train(LocalTask(split, np.arange(70), scaling_of(split), model, ONE, rng(1))).model
        for network in (lazy, plain)
    )
    np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("TooFew", r"gives \(2, 9\) for 2 images, not \(2, 10\)"),
        ("WrongImage", r"fails on images of \(2, 1, 8, 8\)"),
        ("needs_argument", "calling it fails"),
        ("needs_a_file", "calling it fails: FileNotFoundError: weights.pt"),
        ("gives_up", "calling it fails: SystemExit: 3"),
        ("NeverUsed", "no forward pass uses the layer of spare.weight: use it"),
        ("not_a_module", "gives an int, not a Module"),
        ("double", "torch.float64"),
        ("frozen", r"parameter layers\.1\.weight is frozen"),
        ("empty", "no parameters"),
        ("absent", "cannot be imported"),
        ("SHAPE", "is a tuple, not callable"),
    ],
)
def test_modules_that_cannot_be_used_are_refused(name: str, reason: str) -> None:
    with pytest.raises(UsersCodeError, match=reason) as caught:
        make_network(f"{__name__}:{name}", image_shape=SHAPE, classes=10)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["import nothing_of_this_name", "def broken(:", "x = y"])
def test_a_module_that_cannot_be_imported_is_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    name = f"user_net_{len(text)}"
    (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UsersCodeError, match=r"cannot be imported: [A-Z]") as caught:
        make_network(f"{name}:Net", image_shape=SHAPE, classes=10)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "installed", "said"),
    [
        ("import torch", False, "needs torch, which is an extra and not installed: pip install"),
        ("from torch import nothing", True, "cannot be imported: ImportError: cannot import name"),
        ("import nothing", False, "cannot be imported: ModuleNotFoundError: No module named 'noth"),
    ],
)
def test_torch_is_said_to_be_missing_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, installed: bool, said: str
) -> None:
    name = f"wants_{len(text)}"
    (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    if not installed:
        monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(UsersCodeError, match=f"learning.trainer = '{name}:make': {said}"):
        CustomTrainer.found(f"{name}:make")


@pytest.mark.parametrize("name", ["resnet", "no.such.module:Net", ":Net", "torch:"])
def test_unknown_networks_are_refused(name: str) -> None:
    with pytest.raises(UsersCodeError):
        make_network(name, image_shape=SHAPE, classes=10)


@pytest.mark.slow
def test_images_too_small_for_the_built_in_networks() -> None:
    with pytest.raises(InputError, match="too small"):
        make_network("lenet", image_shape=(3, 8, 1), classes=10)
    three = ConvNetConfig(channels=(2, 2, 2))
    with pytest.raises(InputError, match="3 blocks halve them to nothing, 8 x 8 is the least"):
        make_network("convnet", convnet=three, image_shape=(8, 7, 1), classes=10)
    make_network("convnet", convnet=three, image_shape=(8, 8, 1), classes=10)
    for size in (*range(4, 14), 16, 21, 28, 39):
        split = Split(np.zeros((3, size, size, 1), np.uint8), np.array([0, 1, 9]))
        for name in ("lenet", "mcmahan"):
            net = make_network(name, image_shape=(size, size, 1), classes=10)
            assert isinstance(net, ConvNet)
            plain = PlainNet(net)
            expected = tuple(tuple(value.shape) for value in plain.parameters())
            assert net.shapes == expected
            result = net.train(
                LocalTask(split, np.arange(3), scaling_of(split), net.initial(rng(1)), ONE, rng(1))
            )
            assert np.isfinite(result.model).all()


@pytest.mark.parametrize(
    ("name", "side", "channels", "inside"),
    [
        # LeNet-5's 28 and 32 pixels have 16 maps of 5 x 5; less have what "same" padding leaves.
        ("lenet", 32, 3, 16 * 5 * 5), ("lenet", 31, 1, 16 * 5 * 5), ("lenet", 28, 1, 16 * 5 * 5),
        ("lenet", 27, 1, 16 * 6 * 6), ("lenet", 16, 3, 16 * 4 * 4), ("lenet", 4, 1, 16),
        ("lenet", 36, 1, 16 * 6 * 6), ("mcmahan", 28, 1, 64 * 7 * 7), ("mcmahan", 8, 3, 64 * 2 * 2),
        ("convnet", 12, 1, 32 * 3 * 3), ("own", 20, 2, 5 * 2 * 2),
    ],
)  # fmt: skip
def test_layers_are_those_of_the_papers(name: str, side: int, channels: int, inside: int) -> None:
    own = ConvNetConfig(channels=(3, 4, 5), kernel=3, hidden=()) if name == "own" else None
    maps, kernel, hidden = {
        "lenet": ((6, 16), 5, (120, 84)), "mcmahan": ((32, 64), 5, (512,)),
        "convnet": ((16, 32), 3, (64,)), "own": ((3, 4, 5), 3, ()),
    }[name]  # fmt: skip
    net = make_network(
        "convnet" if own else name, image_shape=(side, side, channels), classes=7, convnet=own
    )
    assert isinstance(net, ConvNet)
    units = (inside, *hidden, 7)
    depths = (channels, *maps)
    weights: list[tuple[int, ...]]
    weights = [(depths[n + 1], depths[n], kernel, kernel) for n in range(len(maps))]
    weights += [(units[n + 1], units[n]) for n in range(len(hidden) + 1)]
    assert net.shapes == tuple(shape for w in weights for shape in (w, w[:1]))
    assert net.parameters == sum(int(np.prod(w)) + w[0] for w in weights)
    drawn, at = net.initial(np.random.default_rng(1)), 0
    assert drawn.dtype == np.float32
    for w in weights:  # weights and then biases, evenly up to one by the root of what comes in
        bound = float(np.prod(w[1:])) ** -0.5
        for size in (int(np.prod(w)), w[0]):
            part, at = drawn[at : at + size], at + size
            assert np.abs(part).max() <= bound * (1 + 1e-6)
            if size > 100:
                assert part.max() > 0.9 * bound
                assert part.min() < -0.9 * bound
    assert at == len(drawn)


@pytest.mark.parametrize(("side", "fits"), [((4, 4), True), ((9, 3), False), ((3, 9), False)])
def test_blocks_halve_images_of_four_pixels_at_least(side: tuple[int, int], fits: bool) -> None:
    if fits:
        make_network("mcmahan", image_shape=(*side, 1), classes=2)
        return
    with pytest.raises(SettingError, match=r"too small: 2 blocks .*, 4 x 4 is the least"):
        make_network("mcmahan", image_shape=(*side, 1), classes=2)
