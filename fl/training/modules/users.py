"""What a torch module must be to be trained here, and where users' own come from."""

from collections.abc import Callable

import torch
from torch import Tensor, nn
from torch.nn.parameter import is_lazy

from fl.errors import NetworkError, first_line, kind_of
from fl.plugins import FAILURES, PluginError, find, is_plugin

Factory = Callable[[], nn.Module]


def imported(name: str) -> Factory:
    """What "package.module:callable" names; `NetworkError` where there is no such thing."""
    if not is_plugin(name):
        raise NetworkError(name, "it is 'lenet', 'mcmahan' or 'package.module:callable'")
    try:
        factory: Factory = find(name, key="communities.network")
    except PluginError as error:
        raise NetworkError(name, error.reason) from error
    return factory


def made(factory: Factory, images: Tensor) -> nn.Module:
    """What the factory makes; lazy layers have their sizes from one forward pass of the images."""
    module = factory()
    if isinstance(module, nn.Module) and _unsized(module):
        # Not in training: the images are none to learn statistics from.
        training = module.training
        with torch.no_grad():
            module.eval()(images)
        module.train(training)
    return module


def built(factory: Factory, images: Tensor, *, name: str) -> nn.Module:
    """The module that the factory makes, with all its parameters trained as float32.

    Raises `NetworkError`.
    """
    try:
        with torch.random.fork_rng(devices=[]):
            module = made(factory, images)
    except FAILURES as error:
        raise NetworkError(name, f"calling it fails: {first_line(error)}") from error
    if not isinstance(module, nn.Module):
        raise NetworkError(name, f"gives {kind_of(module)}, not a torch.nn.Module")
    if next(iter(module.parameters()), None) is None:
        raise NetworkError(name, "it has no parameters")
    if unsized := _unsized(module):
        reason = f"no forward pass uses the layer of {unsized[0]}: use it, or give it sizes"
        raise NetworkError(name, reason)
    for key, value in module.named_parameters():
        if not value.requires_grad:
            raise NetworkError(name, f"parameter {key} is frozen; all parameters are trained")
        if value.dtype != torch.float32:
            raise NetworkError(name, f"parameter {key} is {value.dtype}, not torch.float32")
    return module


def _unsized(module: nn.Module) -> list[str]:
    """Names of the parameters and buffers that have no size yet."""
    return [
        key
        for key, value in (*module.named_parameters(), *module.named_buffers())
        if is_lazy(value)
    ]


def check_answer(module: nn.Module, images: Tensor, *, name: str, classes: int) -> None:
    """One forward pass, so that a wrong shape shows before the first flight: `NetworkError`."""
    try:
        with torch.inference_mode():
            out = module(images)
    except FAILURES as error:
        reason = f"fails on images of {tuple(images.shape)}: {first_line(error)}"
        raise NetworkError(name, reason) from error
    if not isinstance(out, Tensor):
        raise NetworkError(name, f"gives {kind_of(out)}, not a torch.Tensor")
    if tuple(out.shape) != (len(images), classes):
        raise NetworkError(
            name,
            f"gives {tuple(out.shape)} for {len(images)} images, not ({len(images)}, {classes}):"
            " one logit a class",
        )
