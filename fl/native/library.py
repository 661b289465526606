"""The C interface of training (`learning.h`), every size and pointer checked once."""

import ctypes
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native.building import library
from native.headers import columns
from native.loading import address, interface

LEARNING = interface(library("learning"))
KERNELS = (3, 5)
WAVES: int = LEARNING.WAVES  # of a field of shadowing
_CHANNEL = columns(
    LEARNING.Channel,
    "a1 a2 nearest los_margin los_alpha los_sigma nlos_margin nlos_alpha nlos_sigma",
)
_FIELD = columns(LEARNING.Field, "east north phase")

Floats = NDArray[np.float32]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Network:
    """Sizes of a network: (convolution, 2x2 max-pooling, ReLU) blocks, then dense layers."""

    image_shape: tuple[int, int, int]  # height, width, channels
    maps: tuple[int, ...]  # channels after each block
    kernels: tuple[int, ...]  # widths of their kernels
    padding: tuple[int, ...]
    outputs: tuple[int, ...]  # of the dense layers, the classes last

    def __post_init__(self) -> None:
        """Raise ValueError for sizes that the C code does not support."""
        most = LEARNING.MOST_LAYERS
        if len(self.maps) > LEARNING.MOST_BLOCKS or not 0 < len(self.outputs) <= most:
            raise ValueError(f"{len(self.maps)} blocks and {len(self.outputs)} dense layers")
        if not len(self.maps) == len(self.kernels) == len(self.padding):
            raise ValueError("each block has its maps, kernel and padding")
        fits = all(
            k in KERNELS and 0 <= p < k for k, p in zip(self.kernels, self.padding, strict=True)
        )
        if not fits or min(*self.image_shape, *map(min, self.shapes)) < 1:
            raise ValueError(f"not a network: {self}")

    @cached_property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of weight and bias of each layer in turn; 0 inputs where no pixel is left."""
        height, width, depth = self.image_shape
        weights: list[tuple[int, ...]] = []
        for maps, kernel, padding in zip(self.maps, self.kernels, self.padding, strict=True):
            weights.append((maps, depth, kernel, kernel))
            height, width = ((n + 2 * padding - kernel + 1) // 2 for n in (height, width))
            depth = maps if min(height, width) > 0 else 0
        dense = itertools.pairwise((height * width * depth, *self.outputs))
        weights += [(outputs, inside) for inside, outputs in dense]
        return tuple(shape for weight in weights for shape in (weight, weight[:1]))

    @cached_property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return sum(map(math.prod, self.shapes))

    @property
    def classes(self) -> int:
        """Number of classes: outputs of the last dense layer."""
        return self.outputs[-1]

    def as_c(self) -> Any:
        """Convert it to the structure that C takes."""
        height, width, channels = self.image_shape
        return LEARNING.Network(
            height=height, width=width, channels=channels, blocks=len(self.maps), maps=self.maps,
            kernel=self.kernels, padding=self.padding, layers=len(self.outputs),
            outputs=self.outputs,
        )  # fmt: skip


@dataclass(frozen=True)
class Images:
    """Images (n, height, width, channels), their labels (n,), and the scaling of each channel."""

    pixels: NDArray[np.uint8] | Floats
    labels: Indices
    scale: Floats
    shift: Floats

    def as_c(self, network: Network) -> Any:
        """Convert them to the structure that C takes; the arrays have to outlive it."""
        count, channels = len(self.labels), network.image_shape[2]
        if count and not 0 <= self.labels.min() <= self.labels.max() < network.classes:
            raise ValueError(f"labels must be from 0 to {network.classes - 1}")
        kind = np.uint8 if self.pixels.dtype == np.uint8 else np.float32
        pixels = address(self.pixels, kind, (count, *network.image_shape))
        return LEARNING.Images(
            count=count,
            labels=address(self.labels, np.int64, (count,)),
            scale=address(self.scale, np.float32, (channels,)),
            shift=address(self.shift, np.float32, (channels,)),
            **{"bytes" if kind is np.uint8 else "floats": pixels},
        )


def train(
    network: Network,
    images: Images,
    order: Indices,
    model: Floats,
    *,
    correction: Floats | None,
    rates: tuple[float, float, float],
) -> tuple[Floats, float]:
    """Run SGD steps on the batches of `order` (steps, batch); -1 pads a smaller one.

    Args:
        network: what is trained.
        images: what it is trained on.
        order: indices of images.
        model: (P,) the global model, where they begin.
        correction: (P,) added to every gradient.
        rates: learning rate, momentum, and the weight mu of mu/2 |w - w_global|^2.

    Returns:
        The weights (P,), and the mean cross-entropy over the steps.

    Raises:
        ValueError: arrays that do not fit together.
        MemoryError: there is too little memory.
    """
    steps, batch = order.shape
    if not order.size or order.max() >= len(images.labels) or order[:, 0].min() < 0:
        raise ValueError("every step needs images, and there must be all that are asked for")
    shape = (network.parameters,)
    learning_rate, momentum, mu = rates
    as_c = LEARNING.Rates(learning_rate=learning_rate, momentum=momentum, mu=mu)
    shared = network.as_c(), images.as_c(network), as_c
    weights, loss = np.empty_like(model), ctypes.c_double()
    failed = LEARNING.train(
        ctypes.addressof(shared[0]),
        ctypes.addressof(shared[1]),
        address(order, np.int64, (steps, batch)),
        steps,
        batch,
        address(model, np.float32, shape),
        None if correction is None else address(correction, np.float32, shape),
        ctypes.addressof(shared[2]),
        address(weights, np.float32, shape, written=True),
        ctypes.addressof(loss),
    )
    if failed:
        raise MemoryError("too little memory to train the network")
    return weights, loss.value


def count_correct(network: Network, images: Images, weights: Floats) -> Indices:
    """How many images of each class the weights get right, (classes,).

    Raises:
        ValueError: arrays that do not fit together.
        MemoryError: there is too little memory.
    """
    correct = np.zeros(network.classes, dtype=np.int64)
    shared = network.as_c(), images.as_c(network)
    failed = LEARNING.count_correct(
        ctypes.addressof(shared[0]),
        ctypes.addressof(shared[1]),
        address(weights, np.float32, (network.parameters,)),
        correct.ctypes.data,
    )
    if failed:
        raise MemoryError("too little memory to use the network")
    return correct


def average_per(
    constants: NDArray[np.float64], distance_m: NDArray[np.float64], height_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The average packet error rate at distances and heights, 0 or more, of one shape.

    `constants` (9,): those of `Channel` in `learning.h`.

    Raises:
        ValueError: arrays that do not fit together.
    """
    per = np.empty(distance_m.shape)
    LEARNING.average_per(
        address(constants, np.float64, (_CHANNEL,)),
        per.size,
        address(distance_m, np.float64, per.shape),
        address(height_m, np.float64, per.shape),
        per.ctypes.data,
    )
    return per


