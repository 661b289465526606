"""The buffers of a module, such as running means and variances, as one vector."""

import numpy as np
import torch
from torch import nn

from fl.arrays import Vector


class Statistics:
    """Behind a module's parameters in its flat vector: every buffer, in torch's order.

    All travel as float32, counters too; those are rounded when they come back.
    """

    def __init__(self, module: nn.Module) -> None:
        self._buffers = list(module.buffers())
        self.shapes = tuple(tuple(value.shape) for value in self._buffers)
        self.size = sum(value.numel() for value in self._buffers)

    def read(self) -> Vector:
        """(B,) as they are."""
        values = [value.detach().reshape(-1).to("cpu", torch.float32) for value in self._buffers]
        return torch.cat(values).numpy() if values else np.empty(0, np.float32)

    def write(self, flat: Vector) -> None:
        """Make them what (B,) says."""
        pieces = torch.split(torch.tensor(flat), [value.numel() for value in self._buffers])
        with torch.no_grad():
            for value, piece in zip(self._buffers, pieces, strict=True):
                whole = piece if value.is_floating_point() else piece.round()
                value.copy_(whole.reshape(value.shape))
