"""Textbook training of plain `torch.nn.Module`s by torch's own SGD, and the built-in networks as
such modules: the reference."""

import itertools

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from numpy.typing import NDArray
from torch import Tensor, nn

from fl.training.networks import ConvNet


class PlainNet(nn.Module):
    """The layers of a `ConvNet` in the order in which one writes them, its parameters in theirs."""

    def __init__(self, net: ConvNet) -> None:
        super().__init__()
        height, width, depth = net.image_shape
        pairs = itertools.pairwise((depth, *net.maps))
        self.convolutions = nn.ModuleList(
            nn.Conv2d(*pair, kernel, padding=pad)
            for pair, kernel, pad in zip(pairs, net.kernels, net.padding, strict=True)
        )
        with torch.no_grad():
            features = self.features(torch.zeros(1, depth, height, width)).numel()
        widths = [features, *net.outputs]
        self.dense = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(widths))

    def features(self, x: Tensor) -> Tensor:
        """Maps of (batch, channels, height, width) after all blocks."""
        for convolution in self.convolutions:
            x = F.max_pool2d(F.relu(convolution(x)), 2)
        return x

    def forward(self, x: Tensor) -> Tensor:
        """Logits of images (batch, channels, height, width)."""
        x = self.features(x).flatten(1)
        for index, layer in enumerate(self.dense):
            x = layer(F.relu(x) if index else x)
        return x

    def load(self, flat: NDArray[np.float32]) -> "PlainNet":
        """Take over a flat vector of `ConvNet`."""
        nn.utils.vector_to_parameters(torch.tensor(flat), self.parameters())
        return self

    def flat(self) -> NDArray[np.float32]:
        """The one vector of parameters that the module's own make."""
        return nn.utils.parameters_to_vector(self.parameters()).detach().numpy()


def right_per_class(
    net: nn.Module, images: NDArray[np.float32], labels: NDArray[np.int64], classes: int
) -> NDArray[np.int64]:
    """How many of each class torch's forward pass gets right; `images` are scaled (n, H, W, C)."""
    net.eval()
    with torch.no_grad():
        logits = net(torch.from_numpy(images).permute(0, 3, 1, 2).contiguous())
    right = labels[logits.argmax(dim=1).numpy() == labels]
    return np.bincount(right, minlength=classes)


def train_plainly(
    net: nn.Module,
    images: np.ndarray,
    labels: np.ndarray,
    batches: list[np.ndarray],
    *,
    learning_rate: float,
    momentum: float,
    mu: float,
) -> float:
    """Textbook FedProx: cross-entropy + mu/2 |w - w0|^2 by autograd, torch.optim.SGD.

    `images` are scaled floats (n, H, W, C). Returns the mean cross-entropy over the steps.
    """
    start = [p.detach().clone() for p in net.parameters()]
    optimiser = torch.optim.SGD(net.parameters(), lr=learning_rate, momentum=momentum)
    total = 0.0
    for batch in batches:
        x = torch.from_numpy(images[batch]).permute(0, 3, 1, 2).contiguous()
        loss = F.cross_entropy(net(x), torch.from_numpy(labels[batch]))
        distance = sum(((p - s) ** 2).sum() for p, s in zip(net.parameters(), start, strict=True))
        optimiser.zero_grad()
        (loss + 0.5 * mu * distance).backward()
        optimiser.step()
        total += loss.item()
    return total / len(batches)
