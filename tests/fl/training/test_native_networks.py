"""Networks of any number of layers, with kernels of 3 and 5, against torch's own SGD."""

import itertools

import numpy as np
import pytest
import torch
from reference_net import train_plainly
from torch import nn

from fl.native import library
from fl.native.library import Images, Network, count_correct, train
from native import building, loading

CLASSES = 7
LEVELS = list(building.levels())[: loading.load(building.library("learning")).best_level() + 1]
SHAPES = {
    "no block": ((3, 4, 2), (), (), (), (9, CLASSES)),
    "one dense layer": ((5, 3, 1), (), (), (), (CLASSES,)),
    "one block of 3": ((9, 8, 3), (5,), (3,), (1,), (11, CLASSES)),
    "one block of 5, an odd channel": ((10, 11, 2), (7,), (5,), (0,), (CLASSES,)),
    "three blocks": ((20, 22, 1), (3, 6, 9), (5, 3, 3), (2, 1, 2), (10, 8, CLASSES)),
    "as LeNet": ((28, 28, 1), (6, 16), (5, 5), (2, 0), (20, 12, CLASSES)),
}


def module(shape, maps, kernels, padding, outputs):
    layers, depth = [], shape[2]
    for out, kernel, pad in zip(maps, kernels, padding, strict=True):
        layers += [nn.Conv2d(depth, out, kernel, padding=pad), nn.ReLU(), nn.MaxPool2d(2)]
        depth = out
    layers.append(nn.Flatten())
    features = nn.Sequential(*layers)(torch.zeros(1, shape[2], *shape[:2])).numel()
    for a, b in itertools.pairwise((features, *outputs)):
        layers += [nn.Linear(a, b), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def flat(net):
    return nn.utils.parameters_to_vector(net.parameters()).detach().numpy().copy()


@pytest.mark.parametrize(
    ("name", "level"),
    [*((name, LEVELS[-1]) for name in SHAPES), *(("three blocks", level) for level in LEVELS[:-1])],
)
def test_training_is_that_of_torch(name, level, monkeypatch):
    monkeypatch.setenv(loading.LEVEL, level)  # another number of parts of the 16 that are at once
    monkeypatch.setattr(library, "LEARNING", loading.interface(building.library("learning")))
    sizes = SHAPES[name]
    torch.manual_seed(1)
    net = module(*sizes)
    weights = flat(net)
    rng = np.random.Generator(np.random.PCG64(2))
    count = 40
    pixels = rng.normal(0.0, 1.0, (count, *sizes[0])).astype(np.float32)
    labels = rng.integers(0, CLASSES, count)
    scale, shift = rng.uniform(0.5, 1.5, (2, sizes[0][2])).astype(np.float32)
    images = Images(pixels, labels, scale, shift)
    order = np.concatenate([rng.permutation(count), [-1, -1]]).reshape(2, 21)
    image, channels, kernels, pools, hidden = sizes
    network = Network(image, channels, kernels, pools, hidden)
    weights, loss = train(network, images, order, weights, correction=None, rates=(0.05, 0.9, 0.1))
    batches = [row[row >= 0] for row in order]
    scaled = pixels * scale + shift
    expected = train_plainly(net, scaled, labels, batches, learning_rate=0.05, momentum=0.9, mu=0.1)
    assert loss == pytest.approx(expected, rel=1e-5)
    np.testing.assert_allclose(weights, flat(net), rtol=1e-4, atol=2e-6)
    guess = net(torch.from_numpy(scaled).permute(0, 3, 1, 2)).argmax(dim=1).numpy()
    right = np.bincount(labels[guess == labels], minlength=CLASSES)
    assert count_correct(network, images, weights).tolist() == right.tolist()
