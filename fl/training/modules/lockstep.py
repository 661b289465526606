"""Devices of a community that take every step of their training together, by `torch.func`."""

import math
from collections.abc import Sequence

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  # its customary name
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.func import functional_call, grad_and_value, vmap

from fl.arrays import Vector
from fl.data.dataset import Split
from fl.training.local import LocalResult, LocalSettings, LocalTask, LocalWork, Scaling, batch_order
from fl.training.modules.cuda import captured

Order = NDArray[np.int64]


class Lockstep:
    """Local training of up to `slots` devices at a time.

    Raises what torch does (`RuntimeError`) for modules that `vmap` or a CUDA graph cannot take:
    those that draw random numbers, or look at what they compute.
    """

    def __init__(self, module: nn.Module, device: torch.device, *, slots: int) -> None:
        self._module = module
        self._device = device
        self._slots = slots
        self._step: Step | None = None

    def train(self, work: LocalWork) -> list[LocalResult]:
        """As `fl.training.local.Network.train`."""
        split, tasks, settings = work.split, work.tasks, work.settings
        orders = [batch_order(task, settings) for task in tasks]
        shape = self._slots, max(order.shape[1] for order in orders)
        step = self._step
        # In a run the next round finds it as the last one left it.
        if step is None or not (step.split is split and step.fits(settings, shape[1])):
            self._step = None  # before the next one takes its memory
            step = Step(self._module, split, work.scaling, settings, shape, self._device)
            self._step = step
        results = []
        for start in range(0, len(tasks), self._slots):
            some = slice(start, start + self._slots)
            results += step.train(work.model, tasks[some], orders[some])
        return results


class Step:
    """One step of all slots, over parameters (slots, P) and batches (slots, width, ...).

    Samples that fill up a batch weigh nothing, and a slot without a batch stays as it is: an empty
    one, or one whose device's epochs have ended. There are as many slots in every round, so that
    the arithmetic of a device is the same whoever trains beside it. All that a step reads and
    writes stays where it is in memory, the images too: on a GPU the step is captured as a graph.
    """

    def __init__(
        self,
        module: nn.Module,
        split: Split,
        scaling: Scaling,
        settings: LocalSettings,
        shape: tuple[int, int],
        device: torch.device,
    ) -> None:
        self.split = split
        self._module = module
        self._settings = settings
        self._shapes = {name: value.shape for name, value in module.named_parameters()}
        self._images, self._labels, scale, shift = (
            torch.tensor(x, device=device)
            for x in (split.images, split.labels, scaling.scale, scaling.shift)
        )
        self._scale, self._shift = scale[:, None, None], shift[:, None, None]
        slots, _ = shape
        count = sum(map(math.prod, self._shapes.values()))
        self._chosen = torch.full(shape, -1, device=device)  # sample of each slot's batch, or -1
        self._anchor = torch.zeros(count, device=device)
        self._weights = torch.zeros(slots, count, device=device)
        self._velocity = torch.zeros_like(self._weights)
        self._correction = torch.zeros_like(self._weights)
        self._loss = torch.zeros(slots, dtype=torch.float64, device=device)
        self._replay = captured(self._eagerly) if device.type == "cuda" else None

    def fits(self, settings: LocalSettings, width: int) -> bool:
        """Whether it trains with these settings in batches of up to `width`."""
        return self._settings == settings and self._chosen.shape[1] == width

    def train(
        self, model: Vector, tasks: Sequence[LocalTask], orders: Sequence[Order]
    ) -> list[LocalResult]:
        """All steps of at most as many tasks as there are slots; `orders` are their batches."""
        batches = np.full((max(map(len, orders)), *self._chosen.shape), -1)
        for slot, order in enumerate(orders):
            batches[: len(order), slot, : order.shape[1]] = order
        self._anchor.copy_(torch.tensor(model))
        self._weights.copy_(self._anchor)
        self._velocity.zero_()
        self._correction.zero_()
        for slot, task in enumerate(tasks):
            if task.correction is not None:
                self._correction[slot].copy_(torch.tensor(task.correction))
        self._loss.zero_()
        advance = self._replay or self._eagerly
        for batch in torch.from_numpy(batches).to(self._chosen.device):
            self._chosen.copy_(batch)
            advance()
        models, losses = self._weights.cpu().numpy(), self._loss.cpu().numpy()
        return [
            LocalResult(models[slot].copy(), len(order), float(losses[slot]) / len(order))
            for slot, order in enumerate(orders)
        ]

    def _eagerly(self) -> None:
        """What `OneByOne` does in one step of one device, for the batches in `_chosen`."""
        valid = self._chosen >= 0
        # Filled up with the batch's first sample, which is finite if the batch is.
        index = torch.where(valid, self._chosen, self._chosen[:, :1].clamp(min=0))
        pixels = self._images[index].permute(0, 1, 4, 2, 3).to(torch.float32)
        images = torch.addcmul(self._shift, pixels, self._scale)
        slopes_of = vmap(grad_and_value(self._mean_loss), randomness="error")
        slopes, losses = slopes_of(self._weights, images, self._labels[index], valid)
        slopes.add_(self._correction)
        slopes.add_(self._weights, alpha=self._settings.mu)
        slopes.sub_(self._anchor, alpha=self._settings.mu)
        self._velocity.mul_(self._settings.momentum).add_(slopes)
        moves = torch.where(valid[:, :1], self._velocity, 0.0)
        self._weights.sub_(moves, alpha=self._settings.learning_rate)
        self._loss.add_(losses)

    def _mean_loss(self, flat: Tensor, images: Tensor, labels: Tensor, valid: Tensor) -> Tensor:
        """Mean cross-entropy of one slot's batch under its parameters (P,)."""
        pieces = torch.split(flat, [math.prod(shape) for shape in self._shapes.values()])
        parameters = {
            name: piece.view(shape)
            for (name, shape), piece in zip(self._shapes.items(), pieces, strict=True)
        }
        logits = functional_call(self._module, parameters, (images,))
        losses = F.cross_entropy(logits, labels, reduction="none")
        return torch.where(valid, losses, 0.0).sum() / valid.sum().clamp(min=1)
