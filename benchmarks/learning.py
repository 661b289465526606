"""Local training: milliseconds of one core per device step, ours against a plain loop.

One step is one batch of 16 images on one device. Everything is measured in this process, on
one thread, in turns, so that a busy machine slows all alike; read the ratios.

    python benchmarks/learning.py [--seconds 4] [--devices 6]

plain     torch DataLoader, nn.Module, torch.optim.SGD, FedProx term by autograd, device by device
alone     ours, device by device
together  ours, the devices of a community side by side (what a run uses where it is faster)
floor     the multiply-adds of forward and backward pass at the best speed this core shows
"""

import argparse
import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import nn
from torch.utils.data import DataLoader, TensorDataset

from fl.datasets import Split
from fl.models import ConvNet, make_network, parameter_count
from fl.training import (
    SIDE_BY_SIDE_PARAMETERS,
    LocalSettings,
    LocalTask,
    scaling_of,
    train,
)

BATCH = 16
SAMPLES_PER_DEVICE = 320
CASES = (
    ("CIFAR-10 LeNet", "lenet", (32, 32, 3)),
    ("MNIST LeNet", "lenet", (28, 28, 1)),
    ("CIFAR-10 McMahan", "mcmahan", (32, 32, 3)),
    ("MNIST McMahan", "mcmahan", (28, 28, 1)),
)


