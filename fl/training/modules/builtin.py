"""The built-in networks as torch modules: what a GPU trains, and what `fl.native` is held to."""

import itertools
from functools import partial

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  # its customary name
from numpy.typing import NDArray
from torch import Tensor, nn

from fl.arrays import Vector
from fl.training.convnet import ConvNet
from fl.training.modules.network import ModuleNetwork


class PlainNet(nn.Module):
    """The layers of a `ConvNet` in the order in which one writes them, its parameters in theirs."""

    def __init__(self, net: ConvNet) -> None:
        super().__init__()
        height, width, depth = net.image_shape
        depths = (depth, *net.channels)
        self.convolutions = nn.ModuleList(
            nn.Conv2d(*pair, net.kernel, padding=pad)
            for pair, pad in zip(itertools.pairwise(depths), net.padding, strict=True)
        )
        with torch.no_grad():
            features = self.features(torch.zeros(1, depth, height, width)).numel()
        widths = [features, *net.hidden, net.classes]
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


class BuiltInNetwork(ModuleNetwork):
    """A `ConvNet` trained by torch, from the same initial parameters."""

    def __init__(
        self,
        net: ConvNet,
        *,
        name: str,
        device: str,
        devices: int = 1,
        lockstep: bool | None = None,
    ) -> None:
        self._net = net
        super().__init__(
            partial(PlainNet, net),
            name=name,
            image_shape=net.image_shape,
            classes=net.classes,
            device=device,
            devices=devices,
            lockstep=lockstep,
        )

    def initial(self, rng: np.random.Generator) -> Vector:
        """The `ConvNet`'s own."""
        return self._net.initial(rng)
