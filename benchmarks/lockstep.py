"""Devices of a community one by one and in lockstep: milliseconds per device step, in torch.

One step is one batch on one device. The ways take turns, so that a busy machine slows all alike;
read the ratios. On the processor they run on one thread, and processor time counts; on a GPU,
where there is one, wall time.

    python benchmarks/lockstep.py [--devices 6] [--batch 32] [--rounds 5]

built in   the built-in network in `fl.native`, on the processor in either table
one by one the same network as a torch module
lockstep   the same under `torch.func.vmap`; on a GPU as a CUDA graph
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
import torch

from fl.data.dataset import Split
from fl.training.convnet import ConvNet
from fl.training.local import LocalSettings, LocalTask, LocalWork, Network, scaling_of
from fl.training.models import make_network
from fl.training.modules.builtin import BuiltInNetwork

STEPS = 10  # of each device in a round
CASES = (
    ("CIFAR-10 LeNet", "lenet", (32, 32, 3)),
    ("MNIST LeNet", "lenet", (28, 28, 1)),
    ("CIFAR-10 McMahan", "mcmahan", (32, 32, 3)),
    ("MNIST McMahan", "mcmahan", (28, 28, 1)),
)


def rounds_of(
    name: str, shape: tuple[int, int, int], *, device: str, devices: int, batch: int
) -> dict[str, Callable[[], None]]:
    """One round of everybody in each way, on the same random images."""
    net = make_network(name, image_shape=shape, classes=10)
    assert isinstance(net, ConvNet)
    rng = np.random.Generator(np.random.PCG64(1))
    count = devices * STEPS * batch
    images = rng.integers(0, 256, (count, *shape)).astype(np.uint8)
    split = Split(images, rng.integers(0, 10, count))
    scaling, model = scaling_of(split), net.initial(rng)
    shares = np.array_split(rng.permutation(count), devices)
    settings = LocalSettings(0.01, 0.9, 0.1, batch, 1)

    def a_round(network: Network) -> Callable[[], None]:
        def train() -> None:
            tasks = [LocalTask(share, np.random.Generator(np.random.PCG64(1))) for share in shares]
            network.train(LocalWork(split, model, tasks, scaling, settings))

        return train

    alone, together = (
        BuiltInNetwork(net, name=name, device=device, devices=devices, lockstep=lockstep)
        for lockstep in (False, True)
    )
    return {"built in": a_round(net), "one by one": a_round(alone), "lockstep": a_round(together)}


def main() -> None:
    """Print a table for each place."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--devices", type=int, default=6)
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    places = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
    for place in places:
        clock = time.process_time if place == "cpu" else time.perf_counter
        print(f"{place:<18} built in one by one lockstep   one by one/lockstep")
        for title, name, shape in CASES:
            ways = rounds_of(
                name, shape, device=place, devices=arguments.devices, batch=arguments.batch
            )
            taken: dict[str, list[float]] = {way: [] for way in ways}
            for number in range(arguments.rounds + 1):
                for way, train in ways.items():
                    start = clock()
                    train()
                    if number:  # the first one captures
                        taken[way].append(clock() - start)
            ms = {
                way: 1e3 * float(np.median(times)) / (arguments.devices * STEPS)
                for way, times in taken.items()
            }
            print(
                f"{title:<18} {ms['built in']:8.3f} {ms['one by one']:10.3f}"
                f" {ms['lockstep']:8.3f} {ms['one by one'] / ms['lockstep']:15.2f}x",
                flush=True,
            )


if __name__ == "__main__":
    main()
