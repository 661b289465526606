"""Local training: milliseconds of one core per device step, ours against others.

One step is one batch of 16 images on one device. Everything is measured in this process, on
one thread, in turns, so that a busy machine slows all alike; read the ratios.

    python benchmarks/learning.py [--seconds 4] [--devices 6] [--no-peers]

plain     torch DataLoader, nn.Module, torch.optim.SGD, FedProx term by autograd
module    ours, with the same network as a torch module of the user
ours      ours, with the built-in network: what a run does
floor     the multiply-adds of forward and backward pass at the best speed this core shows

Whole rounds of Flower and of pfl-research follow where they are installed
(`flwr[simulation]`, `pfl[pytorch]`), against our epochs of the same size.
"""

import argparse
import importlib.util
import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from plain_loop import LEARNING_RATE, MOMENTUM, MU, PlainNet, loader_of, plain_epoch

from fl.data.dataset import Split
from fl.training.local import LocalSettings, LocalTask, Network, scaling_of
from fl.training.networks import ConvNet, CustomNetwork, make_network
from fl.training.torch_module import ModuleNetwork

BATCH = 16
SAMPLES_PER_DEVICE = 320
PEER_SAMPLES = 8000  # about the paper's
CASES = (
    ("CIFAR-10 LeNet", "lenet", (32, 32, 3)),
    ("MNIST LeNet", "lenet", (28, 28, 1)),
    ("CIFAR-10 McMahan", "mcmahan", (32, 32, 3)),
    ("MNIST McMahan", "mcmahan", (28, 28, 1)),
)
# Of a round of everybody on all images of either task.
PAPER_STEPS = {"CIFAR-10 LeNet": 50_000 // BATCH, "MNIST LeNet": 60_000 // BATCH}


@dataclass(frozen=True)
class Jobs:
    """One epoch on all devices, done in different ways with the same data."""

    net: ConvNet
    steps: int
    plain: Callable[[], None]
    module: Callable[[], None]
    ours: Callable[[], None]


def make_jobs(name: str, shape: tuple[int, int, int], *, devices: int, samples: int) -> Jobs:
    """`samples` random images a device; what is in them does not matter for the time."""
    rng = np.random.Generator(np.random.PCG64(1))
    net = make_network(name, image_shape=shape, classes=10)
    assert isinstance(net, ConvNet)
    count = devices * samples
    images = rng.integers(0, 256, (count, *shape)).astype(np.uint8)
    split = Split(images, rng.integers(0, 10, count))
    scaling, model = scaling_of(split), net.initial(rng)
    shares = np.array_split(rng.permutation(count), devices)
    floats = torch.from_numpy((split.images * scaling.scale + scaling.shift).astype(np.float32))
    floats, labels = floats.permute(0, 3, 1, 2).contiguous(), torch.from_numpy(split.labels.copy())
    loaders = [loader_of(floats[share], labels[share], batch=BATCH) for share in shares]
    plain = PlainNet(net)

    def ours(network: Network) -> None:
        settings = LocalSettings(LEARNING_RATE, MOMENTUM, MU, BATCH, 1)
        for device, share in enumerate(shares):
            rng = np.random.Generator(np.random.PCG64(device))
            network.train(LocalTask(split, share, scaling, model, settings, rng))

    module = ModuleNetwork(
        CustomNetwork(name, partial(PlainNet, net)), image_shape=shape, classes=10
    )
    return Jobs(
        net=net,
        steps=sum(-(-share.size // BATCH) for share in shares),
        plain=lambda: plain_epoch(plain, loaders),
        module=lambda: ours(module),
        ours=lambda: ours(net),
    )


def training_flops(net: ConvNet) -> float:
    """Floating-point operations of one step: forward, and twice that backward.

    The first layer needs no gradient with respect to the images.
    """
    height, width, depth = net.image_shape
    products = []
    for out, pad in zip(net.maps, net.padding, strict=True):
        height, width = height + 2 * pad - 4, width + 2 * pad - 4
        products.append(height * width * out * depth * 25)
        height, width, depth = height // 2, width // 2, out
    widths = (height * width * depth, *net.outputs)
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


def peers() -> dict[str, Callable[..., float]]:
    """Milliseconds per device step of a whole round, by those that are installed."""
    found: dict[str, Callable[..., float]] = {}
    if importlib.util.find_spec("flwr") is not None:
        from flower_peer import flower_ms_per_step

        found["Flower"] = flower_ms_per_step
    if importlib.util.find_spec("pfl") is not None:
        from pfl_peer import pfl_ms_per_step

        found["pfl"] = pfl_ms_per_step
    return found


def against(name: str, peer: Callable[..., float], jobs: Jobs, *, devices: int) -> str:
    """A peer's rounds against our epochs of the same size just before and after."""
    ours = [in_turns({"ours": jobs.ours}, seconds=2.0)["ours"]]
    theirs = peer(jobs.net, devices=devices, samples=PEER_SAMPLES, batch=BATCH)
    ours.append(in_turns({"ours": jobs.ours}, seconds=2.0)["ours"])
    mean = 1e3 * sum(ours) / 2 / jobs.steps
    return f"{name:<8}{theirs:7.2f}   ours {mean:6.2f}   {theirs / mean:6.2f}x"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=4.0, help="per network")
    parser.add_argument("--devices", type=int, default=6)
    parser.add_argument("--no-peers", action="store_true")
    arguments = parser.parse_args()
    devices: int = arguments.devices
    torch.set_num_threads(1)
    peak = peak_flops()
    print(f"{'ms per device step':<18}   plain  module    ours   floor   plain/ours  ours/floor")
    a_round = 0.0
    for title, name, shape in CASES:
        jobs = make_jobs(name, shape, devices=devices, samples=SAMPLES_PER_DEVICE)
        ways = {"plain": jobs.plain, "module": jobs.module, "ours": jobs.ours}
        taken = in_turns(ways, seconds=arguments.seconds)
        ms = {key: 1e3 * value / jobs.steps for key, value in taken.items()}
        floor = 1e3 * training_flops(jobs.net) / peak
        a_round += 1e-3 * ms["ours"] * PAPER_STEPS.get(title, 0)
        print(
            f"{title:<18} {ms['plain']:7.2f} {ms['module']:7.2f} {ms['ours']:7.2f} {floor:7.2f}"
            f" {ms['plain'] / ms['ours']:11.2f}x {ms['ours'] / floor:9.2f}x",
            flush=True,
        )
    print(f"a round of the paper's experiment, all twelve devices: {a_round:.1f} s of one core")
    lines = []
    for title, network, shape in () if arguments.no_peers else CASES[:2]:
        for name, peer in peers().items():
            jobs = make_jobs(network, shape, devices=devices, samples=PEER_SAMPLES)
            lines.append(f"{title:<18} {against(name, peer, jobs, devices=devices)}")
    if lines:  # last, for the peers print much
        print("\nwhole rounds, ms per device step", *lines, sep="\n")


if __name__ == "__main__":
    main()