class PlainNet(nn.Module):
    """The same network as one would write it."""

    def __init__(self, net: ConvNet) -> None:
        super().__init__()
        height, width, depth = net.image_shape
        first, second = net.channels
        self.conv1 = nn.Conv2d(depth, first, 5, padding=net.padding[0])
        self.conv2 = nn.Conv2d(first, second, 5, padding=net.padding[1])
        features = self._features(torch.zeros(1, depth, height, width)).numel()
        layers: list[nn.Module] = []
        for width_in, width_out in zip((features, *net.hidden), net.hidden, strict=False):
            layers += [nn.Linear(width_in, width_out), nn.ReLU()]
        self.dense = nn.Sequential(*layers, nn.Linear(net.hidden[-1], net.classes))

    def _features(self, x: torch.Tensor) -> torch.Tensor:
        x = F.max_pool2d(F.relu(self.conv1(x)), 2)
        return F.max_pool2d(F.relu(self.conv2(x)), 2)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Logits of images (batch, channels, height, width)."""
        logits: torch.Tensor = self.dense(self._features(x).flatten(1))
        return logits


def plain_epoch(net: nn.Module, loaders: Sequence[DataLoader[tuple[torch.Tensor, ...]]]) -> None:
    """One epoch of FedProx on every device, from the same global model."""
    start = {key: value.clone() for key, value in net.state_dict().items()}
    for loader in loaders:
        net.load_state_dict(start)
        anchor = [p.detach().clone() for p in net.parameters()]
        optimiser = torch.optim.SGD(net.parameters(), lr=0.01, momentum=0.9)
        for images, labels in loader:
            optimiser.zero_grad()
            loss = F.cross_entropy(net(images), labels)
            pairs = zip(net.parameters(), anchor, strict=True)
            distance = torch.stack([((p - a) ** 2).sum() for p, a in pairs]).sum()
            (loss + 0.05 * distance).backward()  # type: ignore[no-untyped-call]
            optimiser.step()
    net.load_state_dict(start)


def training_flops(net: ConvNet) -> float:
    """Floating-point operations of one step: forward, and twice that backward.

    The first layer needs no gradient with respect to the images.
    """
    height, width, depth = net.image_shape
    products = []
    for out, pad in zip(net.channels, net.padding, strict=True):
        height, width = height + 2 * pad - 4, width + 2 * pad - 4
        products.append(height * width * out * depth * 25)
        height, width, depth = height // 2, width // 2, out
    widths = (height * width * depth, *net.hidden, net.classes)
    products += [a * b for a, b in itertools.pairwise(widths)]
    return 2.0 * BATCH * (3.0 * sum(products) - products[0])


def peak_flops() -> float:
    """Operations per second of one thread: the faster of a large product and a large convolution.

    The two come from different libraries, which do not use the processor equally well.
    """
    a, b = torch.randn(1024, 1024), torch.randn(1024, 1024)
    x, k = torch.randn(16, 64, 56, 56), torch.randn(64, 64, 5, 5)
    x = x.contiguous(memory_format=torch.channels_last)
    jobs: tuple[tuple[float, Callable[[], torch.Tensor]], ...] = (
        (2.0 * 1024**3, lambda: torch.mm(a, b)),
        (2.0 * 16 * 64 * 64 * 25 * 52 * 52, lambda: F.conv2d(x, k)),
    )
    best = 0.0
    for _ in range(10):
        for operations, job in jobs:
            start = time.process_time()
            job()
            best = max(best, operations / (time.process_time() - start))
    return best


def in_turns(jobs: dict[str, Callable[[], None]], *, seconds: float) -> dict[str, float]:
    """Median processor seconds of each job, run in turns for `seconds` altogether."""
    taken: dict[str, list[float]] = {key: [] for key in jobs}
    for job in jobs.values():
        job()
    end = time.monotonic() + seconds
    while time.monotonic() < end or min(map(len, taken.values())) < 3:
        for key, job in jobs.items():
            start = time.process_time()
            job()
            taken[key].append(time.process_time() - start)
    return {key: float(np.median(values)) for key, values in taken.items()}


def rows(*, devices: int, seconds: float) -> Iterator[tuple[str, dict[str, float]]]:
    """Milliseconds per device step of each case."""
    peak = peak_flops()
    rng = np.random.Generator(np.random.PCG64(1))
    for title, name, shape in CASES:
        net = make_network(name, image_shape=shape, classes=10)
        assert isinstance(net, ConvNet)
        count = devices * SAMPLES_PER_DEVICE
        images = rng.integers(0, 256, (count, *shape)).astype(np.uint8)
        split = Split(images, rng.integers(0, 10, count))
        scaling, model = scaling_of(split), net.initial(rng)
        shares = np.array_split(rng.permutation(count), devices)
        floats = torch.from_numpy(split.images * scaling.scale + scaling.shift)
        floats = floats.to(torch.float32).permute(0, 3, 1, 2).contiguous()
        labels = torch.from_numpy(split.labels.copy())
        loaders = [
            DataLoader(TensorDataset(floats[share], labels[share]), batch_size=BATCH, shuffle=True)
            for share in shares
        ]
        plain = PlainNet(net)

        def ours(batched: bool) -> None:
            settings = LocalSettings(0.01, 0.9, 0.1, BATCH, 1, batched=batched)
            tasks = [
                LocalTask(share, np.random.Generator(np.random.PCG64(k)))
                for k, share in enumerate(shares)  # noqa: B023  # called before the next case
            ]
            train(net, split, model, tasks, scaling=scaling, settings=settings)  # noqa: B023

        taken = in_turns(
            {
                "plain": lambda: plain_epoch(plain, loaders),  # noqa: B023
                "alone": lambda: ours(False),
                "together": lambda: ours(True),
            },
            seconds=seconds,
        )
        steps = devices * SAMPLES_PER_DEVICE / BATCH
        figures = {key: 1e3 * value / steps for key, value in taken.items()}
        if parameter_count(net) > SIDE_BY_SIDE_PARAMETERS:
            figures["together"] = math.nan
        figures["floor"] = 1e3 * training_flops(net) / peak
        yield title, figures


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seconds", type=float, default=4.0, help="per network")
    parser.add_argument("--devices", type=int, default=6)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    print(f"{'ms per device step':<18}   plain   alone  together   floor   plain/ours  ours/floor")
    for title, ms in rows(devices=arguments.devices, seconds=arguments.seconds):
        ours = np.nanmin([ms["alone"], ms["together"]])
        print(
            f"{title:<18} {ms['plain']:7.2f} {ms['alone']:7.2f} {ms['together']:9.2f}"
            f" {ms['floor']:7.2f} {ms['plain'] / ours:11.2f}x {ours / ms['floor']:9.2f}x"
        )


if __name__ == "__main__":
    main()
