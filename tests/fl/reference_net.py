"""The same networks as plain `torch.nn.Module`s, trained by torch's own SGD: the reference."""

import itertools

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import nn

from fl.convnet import ConvNet


class PlainNet(nn.Module):
    """Convolution, ReLU, pooling twice, dense layers: in the order in which one writes them."""

    def __init__(self, net: ConvNet) -> None:
        super().__init__()
        height, width, depth = net.image_shape
        first, second = net.channels
        self.conv1 = nn.Conv2d(depth, first, 5, padding=net.padding[0])
        self.conv2 = nn.Conv2d(first, second, 5, padding=net.padding[1])
        with torch.no_grad():
            features = self.features(torch.zeros(1, depth, height, width)).numel()
        widths = [features, *net.hidden, net.classes]
        self.dense = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(widths))

    def features(self, x: torch.Tensor) -> torch.Tensor:
        x = F.max_pool2d(F.relu(self.conv1(x)), 2)
        return F.max_pool2d(F.relu(self.conv2(x)), 2)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = self.features(x).flatten(1)
        for index, layer in enumerate(self.dense):
            x = layer(F.relu(x) if index else x)
        return x

    def load(self, flat: np.ndarray) -> "PlainNet":
        """Take over a flat vector of `ConvNet`, which lies as torch's own parameters do."""
        nn.utils.vector_to_parameters(torch.from_numpy(flat.copy()), self.parameters())
        return self

    def flat(self) -> np.ndarray:
        """The way back."""
        return nn.utils.parameters_to_vector(self.parameters()).detach().numpy()


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
