"""A researcher's own torch module as a network: the one home of torch, an extra.

Devices train one after the other on one thread, because the module holds the weights and torch
has one random generator.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  # its customary name
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.parameter import is_lazy

from fl.arrays import Vector
from fl.data.dataset import Split
from fl.plugins import PlugIn
from fl.training.local import LocalResult, LocalTask, Scaling, Shapes, batch_order

EVALUATION_BATCH = 250


class ModuleNetwork:
    """A `Network` of a `torch.nn.Module`, called with images (batch, channels, height, width).

    Raises:
        UsersCodeError: says why a module cannot be used.
    """

    parallel = False

    def __init__(self, plugin: PlugIn, *, image_shape: tuple[int, int, int], classes: int) -> None:
        self._plugin = plugin
        self._classes = classes
        height, width, channels = image_shape
        self._images = torch.zeros(2, channels, height, width)
        self._module = self._checked()
        self._parameters = list(self._module.parameters())
        self._buffers = list(self._module.buffers())

    @property
    def shapes(self) -> Shapes:
        """Shapes of the module's parameters, then of its buffers, in the module's order."""
        return tuple(tuple(value.shape) for value in (*self._parameters, *self._buffers))

    @property
    def buffers(self) -> int:
        """How many numbers the module's buffers hold."""
        return sum(value.numel() for value in self._buffers)

    def initial(self, rng: np.random.Generator) -> Vector:
        """The module's own initialisation, with torch's generator seeded from `rng`."""
        with _seeded(rng):
            module = self._made()
        return _flat([*module.parameters(), *module.buffers()])

    def train(self, task: LocalTask) -> LocalResult:
        """Train by local SGD, as `Network.train`; dropout draws from the device's stream."""
        order, settings = batch_order(task), task.settings
        weights = self._take(task.model)
        anchor, velocity = weights.clone(), torch.zeros_like(weights)
        correction = None if task.correction is None else torch.tensor(task.correction)
        total = torch.zeros((), dtype=torch.float64)
        self._module.train()
        with self._plugin.guarded("training"), _one_thread(), _seeded(task.rng):
            for padded in order:
                chosen = padded[padded >= 0]
                logits = self._module(_images_of(task.split, chosen, task.scaling))
                loss = F.cross_entropy(logits, torch.tensor(task.split.labels[chosen]))
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
        after = np.concatenate([weights.numpy(), _flat(self._buffers)])
        return LocalResult(after, len(order), float(total) / len(order))

    def correct_per_class(
        self, split: Split, model: Vector, *, scaling: Scaling
    ) -> NDArray[np.int64]:
        """How many images of each class the model gets right, (classes,)."""
        correct = np.zeros(self._classes, dtype=np.int64)
        self._take(model)
        self._module.eval()
        with self._plugin.guarded("measuring"), _one_thread(), torch.inference_mode():
            for start in range(0, len(split.labels), EVALUATION_BATCH):
                part = np.arange(start, min(start + EVALUATION_BATCH, len(split.labels)))
                guess = self._module(_images_of(split, part, scaling)).argmax(dim=1).numpy()
                right = split.labels[part][guess == split.labels[part]]
                correct += np.bincount(right, minlength=self._classes)
        return correct

    def _made(self) -> nn.Module:
        """A new module; lazy layers have their sizes from one forward pass."""
        with self._plugin.guarded("calling it fails"):
            module = self._plugin.inner()
            if isinstance(module, nn.Module) and _unsized(module):
                # Not in training: the images are none to learn statistics from.
                training = module.training
                with torch.no_grad():
                    module.eval()(self._images)
                module.train(training)
        return self._plugin.of_kind(module, nn.Module, "it")

    def _checked(self) -> nn.Module:
        """Make a module; refuse one without logits or with frozen or non-float32 parameters."""
        plugin, count = self._plugin, len(self._images)
        with torch.random.fork_rng(devices=[]):
            module = self._made()
        if next(iter(module.parameters()), None) is None:
            plugin.refuse("it has no parameters")
        if unsized := _unsized(module):
            layer = f"the layer of {unsized[0]}"
            plugin.refuse(f"no forward pass uses {layer}: use it, or give it sizes")
        for key, value in module.named_parameters():
            if not value.requires_grad:
                plugin.refuse(f"parameter {key} is frozen; all parameters are trained")
            if value.dtype != torch.float32:
                plugin.refuse(f"parameter {key} is {value.dtype}, not torch.float32")
        shape = tuple(self._images.shape)
        with plugin.guarded(f"fails on images of {shape}"), torch.inference_mode():
            out = module(self._images)
        logits = plugin.of_kind(out, Tensor, "it")
        if tuple(logits.shape) != (count, self._classes):
            plugin.refuse(
                f"gives {tuple(logits.shape)} for {count} images, not ({count}, {self._classes}): "
                "one logit a class"
            )
        return module

    def _take(self, model: Vector) -> Tensor:
        """Load a flat model; return its parameters (P,), of which the module's become views.

        Buffers get the rest. All travel as float32; integer buffers are rounded on their return.
        """
        flat = torch.tensor(model)
        pieces = torch.split(flat, [math.prod(shape) for shape in self.shapes])
        for parameter, piece in zip(self._parameters, pieces, strict=False):  # buffers follow
            parameter.data = piece.view(parameter.shape)
        with torch.no_grad():
            for buffer, piece in zip(self._buffers, pieces[len(self._parameters) :], strict=True):
                whole = piece if buffer.is_floating_point() else piece.round()
                buffer.copy_(whole.reshape(buffer.shape))
        return flat[: len(flat) - self.buffers]


def _flat(values: Sequence[Tensor]) -> Vector:
    """Concatenate tensors into one flat float32 vector."""
    flat = [value.detach().reshape(-1).to(torch.float32) for value in values]
    return torch.cat(flat).numpy() if flat else np.empty(0, np.float32)


def _images_of(split: Split, chosen: NDArray[np.int64], scaling: Scaling) -> Tensor:
    """Scaled images (batch, channels, height, width)."""
    pixels = torch.from_numpy(split.images[chosen]).permute(0, 3, 1, 2).to(torch.float32)
    scale, shift = (torch.tensor(x)[:, None, None] for x in (scaling.scale, scaling.shift))
    return torch.addcmul(shift, pixels, scale)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Context manager: torch on one thread, so that sums do not depend on the number of cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def _seeded(rng: np.random.Generator) -> Iterator[None]:
    """Context manager: torch's generator seeded from `rng`; its state is restored afterwards."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**63)))
        yield


def _unsized(module: nn.Module) -> list[str]:
    """Names of the parameters and buffers of lazy layers that have no size yet."""
    return [
        key
        for key, value in (*module.named_parameters(), *module.named_buffers())
        if is_lazy(value)
    ]
