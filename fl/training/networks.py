"""The networks by name: LeNet, McMahan's CNN, one's own sizes, and any torch module.

Built-in ones are trained by native code (`fl.native`).
"""

import math

import numpy as np
from numpy.typing import NDArray

from fl.arrays import Vector
from fl.config import BUILT_IN_NETWORKS, ConvNetConfig
from fl.data.dataset import Split
from fl.native.library import Images, count_correct, train
from fl.native.library import Network as NativeNetwork
from fl.plugins import PlugIn, needs_torch
from fl.training.local import LocalResult, LocalTask, Network, Scaling, batch_order
from native.errors import SettingError

_SIZES = {
    "lenet": ConvNetConfig(channels=(6, 16), kernel=5, hidden=(120, 84)),
    "mcmahan": ConvNetConfig(channels=(32, 64), kernel=5, hidden=(512,)),
}


class ConvNet(NativeNetwork):
    """Convolutional network: (convolution, 2x2 max-pooling, ReLU) blocks, dense layers with ReLU.

    Parameters and their order are those of torch's modules: weights (out, in, kernel, kernel) or
    (out, in), then biases; pooled maps are flattened as (channel, height, width).
    """

    parallel = True
    buffers = 0

    def initial(self, rng: np.random.Generator) -> Vector:
        """Draw weights and biases uniformly in +-1/sqrt(fan in), the default of torch."""
        parts = []
        for weight, bias in zip(self.shapes[::2], self.shapes[1::2], strict=True):
            bound = 1.0 / math.sqrt(math.prod(weight[1:]))
            parts += [rng.uniform(-bound, bound, math.prod(shape)) for shape in (weight, bias)]
        return np.concatenate(parts).astype(np.float32)

    def train(self, task: LocalTask) -> LocalResult:
        """Train by local SGD, as `fl.training.local.Network.train`; threads may call it at once."""
        order, how = batch_order(task), task.settings
        weights, loss = train(
            self,
            _images(task.split, task.scaling),
            order,
            task.model,
            correction=task.correction,
            rates=(how.learning_rate, how.momentum, how.mu),
        )
        return LocalResult(weights, len(order), loss)

    def correct_per_class(
        self, split: Split, model: Vector, *, scaling: Scaling
    ) -> NDArray[np.int64]:
        """How many images of each class the model gets right, (classes,)."""
        return count_correct(self, _images(split, scaling), model)


def _images(split: Split, scaling: Scaling) -> Images:
    return Images(split.images, split.labels, scaling.scale, scaling.shift)


class CustomNetwork(PlugIn):
    """A researcher's own network: a factory of torch modules."""

    setting = "communities.network"


def make_network(
    name: str,
    *,
    image_shape: tuple[int, int, int],
    classes: int,
    convnet: ConvNetConfig | None = None,
    community: int | None = None,
) -> Network:
    """The network `name` for a task: a built-in one or "package.module:callable".

    LeNet (LeCun et al. 1998): 6 and 16 feature maps, 120 and 84 hidden units; the padding is
    LeNet-5's where the images are 28 or 32 pixels wide, and "same" where they are too small.
    McMahan et al. 2017: 32 and 64 maps, 512 hidden units, "same" padding. "convnet" has the sizes
    of `convnet` and "same" padding. A callable is called without arguments and returns the module.

    Raises:
        SettingError: says what does not fit.
        UsersCodeError: a module of one's own cannot be used; `community` is whose it is, from 0.
    """
    if name in BUILT_IN_NETWORKS:
        return _conv_net(name, convnet, image_shape=image_shape, classes=classes)
    if reason := needs_torch():
        raise SettingError("network", name, reason)
    factory = CustomNetwork.found(name, community)
    # Imported here: native code needs no torch, an extra that takes seconds.
    from fl.training.torch_module import ModuleNetwork

    return ModuleNetwork(factory, image_shape=image_shape, classes=classes)


def _conv_net(
    name: str, convnet: ConvNetConfig | None, *, image_shape: tuple[int, int, int], classes: int
) -> ConvNet:
    sizes = _SIZES.get(name) or convnet or ConvNetConfig()
    smallest, blocks = min(image_shape[:2]), len(sizes.channels)
    if smallest < 2**blocks:
        least = f"{blocks} blocks halve them to nothing, {2**blocks} x {2**blocks} is the least"
        raise SettingError("network", name, f"images of {image_shape} are too small: {least}")
    padding = (sizes.kernel // 2,) * blocks
    if name == "lenet":
        first = 0 if smallest >= 32 else 2
        padding = first, 0 if (smallest + 2 * first - 4) // 2 >= 14 else 2
    kernels, outputs = (sizes.kernel,) * blocks, (*sizes.hidden, classes)
    return ConvNet(image_shape, sizes.channels, kernels, padding, outputs)
