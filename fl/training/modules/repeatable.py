"""What torch computes, held to be the same every time."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch


@contextmanager
def repeatable() -> Iterator[None]:
    """One thread, so that sums do not depend on the number of cores; fixed GPU algorithms."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.backends.cudnn.flags(benchmark=False, deterministic=True, allow_tf32=False):
            yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def own_randomness(rng: np.random.Generator, device: torch.device) -> Iterator[None]:
    """Torch's generators seeded from a stream of its own, given back as they were."""
    gpus = [torch.cuda.current_device()] if device.type == "cuda" else []
    with torch.random.fork_rng(devices=gpus):
        torch.manual_seed(int(rng.integers(2**63)))
        yield
