"""The GPU by way of torch: whether there is one, and steps captured as CUDA graphs."""

from collections.abc import Callable

import torch

# What torch's documentation warms up with before it captures.
_WARM_UP_STEPS = 3


def is_there() -> bool:
    """Whether torch sees a CUDA device and was built for it."""
    return torch.cuda.is_available()


def captured(step: Callable[[], None]) -> Callable[[], None]:
    """`step` as a CUDA graph: the same kernels on the same memory, launched as one.

    It runs a few times before it is captured, so its buffers are to be filled afterwards.
    """
    stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
    stream.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(stream):
        for _ in range(_WARM_UP_STEPS):
            step()
    torch.cuda.current_stream().wait_stream(stream)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph, stream=stream):
        step()
    return graph.replay
