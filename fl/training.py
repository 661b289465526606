"""Local training and evaluation: SGD with momentum and FedProx's proximal term, on one thread.

Devices of a community train side by side in one network (`fl.models`). Every device takes its
own batches, in an order from its own random stream, and its own number of steps; devices with
more steps go on while the others have finished.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from fl.datasets import Split
from fl.models import Network, Vector

Result = TypeVar("Result")

EVALUATION_BATCH = 250
# Beyond this many parameters, devices one by one keep weights and gradients in the cache.
SIDE_BY_SIDE_PARAMETERS = 500_000


@dataclass(frozen=True)
class Scaling:
    """Pixels to what the network sees: scale * pixel + shift, per channel."""

    scale: NDArray[np.float32]  # (channels,)
    shift: NDArray[np.float32]


@dataclass(frozen=True)
class LocalSettings:
    """How every device trains."""

    learning_rate: float
    momentum: float
    mu: float  # weight of mu/2 |w - w_global|^2
    batch_size: int
    epochs: int
    batched: bool = True


@dataclass(frozen=True)
class LocalTask:
    """One device's work: the samples it owns and its random stream for this round."""

    samples: NDArray[np.int64]
    rng: np.random.Generator
    correction: Vector | None = None  # added to every gradient (control variates)


@dataclass(frozen=True)
class LocalResult:
    """What one device sends up."""

    model: Vector
    steps: int
    loss: float  # mean over its steps, without the proximal term


def scaling_of(split: Split) -> Scaling:
    """Zero mean and unit variance per channel over a split."""
    channels = split.images.shape[-1]
    unit = 255.0 if split.images.dtype == np.uint8 else 1.0
    total = np.zeros(channels)
    squares = np.zeros(channels)
    for start in range(0, len(split.images), 4096):
        part = split.images[start : start + 4096].reshape(-1, channels).astype(np.float64)
        total += part.sum(axis=0)
        squares += np.square(part).sum(axis=0)
    count = split.images.size // channels
    mean = total / count
    deviation = np.sqrt(np.maximum(squares / count - mean**2, (1e-3 * unit) ** 2))
    return Scaling((1.0 / deviation).astype(np.float32), (-mean / deviation).astype(np.float32))


def train(
    network: Network,
    split: Split,
    model: Vector,
    tasks: Sequence[LocalTask],
    *,
    scaling: Scaling,
    settings: LocalSettings,
) -> list[LocalResult]:
    """Train every task from the global `model` (P,); results in the order of `tasks`.

    Minimises the mean cross-entropy of each batch plus mu/2 |w - model|^2. The last batch of an
    epoch may be smaller. Devices do not influence one another beyond rounding.
    """
    if not tasks:
        return []
    alone = not (
        settings.batched and network.side_by_side and model.size <= SIDE_BY_SIDE_PARAMETERS
    )
    groups = [[task] for task in tasks] if alone else [list(tasks)]
    results: list[LocalResult] = []
    with one_thread():
        for group in groups:
            with _own_randomness(network, group):
                results += _train_group(network, split, model, group, scaling, settings)
    return results


def correct_per_class(
    network: Network, split: Split, model: Vector, *, scaling: Scaling, classes: int
) -> NDArray[np.int64]:
    """How many images of each class one model gets right, (classes,)."""
    correct = np.zeros(classes, dtype=np.int64)
    with one_thread(), torch.inference_mode():
        weights = [part[None] for part in _parts(network, torch.from_numpy(model.copy()))]
        for start in range(0, len(split.labels), EVALUATION_BATCH):
            part = np.arange(start, min(start + EVALUATION_BATCH, len(split.labels)))
            logits = network.logits(weights, _batch(split, part[None], scaling))
            right = logits[0].argmax(dim=1).numpy() == split.labels[part]
            correct += np.bincount(split.labels[part][right], minlength=classes)
    return correct


def _train_group(
    network: Network,
    split: Split,
    model: Vector,
    tasks: Sequence[LocalTask],
    scaling: Scaling,
    settings: LocalSettings,
) -> list[LocalResult]:
    orders = [_batch_order(task, settings) for task in tasks]
    # Longest first, so that those still training are always the first ones.
    ranks = sorted(range(len(tasks)), key=lambda i: -len(orders[i]))
    steps = [len(orders[i]) for i in ranks]
    anchor = torch.from_numpy(model.copy())
    stacked = [part.expand(len(tasks), *part.shape).clone() for part in _parts(network, anchor)]
    velocity = [torch.zeros_like(part) for part in stacked]
    anchors = [part[None] for part in _parts(network, anchor)]
    corrections = _corrections(network, [tasks[i] for i in ranks])
    losses = torch.zeros(len(tasks))
    done = 0
    for active in range(len(tasks), 0, -1):
        end = steps[active - 1]
        if end == done:
            continue
        weights = [part[:active].detach().requires_grad_() for part in stacked]
        moving = [part[:active] for part in velocity]
        extra = None if corrections is None else [part[:active] for part in corrections]
        for step in range(done, end):
            indices = np.stack([orders[i][step] for i in ranks[:active]])
            share = torch.from_numpy(_shares(indices))
            labels = torch.from_numpy(split.labels[indices])
            logits = network.logits(weights, _batch(split, indices, scaling))
            picked = logits.log_softmax(dim=2).gather(2, labels[:, :, None])[:, :, 0]
            # A padded sample has share 0; nan * 0 is nan, so a diverged device shows anyway.
            loss = -(picked * share).sum(dim=1)
            gradients = torch.autograd.grad(loss.sum(), weights)
            losses[:active] += loss.detach()
            with torch.no_grad():
                _descend(weights, gradients, moving, anchors, extra, settings)
        done = end
    trained = torch.cat([part.flatten(1) for part in stacked], dim=1).numpy()
    results: list[LocalResult | None] = [None] * len(tasks)
    for row, i in enumerate(ranks):
        results[i] = LocalResult(trained[row].copy(), steps[row], float(losses[row]) / steps[row])
    return [result for result in results if result is not None]


