"""The networks by name: LeNet-size, McMahan's CNN, and any torch module of the user."""

from fl.config import BUILT_IN_NETWORKS
from fl.errors import NetworkError
from fl.training.convnet import ConvNet
from fl.training.local import Network


def make_network(
    name: str,
    *,
    image_shape: tuple[int, int, int],
    classes: int,
    device: str = "cpu",
    devices: int = 1,
) -> Network:
    """The network `name` for a task: "lenet", "mcmahan" or "package.module:callable".

    LeNet (LeCun et al. 1998): 6 and 16 feature maps, 120 and 84 hidden units; the padding is
    LeNet-5's where the images are 28 or 32 pixels wide, and "same" where they are too small.
    McMahan et al. 2017: 32 and 64 maps, 512 hidden units, "same" padding. A callable is called
    without arguments and returns the module. On the torch device "cuda" the `devices` of a
    community train together. `NetworkError` says what does not fit.
    """
    smallest = min(image_shape[:2])
    if name in BUILT_IN_NETWORKS:
        if smallest < 4:
            raise NetworkError(name, f"images of {image_shape} are too small, 4 x 4 is the least")
        if name == "lenet":
            first = 0 if smallest >= 32 else 2
            second = 0 if (smallest + 2 * first - 4) // 2 >= 14 else 2
            net = ConvNet(image_shape, (6, 16), (first, second), (120, 84), classes)
        else:
            net = ConvNet(image_shape, (32, 64), (2, 2), (512,), classes)
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
