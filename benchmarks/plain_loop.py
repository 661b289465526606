"""Local training as one would write it: DataLoader, nn.Module, torch.optim.SGD. The yardstick."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from numpy.typing import NDArray
from torch import nn
from torch.utils.data import DataLoader, TensorDataset

from fl.convnet import ConvNet

Loader = DataLoader[tuple[torch.Tensor, ...]]
MU = 0.1
LEARNING_RATE = 0.01
MOMENTUM = 0.9


class PlainNet(nn.Module):
    """The same network as `fl.convnet.ConvNet`."""

    def __init__(self, net: ConvNet) -> None:
        super().__init__()
        height, width, depth = net.image_shape
        first, second = net.channels
        self.conv1 = nn.Conv2d(depth, first, 5, padding=net.padding[0])
        self.conv2 = nn.Conv2d(first, second, 5, padding=net.padding[1])
        features = self._features(torch.zeros(1, depth, height, width)).numel()
        layers: list[nn.Module] = []
        for width_in, width_out in zip((features, *net.hidden), net.hidden, strict=False):
            layers += [nn.Linear(width_in, width_out), nn.ReLU()]
        self.dense = nn.Sequential(*layers, nn.Linear(net.hidden[-1], net.classes))

    def _features(self, x: torch.Tensor) -> torch.Tensor:
        x = F.max_pool2d(F.relu(self.conv1(x)), 2)
        return F.max_pool2d(F.relu(self.conv2(x)), 2)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Logits of images (batch, channels, height, width)."""
        logits: torch.Tensor = self.dense(self._features(x).flatten(1))
        return logits


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
