"""The C interface of training (`learning.h`), every size and pointer checked once."""

import ctypes
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from native.building import library
from native.loading import address, check_sizes, functions, load

MOST_BLOCKS = MOST_LAYERS = 8
KERNELS = (3, 5)
WAVES = 200  # of a field of shadowing

_POINTER, _INT, _FLOAT = ctypes.c_void_p, ctypes.c_int64, ctypes.c_float

Floats = NDArray[np.float32]
Indices = NDArray[np.int64]


class _Network(ctypes.Structure):
    _fields_ = (
        *(("height", _INT), ("width", _INT), ("channels", _INT), ("blocks", _INT)),
        *((name, _INT * MOST_BLOCKS) for name in ("maps", "kernel", "padding")),
        *(("layers", _INT), ("outputs", _INT * MOST_LAYERS)),
    )


class _Images(ctypes.Structure):
    _fields_ = (
        ("count", _INT),
        *((name, _POINTER) for name in ("bytes", "floats", "labels", "scale", "shift")),
    )


class _Rates(ctypes.Structure):
    _fields_ = (("learning_rate", _FLOAT), ("momentum", _FLOAT), ("mu", _FLOAT))


class _Functions(ctypes.Structure):
    _fields_ = (
        ("train", ctypes.CFUNCTYPE(ctypes.c_int, *[_POINTER] * 3, _INT, _INT, *[_POINTER] * 5)),
        ("count_correct", ctypes.CFUNCTYPE(ctypes.c_int, *[_POINTER] * 4)),
        ("average_per", ctypes.CFUNCTYPE(ctypes.c_int, _POINTER, _INT, *[_POINTER] * 3)),
        ("gains", ctypes.CFUNCTYPE(ctypes.c_int, _POINTER, _INT, *[_POINTER] * 6)),
        ("normal_shares", ctypes.CFUNCTYPE(ctypes.c_int, _INT, *[_POINTER] * 2)),
    )


class _Field(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_double * WAVES) for name in ("east", "north", "phase"))


class _City(ctypes.Structure):
    _fields_ = (
        *((name, _POINTER) for name in ("devices", "fields", "entries")),
        ("count", _INT),  # and what follows: `Buildings`
        *((name, _POINTER) for name in ("walls", "first", "boxes", "floors", "roofs")),
        *(("carrier", ctypes.c_double), ("macro", _INT)),
    )


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
        if len(self.maps) > MOST_BLOCKS or not 0 < len(self.outputs) <= MOST_LAYERS:
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

    def as_c(self) -> _Network:
        """Convert it to the structure that C takes."""
        blocks, layers = _INT * MOST_BLOCKS, _INT * MOST_LAYERS
        each = (blocks(*sizes) for sizes in (self.maps, self.kernels, self.padding))
        dense = len(self.outputs), layers(*self.outputs)
        return _Network(*self.image_shape, len(self.maps), *each, *dense)


@dataclass(frozen=True)
class Images:
    """Images (n, height, width, channels), their labels (n,), and the scaling of each channel."""

    pixels: NDArray[np.uint8] | Floats
    labels: Indices
    scale: Floats
    shift: Floats

    def as_c(self, network: Network) -> _Images:
        """Convert them to the structure that C takes; the arrays have to outlive it."""
        count, channels = len(self.labels), network.image_shape[2]
        if count and not 0 <= self.labels.min() <= self.labels.max() < network.classes:
            raise ValueError(f"labels must be from 0 to {network.classes - 1}")
        kind = np.uint8 if self.pixels.dtype == np.uint8 else np.float32
        pixels = address(self.pixels, kind, (count, *network.image_shape))
        return _Images(
            count,
            pixels if kind is np.uint8 else None,
            None if kind is np.uint8 else pixels,
            address(self.labels, np.int64, (count,)),
            address(self.scale, np.float32, (channels,)),
            address(self.shift, np.float32, (channels,)),
        )


_LIBRARY = load(library("learning"))
check_sizes(
    _LIBRARY, Network=_Network, Images=_Images, Rates=_Rates, Learning=_Functions,
    City=_City, Field=_Field,
)  # fmt: skip
_FUNCTIONS = functions(_LIBRARY, _Functions)


def train(
    network: Network,
    images: Images,
    order: Indices,
    model: Floats,
    *,
    correction: Floats | None,
    rates: Sequence[float],
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
    shared = network.as_c(), images.as_c(network), _Rates(*rates)
    weights, loss = np.empty_like(model), ctypes.c_double()
    failed = _FUNCTIONS.train(
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
    failed = _FUNCTIONS.count_correct(
        ctypes.addressof(shared[0]),
        ctypes.addressof(shared[1]),
        address(weights, np.float32, (network.parameters,)),
        correct.ctypes.data,
    )
    if failed:
        raise MemoryError("too little memory to use the network")
    return correct


def average_per(
    constants: NDArray[np.float64],
    distance_m: NDArray[np.float64],
    height_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The average packet error rate at distances and heights, 0 or more, of one shape.

    `constants` (9,): those of `Channel` in `learning.h`.

    Raises:
        ValueError: arrays that do not fit together.
    """
    per = np.empty(distance_m.shape)
    _FUNCTIONS.average_per(
        address(constants, np.float64, (9,)),
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
    _FUNCTIONS.normal_shares(values.size, at, shares.ctypes.data)
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
        self._as_c = _City(
            address(devices, np.float64, (len(devices), 3)),
            fields if fields is None else address(fields, np.float64, (len(devices), 2, 3, WAVES)),
            address(entries, np.float64, (len(devices),)),
            count,
            address(walls, np.float64, (len(walls), 4)),
            address(first, np.int64, (count + 1,)),
            address(boxes, np.float64, (count, 4)),
            *(address(height, np.float64, (count,)) for height in heights),
            carrier_ghz,
            macro,
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
        _FUNCTIONS.gains(
            ctypes.byref(self._as_c),
            count,
            address(device, np.int64, (count,)),
            address(places, np.float64, (count, 3)),
            *(values.ctypes.data for values in paths),
        )
        return paths
