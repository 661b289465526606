"""Local training as one would write it: DataLoader, nn.Module, torch.optim.SGD. The yardstick."""

import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from numpy.typing import NDArray
from torch import nn
from torch.utils.data import DataLoader, TensorDataset

from fl.training.networks import ConvNet

sys.path.append(str(Path(__file__).parents[1] / "tests" / "fl"))
from reference_net import PlainNet as PlainNet  # the tests' own

Loader = DataLoader[tuple[torch.Tensor, ...]]
MU = 0.1
LEARNING_RATE = 0.01
MOMENTUM = 0.9


def loader_of(images: torch.Tensor, labels: torch.Tensor, *, batch: int) -> Loader:
    """Shuffled batches of one device's data."""
    return DataLoader(TensorDataset(images, labels), batch_size=batch, shuffle=True)


def train_plainly(net: nn.Module, loader: Loader) -> None:
    """One epoch of FedProx from the network's present parameters."""
    anchor = [p.detach().clone() for p in net.parameters()]
    optimiser = torch.optim.SGD(net.parameters(), lr=LEARNING_RATE, momentum=MOMENTUM)
    for images, labels in loader:
        optimiser.zero_grad()
        loss = F.cross_entropy(net(images), labels)
        pairs = zip(net.parameters(), anchor, strict=True)
        distance = torch.stack([((p - a) ** 2).sum() for p, a in pairs]).sum()
        (loss + 0.5 * MU * distance).backward()
        optimiser.step()


def plain_epoch(net: nn.Module, loaders: Sequence[Loader]) -> None:
    """One epoch on every device in turn, each from the same global model."""
    start = {key: value.clone() for key, value in net.state_dict().items()}
    for loader in loaders:
        net.load_state_dict(start)
        train_plainly(net, loader)
    net.load_state_dict(start)


@cache
def random_loader(net: ConvNet, device: int, *, samples: int, batch: int) -> Loader:
    """Random data of one device, made once in each process."""
    generator = torch.Generator().manual_seed(device)
    height, width, depth = net.image_shape
    images = torch.randn(samples, depth, height, width, generator=generator)
    labels = torch.randint(0, net.classes, (samples,), generator=generator)
    return loader_of(images, labels, batch=batch)


def arrays_of(net: nn.Module) -> list[NDArray[np.float32]]:
    """The parameters, as Flower sends them."""
    return [value.numpy() for value in net.state_dict().values()]


def load_arrays(net: nn.Module, arrays: Sequence[NDArray[np.float32]]) -> None:
    """The way back."""
    values = map(torch.from_numpy, arrays)
    net.load_state_dict(dict(zip(net.state_dict(), values, strict=True)))
