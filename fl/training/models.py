"""The networks by name: LeNet-size, McMahan's CNN, one's own sizes, and any torch module."""

from fl.config import BUILT_IN_NETWORKS, ConvNetConfig
from fl.errors import NetworkError
from fl.training.convnet import ConvNet
from fl.training.local import Network

_SIZES = {
    "lenet": ConvNetConfig(channels=(6, 16), kernel=5, hidden=(120, 84)),
    "mcmahan": ConvNetConfig(channels=(32, 64), kernel=5, hidden=(512,)),
}


def make_network(
    name: str,
    *,
    image_shape: tuple[int, int, int],
    classes: int,
    convnet: ConvNetConfig | None = None,
    device: str = "cpu",
    devices: int = 1,
) -> Network:
    """The network `name` for a task: a built-in one or "package.module:callable".

    LeNet (LeCun et al. 1998): 6 and 16 feature maps, 120 and 84 hidden units; the padding is
    LeNet-5's where the images are 28 or 32 pixels wide, and "same" where they are too small.
    McMahan et al. 2017: 32 and 64 maps, 512 hidden units, "same" padding. "convnet" has the sizes
    of `convnet` and "same" padding. A callable is called without arguments and returns the module.
    On the torch device "cuda" the `devices` of a community train together. `NetworkError` says
    what does not fit.
    """
    if name in BUILT_IN_NETWORKS:
        net = _conv_net(name, convnet, image_shape=image_shape, classes=classes)
        if device == "cpu":
            return net
        # Imported here: native code needs no torch, which takes seconds.
        from fl.training.modules.builtin import BuiltInNetwork

        return BuiltInNetwork(net, name=name, device=device, devices=devices)
    from fl.training.modules.network import ModuleNetwork
    from fl.training.modules.users import imported

    return ModuleNetwork(
        imported(name),
        name=name,
        image_shape=image_shape,
        classes=classes,
        device=device,
        devices=devices,
    )


def _conv_net(
    name: str, convnet: ConvNetConfig | None, *, image_shape: tuple[int, int, int], classes: int
) -> ConvNet:
    sizes = _SIZES.get(name) or convnet or ConvNetConfig()
    smallest, blocks = min(image_shape[:2]), len(sizes.channels)
    if smallest < 2**blocks:
        least = f"{blocks} blocks halve them to nothing, {2**blocks} x {2**blocks} is the least"
        raise NetworkError(name, f"images of {image_shape} are too small: {least}")
    padding = (sizes.kernel // 2,) * blocks
    if name == "lenet":
        first = 0 if smallest >= 32 else 2
        padding = first, 0 if (smallest + 2 * first - 4) // 2 >= 14 else 2
    return ConvNet(image_shape, sizes.channels, sizes.kernel, padding, sizes.hidden, classes)