def normal_shares(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard normal distribution function at values (n,)."""
    shares = np.empty(values.shape)
    at = address(values, np.float64, values.shape)
    LEARNING.normal_shares(values.size, at, shares.ctypes.data)
    return shares


class Paths(NamedTuple):
    """Paths from devices to the aircraft, (n,) each."""

    gain_db: NDArray[np.float64]
    shadowing_db: NDArray[np.float64]  # its standard deviation, also where none is drawn
    seen: NDArray[np.bool_]  # nothing is in the way but the building that the device is in
    indoors: NDArray[np.bool_]


class City:
    """Devices among buildings, and the gains of paths from them; see `city.h`."""

    def __init__(
        self,
        outlines: Sequence[Sequence[NDArray[np.float64]]],
        heights: NDArray[np.float64],
        *,
        devices: NDArray[np.float64],
        entries: NDArray[np.float64],
        fields: NDArray[np.float64] | None,
        carrier_ghz: float,
        macro: bool,
    ) -> None:
        """Outlines (n, 2) of each building and heights (2, B) of their floors (-inf: the ground)
        and roofs; `devices` (K, 3); `entries` (K,) dB that their walls take, if they are within
        one; `fields` (K, 2, 3, WAVES) of their shadowing.

        Raises:
            ValueError: arrays that do not fit together.
        """
        each = [
            np.vstack([np.hstack((ring, np.roll(ring, -1, axis=0))) for ring in rings])
            for rings in outlines
        ]
        walls, first = np.vstack([np.empty((0, 4)), *each]), np.cumsum([0, *map(len, each)])
        boxes = np.empty((len(each), 4))
        for box, of in zip(boxes, each, strict=True):
            box[:2], box[2:] = of[:, :2].min(axis=0), of[:, :2].max(axis=0)
        # C has their addresses only.
        self._kept = devices, fields, entries, walls, first, boxes, heights
        count = len(each)
        shape = len(devices), 2, _FIELD // WAVES, WAVES
        self._as_c = LEARNING.City(
            devices=address(devices, np.float64, (len(devices), 3)),
            fields=fields if fields is None else address(fields, np.float64, shape),
            entries=address(entries, np.float64, (len(devices),)),
            buildings=LEARNING.Buildings(
                count=count,
                walls=address(walls, np.float64, (len(walls), 4)),
                first=address(first, np.int64, (count + 1,)),
                boxes=address(boxes, np.float64, (count, 4)),
                floors=address(heights[0], np.float64, (count,)),
                roofs=address(heights[1], np.float64, (count,)),
            ),
            carrier=carrier_ghz,
            macro=macro,
        )

    def gains(self, device: Indices, places: NDArray[np.float64]) -> Paths:
        """Return the paths from devices (n,) to places (n, 3).

        Raises:
            ValueError: arrays that do not fit together, or no such device.
        """
        count = len(device)
        if count and not 0 <= device.min() <= device.max() < len(self._kept[0]):
            raise ValueError(f"device must be from 0 to {len(self._kept[0]) - 1}")
        paths = Paths(*np.empty((2, count)), *np.empty((2, count), dtype=np.bool_))
        LEARNING.gains(
            ctypes.byref(self._as_c),
            count,
            address(device, np.int64, (count,)),
            address(places, np.float64, (count, 3)),
            *(values.ctypes.data for values in paths),
        )
        return paths
