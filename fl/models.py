"""The networks: LeNet-size, McMahan's CNN, and any torch module of the user.

A network maps a flat float32 vector of parameters to logits. Several parameter vectors, one per
device, run side by side: convolutions as grouped convolutions in channels-last order, dense
layers as batched products. Images come as (batch, height, width, device, channel), which is
that order without a copy.
"""

import importlib
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  # its customary name
from numpy.typing import NDArray
from torch import Tensor, nn

from fl.errors import NetworkError

Vector = NDArray[np.float32]
Shapes = tuple[tuple[int, ...], ...]


class Network(Protocol):
    """What training needs to know of a network."""

    @property
    def shapes(self) -> Shapes:
        """Shapes of the parameters, in the order in which they lie in the flat vector."""
        ...

    @property
    def side_by_side(self) -> bool:
        """Whether devices may share a call: no randomness of its own, no loop over devices."""
        ...

    def initial(self, rng: np.random.Generator) -> Vector:
        """Initial parameters (P,), a function of the stream alone."""
        ...

    def logits(self, weights: Sequence[Tensor], images: Tensor) -> Tensor:
        """(device, batch, classes) from weights (device, *shape) and images (B, H, W, G, C)."""
        ...


def parameter_count(network: Network) -> int:
    """P, the length of the flat parameter vector."""
    return sum(math.prod(shape) for shape in network.shapes)


