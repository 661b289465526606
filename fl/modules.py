"""A torch module of the user as a network, on one thread or a GPU: the home of torch."""

import importlib
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  # its customary name
from numpy.typing import NDArray
from torch import Tensor, nn

from fl.datasets import Split
from fl.errors import USERS_MISTAKES, NetworkError, SettingError, first_line
from fl.training import LocalResult, LocalSettings, LocalTask, Scaling, Shapes, Vector, batch_order

EVALUATION_BATCH = 250


class ModuleNetwork:
    """A `torch.nn.Module`, called with images (batch, channels, height, width).

    Buffers (running statistics of batch normalisation) are refused: what they are after
    averaging over devices is not defined. Group or layer normalisation needs none.
    """

    parallel = False  # the module holds the weights, and torch has one generator

    def __init__(
        self, factory: Callable[[], nn.Module], *, name: str, classes: int, device: str = "cpu"
    ) -> None:
        if device == "cuda" and not torch.cuda.is_available():
            raise SettingError("learning.device", device, "torch sees no CUDA device; use 'cpu'")
        self._factory = factory
        self._classes = classes
        self._device = torch.device(device)
        self._module = _built(factory, name).to(self._device)
        self._parameters = list(self._module.parameters())
        if next(iter(self._module.buffers()), None) is not None:
            raise NetworkError(name, "it has buffers (batch normalisation?); use GroupNorm")
        if not self._parameters:
            raise NetworkError(name, "it has no parameters")
        for key, value in self._module.named_parameters():
            if not value.requires_grad:
                raise NetworkError(name, f"parameter {key} is frozen; all parameters are trained")
            if value.dtype != torch.float32:
                raise NetworkError(name, f"parameter {key} is {value.dtype}, not torch.float32")

    @classmethod
    def imported(
        cls, name: str, *, image_shape: tuple[int, int, int], classes: int, device: str
    ) -> "ModuleNetwork":
        """The network that "package.module:callable" makes, tried once: `NetworkError`."""
        network = cls(_imported(name), name=name, classes=classes, device=device)
        network._try(name, image_shape)
        return network

    @property
    def shapes(self) -> Shapes:
        """Shapes in the order of `named_parameters`."""
        return tuple(tuple(value.shape) for value in self._parameters)

    def initial(self, rng: np.random.Generator) -> Vector:
        """The module's own initialisation, with torch's generator seeded from `rng`."""
        with self._own_randomness(rng):
            values = [value.detach().reshape(-1) for value in self._factory().parameters()]
        return np.concatenate([value.numpy() for value in values])

    def train(
        self,
        split: Split,
        model: Vector,
        task: LocalTask,
        *,
        scaling: Scaling,
        settings: LocalSettings,
    ) -> LocalResult:
        """Local training from the global `model` (P,); dropout draws from the device's stream."""
        order = batch_order(task, settings)
        anchor = self._tensor(model.copy())
        weights = anchor.clone()
        velocity = torch.zeros_like(weights)
        correction = None if task.correction is None else self._tensor(task.correction.copy())
        total = torch.zeros((), dtype=torch.float64, device=self._device)
        self._take(weights)
        self._module.train()
        with self._repeatable(), self._own_randomness(task.rng):
            for padded in order:
                chosen = padded[padded >= 0]
                logits = self._module(self._images(split, chosen, scaling))
                loss = F.cross_entropy(logits, self._tensor(split.labels[chosen]))
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
        return LocalResult(weights.cpu().numpy(), len(order), float(total) / len(order))

    def correct_per_class(
        self, split: Split, model: Vector, *, scaling: Scaling
    ) -> NDArray[np.int64]:
        """How many images of each class the model gets right, (classes,)."""
        correct = np.zeros(self._classes, dtype=np.int64)
        self._take(self._tensor(model.copy()))
        self._module.eval()
        with self._repeatable(), torch.inference_mode():
            for start in range(0, len(split.labels), EVALUATION_BATCH):
                part = np.arange(start, min(start + EVALUATION_BATCH, len(split.labels)))
                guess = self._module(self._images(split, part, scaling)).argmax(dim=1).cpu().numpy()
                right = split.labels[part][guess == split.labels[part]]
                correct += np.bincount(right, minlength=self._classes)
        return correct

    def _take(self, flat: Tensor) -> None:
        """Make the module's parameters views of the flat vector (P,)."""
        pieces = torch.split(flat, [math.prod(shape) for shape in self.shapes])
        for parameter, piece in zip(self._parameters, pieces, strict=True):
            parameter.data = piece.view(parameter.shape)

    def _tensor(self, array: NDArray[np.generic]) -> Tensor:
        return torch.from_numpy(array).to(self._device)

    def _images(self, split: Split, chosen: NDArray[np.int64], scaling: Scaling) -> Tensor:
        """Scaled images (batch, channels, height, width)."""
        pixels = self._tensor(split.images[chosen]).permute(0, 3, 1, 2).to(torch.float32)
        scale, shift = (self._tensor(x)[:, None, None] for x in (scaling.scale, scaling.shift))
        return torch.addcmul(shift, pixels, scale)

    @contextmanager
    def _repeatable(self) -> Iterator[None]:
        """One thread, so that sums do not depend on the number of cores; fixed GPU algorithms."""
        before = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            with torch.backends.cudnn.flags(benchmark=False, deterministic=True, allow_tf32=False):
                yield
        finally:
            torch.set_num_threads(before)

    @contextmanager
    def _own_randomness(self, rng: np.random.Generator) -> Iterator[None]:
        """Torch's generators seeded from a stream of its own, given back as they were."""
        gpus = [torch.cuda.current_device()] if self._device.type == "cuda" else []
        with torch.random.fork_rng(devices=gpus):
            torch.manual_seed(int(rng.integers(2**63)))
            yield

    def _try(self, name: str, image_shape: tuple[int, int, int]) -> None:
        """One forward pass, so that a wrong shape shows before the first flight."""
        height, width, channels = image_shape
        try:
            with torch.inference_mode():
                images = torch.zeros(2, channels, height, width, device=self._device)
                out = self._module(images)
        except USERS_MISTAKES as error:
            raise NetworkError(
                name,
                f"fails on images of (2, {channels}, {height}, {width}): {first_line(error)}",
            ) from error
        if not isinstance(out, Tensor):
            raise NetworkError(name, f"gives a {type(out).__name__}, not a torch.Tensor")
        if tuple(out.shape) != (2, self._classes):
            raise NetworkError(
                name,
                f"gives {tuple(out.shape)} for 2 images, not (2, {self._classes}):"
                " one logit a class",
            )


def _imported(name: str) -> Callable[[], nn.Module]:
    module_name, colon, attribute = name.partition(":")
    if not colon or not module_name or not attribute:
        raise NetworkError(name, "it is 'lenet', 'mcmahan' or 'package.module:callable'")
    try:
        found = getattr(importlib.import_module(module_name), attribute)
    except USERS_MISTAKES as error:
        raise NetworkError(name, f"cannot be imported: {first_line(error)}") from error
    if not callable(found):
        raise NetworkError(name, f"is a {type(found).__name__}, not callable")
    factory: Callable[[], nn.Module] = found
    return factory


def _built(factory: Callable[[], nn.Module], name: str) -> nn.Module:
    try:
        with torch.random.fork_rng(devices=[]):
            module = factory()
    except USERS_MISTAKES as error:
        raise NetworkError(name, f"calling it fails: {first_line(error)}") from error
    if not isinstance(module, nn.Module):
        raise NetworkError(name, f"gives a {type(module).__name__}, not a torch.nn.Module")
    return module
