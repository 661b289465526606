"""The same networks as plain `torch.nn.Module`s, trained by torch's own SGD: the reference."""

import itertools

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import nn

from fl.models import ConvNet


class PlainNet(nn.Module):
    """Convolution, ReLU, pooling twice, dense layers: ordinary layout, ordinary order."""

    def __init__(self, net: ConvNet) -> None:
        super().__init__()
        height, width, depth = net.image_shape
        first, second = net.channels
        self.conv1 = nn.Conv2d(depth, first, 5, padding=net.padding[0])
        self.conv2 = nn.Conv2d(first, second, 5, padding=net.padding[1])
        with torch.no_grad():
            features = self.features(torch.zeros(1, depth, height, width))
        self.map_shape = tuple(features.shape[1:])
        widths = [features[0].numel(), *net.hidden, net.classes]
        self.dense = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(widths))

    def features(self, x: torch.Tensor) -> torch.Tensor:
        x = F.max_pool2d(F.relu(self.conv1(x)), 2)
        return F.max_pool2d(F.relu(self.conv2(x)), 2)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = self.features(x).flatten(1)
        for index, layer in enumerate(self.dense):
            x = layer(F.relu(x) if index else x)
        return x

    def _layers(self) -> list[nn.Module]:
        return [self.conv1, self.conv2, *self.dense]

    def load(self, flat: np.ndarray) -> "PlainNet":
        """Take over a flat vector of `ConvNet`: HWC features, (in, out) dense weights."""
        rest = torch.from_numpy(flat.copy())
        channels, height, width = self.map_shape
        for index, layer in enumerate(self._layers()):
            n = layer.weight.numel()
            w, b, rest = rest[:n], rest[n : n + layer.bias.numel()], rest[n + layer.bias.numel() :]
            if index < 2:
                out, inside, k, _ = layer.weight.shape
                w = w.view(out, k, k, inside).permute(0, 3, 1, 2)
            else:
                out, inside = layer.weight.shape
                w = w.view(inside, out).t()
                if index == 2:
                    w = w.view(out, height, width, channels).permute(0, 3, 1, 2).reshape(out, -1)
            layer.weight.data.copy_(w)
            layer.bias.data.copy_(b)
        return self

    def flat(self) -> np.ndarray:
        """The way back."""
        channels, height, width = self.map_shape
        parts = []
        for index, layer in enumerate(self._layers()):
            w = layer.weight.data
            if index < 2:
                w = w.permute(0, 2, 3, 1)
            else:
                if index == 2:
                    out = w.shape[0]
                    w = w.view(out, channels, height, width).permute(0, 2, 3, 1).reshape(out, -1)
                w = w.t()
            parts += [w.reshape(-1), layer.bias.data]
        return torch.cat(parts).numpy()


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