def _descend(
    weights: Sequence[Tensor],
    gradients: Sequence[Tensor],
    velocity: Sequence[Tensor],
    anchors: Sequence[Tensor],
    corrections: Sequence[Tensor] | None,
    settings: LocalSettings,
) -> None:
    """v = m v + g + mu (w - w_global), w -= eta v, in place."""
    for index, (w, g, v, a) in enumerate(zip(weights, gradients, velocity, anchors, strict=True)):
        v.mul_(settings.momentum).add_(g)
        if settings.mu:
            v.add_(w, alpha=settings.mu).sub_(a, alpha=settings.mu)
        if corrections is not None:
            v.add_(corrections[index])
        w.sub_(v, alpha=settings.learning_rate)


def _batch_order(task: LocalTask, settings: LocalSettings) -> NDArray[np.int64]:
    """(steps, batch) indices of the samples of each step, -1 where an epoch's last batch ends."""
    size = min(settings.batch_size, len(task.samples))
    steps = -(-len(task.samples) // size)
    epochs = []
    for _ in range(settings.epochs):
        order = np.full(steps * size, -1, dtype=np.int64)
        order[: len(task.samples)] = task.rng.permutation(task.samples)
        epochs.append(order.reshape(steps, size))
    return np.pad(
        np.concatenate(epochs), ((0, 0), (0, settings.batch_size - size)), constant_values=-1
    )


def _shares(indices: NDArray[np.int64]) -> NDArray[np.float32]:
    """Weight of each sample in its device's mean: 1 / batch size, 0 for padding."""
    real = indices >= 0
    return np.asarray(real / real.sum(axis=1, keepdims=True), dtype=np.float32)


def _batch(split: Split, indices: NDArray[np.int64], scaling: Scaling) -> Tensor:
    """Scaled images (batch, height, width, device, channel) of indices (device, batch)."""
    pixels = torch.from_numpy(split.images[indices]).permute(1, 2, 3, 0, 4)
    images = torch.empty(pixels.shape)
    # Trading places, converting and scaling in one pass per channel is the quickest way.
    for channel, (scale, shift) in enumerate(zip(scaling.scale, scaling.shift, strict=True)):
        torch.add(
            torch.tensor(shift),
            pixels[..., channel],
            alpha=float(scale),
            out=images[..., channel],
        )
    return images


def _parts(network: Network, flat: Tensor) -> list[Tensor]:
    """The parameters as views of the flat vector (P,)."""
    sizes = [int(np.prod(shape)) for shape in network.shapes]
    pieces = torch.split(flat, sizes)
    return [piece.view(shape) for piece, shape in zip(pieces, network.shapes, strict=True)]


def _corrections(network: Network, tasks: Sequence[LocalTask]) -> list[Tensor] | None:
    if all(task.correction is None for task in tasks):
        return None
    size = sum(int(np.prod(shape)) for shape in network.shapes)
    rows = [
        np.zeros(size, np.float32) if task.correction is None else task.correction for task in tasks
    ]
    parts = [_parts(network, torch.from_numpy(row.copy())) for row in rows]
    return [torch.stack(list(same)) for same in zip(*parts, strict=True)]


@contextmanager
def one_thread() -> Iterator[None]:
    """One torch thread: sums then never depend on how many cores happen to be there."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def in_parallel(jobs: Sequence[Callable[[], Result]], *, workers: int) -> list[Result]:
    """The results of `jobs` in order, up to `workers` at a time, each on one torch thread.

    torch's thread count is partly the process's and partly each thread's own, so it is set here
    and in every worker, and given back when all are done.
    """
    if workers <= 1 or len(jobs) <= 1:
        return [job() for job in jobs]
    with (
        one_thread(),
        ThreadPoolExecutor(
            min(workers, len(jobs)), initializer=torch.set_num_threads, initargs=(1,)
        ) as pool,
    ):
        return [future.result() for future in [pool.submit(job) for job in jobs]]


@contextmanager
def _own_randomness(network: Network, tasks: Sequence[LocalTask]) -> Iterator[None]:
    """Torch's generator (dropout in a user's module) seeded from the device's own stream."""
    if network.side_by_side:
        yield
        return
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(tasks[0].rng.integers(2**63)))
        yield
