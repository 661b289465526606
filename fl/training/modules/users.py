"""What a torch module must be to be trained here, and where users' own come from."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from fl.errors import USERS_MISTAKES, NetworkError, first_line, kind_of
from fl.plugins import PluginError, find, is_plugin

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


def built(factory: Factory, name: str) -> nn.Module:
    """The module that the factory makes, with all its parameters trained as float32.

    Raises `NetworkError`.
    """
    try:
        with torch.random.fork_rng(devices=[]):
            module = factory()
    except USERS_MISTAKES as error:
        raise NetworkError(name, f"calling it fails: {first_line(error)}") from error
    if not isinstance(module, nn.Module):
        raise NetworkError(name, f"gives {kind_of(module)}, not a torch.nn.Module")
    if next(iter(module.parameters()), None) is None:
        raise NetworkError(name, "it has no parameters")
    for key, value in module.named_parameters():
        if not value.requires_grad:
            raise NetworkError(name, f"parameter {key} is frozen; all parameters are trained")
        if value.dtype != torch.float32:
            raise NetworkError(name, f"parameter {key} is {value.dtype}, not torch.float32")
    return module


def check_answer(module: nn.Module, images: Tensor, *, name: str, classes: int) -> None:
    """One forward pass, so that a wrong shape shows before the first flight: `NetworkError`."""
    try:
        with torch.inference_mode():
            out = module(images)
    except USERS_MISTAKES as error:
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