@dataclass(frozen=True)
class ConvNet:
    """Two (convolution, 2x2 max-pooling, ReLU) blocks, then dense layers with ReLU between.

    Convolution weights lie as (out, height, width, in), dense ones as (in, out), features are
    flattened as (height, width, channel).
    """

    image_shape: tuple[int, int, int]  # height, width, channels
    channels: tuple[int, int]
    padding: tuple[int, int]
    hidden: tuple[int, ...]
    classes: int
    kernel: int = 5

    side_by_side = True

    @property
    def _feature_shape(self) -> tuple[int, int, int]:
        size = list(self.image_shape[:2])
        for pad in self.padding:
            size = [(s + 2 * pad - self.kernel + 1) // 2 for s in size]
        return size[0], size[1], self.channels[1]

    @property
    def shapes(self) -> Shapes:
        """Weight and bias of each layer in turn."""
        k = self.kernel
        shapes: list[tuple[int, ...]] = []
        fan_in = self.image_shape[2]
        for out in self.channels:
            shapes += [(out, k, k, fan_in), (out,)]
            fan_in = out
        widths = (math.prod(self._feature_shape), *self.hidden, self.classes)
        for before, after in itertools.pairwise(widths):
            shapes += [(before, after), (1, after)]
        return tuple(shapes)

    def initial(self, rng: np.random.Generator) -> Vector:
        """Uniform in +-1/sqrt(fan in), weights and biases alike: the customary start in torch."""
        parts = []
        for weight, bias in zip(self.shapes[::2], self.shapes[1::2], strict=True):
            fan_in = math.prod(weight[1:]) if len(weight) == 4 else weight[0]
            bound = 1.0 / math.sqrt(fan_in)
            parts += [rng.uniform(-bound, bound, math.prod(shape)) for shape in (weight, bias)]
        return np.concatenate(parts).astype(np.float32)

    def logits(self, weights: Sequence[Tensor], images: Tensor) -> Tensor:
        """(G, B, classes) from weights (G, *shape) and images (B, H, W, G, C)."""
        batch, height, width, devices, depth = images.shape
        # A channels-last tensor of devices x channels, as a view.
        x = images.reshape(batch, height, width, devices * depth).permute(0, 3, 1, 2)
        for layer, pad in enumerate(self.padding):
            kernel = weights[2 * layer].flatten(0, 1).permute(0, 3, 1, 2)
            bias = weights[2 * layer + 1].flatten()
            x = F.conv2d(x, kernel, bias, padding=pad, groups=devices)
            # Pooling first: the same values and gradients as ReLU first, on a quarter of them.
            x = F.relu(F.max_pool2d(x, 2))
        height, width, depth = self._feature_shape
        x = x.permute(0, 2, 3, 1).reshape(batch, height, width, devices, depth)
        x = x.permute(3, 0, 1, 2, 4).reshape(devices, batch, height * width * depth)
        dense = weights[2 * len(self.padding) :]
        for index in range(0, len(dense), 2):
            if index:
                x = F.relu(x)
            x = torch.baddbmm(dense[index + 1], x, dense[index])
        return x


class ModuleNetwork:
    """A `torch.nn.Module` of the user, called with images (batch, channels, height, width).

    Buffers (running statistics of batch normalisation) are refused: what they are after
    averaging over devices is not defined. Group or layer normalisation needs none.
    """

    side_by_side = False

    def __init__(self, factory: Callable[[], nn.Module], *, name: str) -> None:
        self._factory = factory
        self._module = _built(factory, name)
        if next(iter(self._module.buffers()), None) is not None:
            raise NetworkError(name, "it has buffers (batch normalisation?); use GroupNorm")
        self._names = tuple(key for key, _ in self._module.named_parameters())
        if not self._names:
            raise NetworkError(name, "it has no parameters")
        for key, value in self._module.named_parameters():
            if value.dtype != torch.float32:
                raise NetworkError(name, f"parameter {key} is {value.dtype}, not torch.float32")

    @property
    def shapes(self) -> Shapes:
        """Shapes in the order of `named_parameters`."""
        return tuple(tuple(value.shape) for _, value in self._module.named_parameters())

    def initial(self, rng: np.random.Generator) -> Vector:
        """The module's own initialisation, with torch's generator seeded from `rng`."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(rng.integers(2**63)))
            values = [value.detach().reshape(-1) for value in self._factory().parameters()]
        return np.concatenate([value.numpy() for value in values])

    def logits(self, weights: Sequence[Tensor], images: Tensor) -> Tensor:
        """(G, B, classes), one device after the other."""
        self._module.train(torch.is_grad_enabled())
        outputs = []
        for device in range(images.shape[3]):
            parameters = {
                key: weight[device] for key, weight in zip(self._names, weights, strict=True)
            }
            batch = images[:, :, :, device, :].permute(0, 3, 1, 2)
            outputs.append(torch.func.functional_call(self._module, parameters, (batch,)))
        return torch.stack(outputs)


def make_network(name: str, *, image_shape: tuple[int, int, int], classes: int) -> Network:
    """The network `name` for a task: "lenet", "mcmahan" or "package.module:callable".

    LeNet (LeCun et al. 1998): 6 and 16 feature maps, 120 and 84 hidden units; the padding is
    LeNet-5's where the images are 28 or 32 pixels wide, and "same" where they are too small.
    McMahan et al. 2017: 32 and 64 maps, 512 hidden units, "same" padding. A callable is called
    without arguments and returns the module. `NetworkError` says what does not fit.
    """
    smallest = min(image_shape[:2])
    if name in ("lenet", "mcmahan") and smallest < 4:
        raise NetworkError(name, f"images of {image_shape} are too small, 4 x 4 is the least")
    if name == "lenet":
        first = 0 if smallest >= 32 else 2
        second = 0 if (smallest + 2 * first - 4) // 2 >= 14 else 2
        return ConvNet(image_shape, (6, 16), (first, second), (120, 84), classes)
    if name == "mcmahan":
        return ConvNet(image_shape, (32, 64), (2, 2), (512,), classes)
    network = ModuleNetwork(_imported(name), name=name)
    _try(network, name, image_shape, classes)
    return network


# What a user's module raises where it does not fit or is unfinished.
_USERS_MISTAKES = (
    ImportError,
    SyntaxError,
    NameError,
    AttributeError,
    TypeError,
    ValueError,
    LookupError,
    ArithmeticError,
    AssertionError,
    RuntimeError,
)


def _first_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}"


def _imported(name: str) -> Callable[[], nn.Module]:
    module_name, colon, attribute = name.partition(":")
    if not colon or not module_name or not attribute:
        raise NetworkError(name, "it is 'lenet', 'mcmahan' or 'package.module:callable'")
    try:
        found = getattr(importlib.import_module(module_name), attribute)
    except _USERS_MISTAKES as error:
        raise NetworkError(name, f"cannot be imported: {_first_line(error)}") from error
    if not callable(found):
        raise NetworkError(name, f"is a {type(found).__name__}, not callable")
    factory: Callable[[], nn.Module] = found
    return factory


def _built(factory: Callable[[], nn.Module], name: str) -> nn.Module:
    try:
        with torch.random.fork_rng(devices=[]):
            module = factory()
    except _USERS_MISTAKES as error:
        raise NetworkError(name, f"calling it fails: {_first_line(error)}") from error
    if not isinstance(module, nn.Module):
        raise NetworkError(name, f"gives a {type(module).__name__}, not a torch.nn.Module")
    return module


def _try(
    network: ModuleNetwork, name: str, image_shape: tuple[int, int, int], classes: int
) -> None:
    """One forward pass, so that a wrong shape shows before the first flight."""
    height, width, channels = image_shape
    weights = [torch.zeros(1, *shape) for shape in network.shapes]
    try:
        with torch.inference_mode():
            out = network.logits(weights, torch.zeros(2, height, width, 1, channels))
    except _USERS_MISTAKES as error:
        raise NetworkError(
            name,
            f"fails on images of (2, {channels}, {height}, {width}): {_first_line(error)}",
        ) from error
    if tuple(out.shape) != (1, 2, classes):
        raise NetworkError(
            name,
            f"gives {tuple(out.shape[1:])} for 2 images, not (2, {classes}): one logit a class",
        )
