"""Textbook training of plain `torch.nn.Module`s by torch's own SGD: the reference."""

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import nn


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
