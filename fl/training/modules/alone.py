"""Devices that train one after the other, each with the module to itself."""

import math
from collections.abc import Sequence

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  # its customary name
from numpy.typing import NDArray
from torch import Tensor, nn

from fl.data.dataset import Split
from fl.training.local import LocalResult, LocalTask, LocalWork, Scaling, batch_order
from fl.training.modules.repeatable import own_randomness
from fl.training.modules.statistics import Statistics


class OneByOne:
    """Local training of any module, dropout and all: it draws from the device's stream."""

    def __init__(self, module: nn.Module, device: torch.device) -> None:
        self._module = module
        self._parameters = list(module.parameters())
        self._statistics = Statistics(module)
        self._device = device

    def train(self, work: LocalWork) -> list[LocalResult]:
        """As `fl.training.local.Network.train`."""
        return [self._train(task, work) for task in work.tasks]

    def _train(self, task: LocalTask, work: LocalWork) -> LocalResult:
        split, scaling, settings = work.split, work.scaling, work.settings
        order = batch_order(task, settings)
        parameters, buffers = np.split(work.model, [work.model.size - self._statistics.size])
        self._statistics.write(buffers)
        anchor = torch.tensor(parameters, device=self._device)
        weights = anchor.clone()
        velocity = torch.zeros_like(weights)
        correction = None
        if task.correction is not None:
            correction = torch.tensor(task.correction, device=self._device)
        total = torch.zeros((), dtype=torch.float64, device=self._device)
        take(self._parameters, weights)
        with own_randomness(task.rng, self._device):
            for padded in order:
                chosen = padded[padded >= 0]
                logits = self._module(images_of(split, chosen, scaling, self._device))
                labels = torch.tensor(split.labels[chosen], device=self._device)
                loss = F.cross_entropy(logits, labels)
                total += loss.detach()
                slopes = torch.autograd.grad(
                    loss, self._parameters, allow_unused=True, materialize_grads=True
                )
                slope = torch.cat([part.reshape(-1) for part in slopes])
                if correction is not None:
                    slope.add_(correction)
                slope.add_(weights, alpha=settings.mu).sub_(anchor, alpha=settings.mu)
                velocity.mul_(settings.momentum).add_(slope)
                weights.sub_(velocity, alpha=settings.learning_rate)
        after = np.concatenate([weights.cpu().numpy(), self._statistics.read()])
        return LocalResult(after, len(order), float(total) / len(order))


def take(parameters: Sequence[nn.Parameter], flat: Tensor) -> None:
    """Make a module's parameters views of the flat vector (P,)."""
    pieces = torch.split(flat, [math.prod(value.shape) for value in parameters])
    for parameter, piece in zip(parameters, pieces, strict=True):
        parameter.data = piece.view(parameter.shape)


def images_of(
    split: Split, chosen: NDArray[np.int64], scaling: Scaling, device: torch.device
) -> Tensor:
    """Scaled images (batch, channels, height, width)."""
    pixels = torch.from_numpy(split.images[chosen]).to(device)
    scale, shift = (
        torch.tensor(x, device=device)[:, None, None] for x in (scaling.scale, scaling.shift)
    )
    return torch.addcmul(shift, pixels.permute(0, 3, 1, 2).to(torch.float32), scale)
