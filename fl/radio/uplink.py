"""Who gets through: packets drawn against the packet error rate where they were sent.

Every device has its own draws in a round whether it transmits or not, so that what happens to
one device depends on no other, and two strategies with one seed meet the same luck.
"""

from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fl.arrays import Floats, frozen
from fl.plugins import PlugIn
from fl.radio.channel import Channel, log_mean_snr, los_probability

Gate = Literal["average", "instantaneous"]
GATES = get_args(Gate)


class Radio(Protocol):
    """Packet error rates by distance and height. `Channel` is one."""

    def per(self, distance_m: Floats, height_m: Floats) -> ArrayLike:
        """Packet error rates, (n,), each in [0, 1].

        `distance_m` (n,), 0 or more: horizontal, in metres, from the device to the aircraft.
        `height_m` (n,): of the aircraft above home, in metres; 0 or less on the ground. Where a
        device sent nothing, both are anything, and its rate is not looked at. The answer may
        depend on the arguments alone, so that a run can be resumed.
        """


class CustomRadio(PlugIn):
    """A researcher's own radio, whose rates are checked."""

    setting = "channel.gate"
    members = ("per",)

    def per(self, distance_m: Floats, height_m: Floats) -> Floats:
        """As `Radio.per`."""
        rates = self.ask("per", distance_m, height_m)
        return self.array(rates, "what per() gives", shape=np.shape(distance_m), low=0, high=1)


def make_radio(gate: str, channel: Channel) -> Channel | CustomRadio:
    """The channel itself, or what the factory that `gate` names makes of it.

    Raises:
        PluginError: it cannot be imported, or what it makes is no radio.
    """
    return channel if gate in GATES else CustomRadio.made(gate, channel)


@dataclass(frozen=True)
class Arrivals:
    """Packet error rates of one round's updates, and which of them arrived."""

    per: NDArray[np.float64]  # (K,) average PER where it was sent; 1 where nothing was sent
    delivered: NDArray[np.bool_]  # (K,)


def deliver(
    channel: Channel,
    horizontal_m: NDArray[np.float64],
    *,
    height_m: NDArray[np.float64],
    transmitted: NDArray[np.bool_],
    rng: np.random.Generator,
    radio: Channel | CustomRadio | None = None,
    gate: Gate = "average",
) -> Arrivals:
    """Draw one packet of each transmitting device.

    `horizontal_m` and `height_m` (K,) say how far the aircraft truly is at the instant of each
    transmission (anything where nothing is transmitted). `rng` is this round's own stream.

    "average" loses a packet with the probability that `radio` (by default the channel) gives.
    "instantaneous" draws the channel's segment and shadowing and loses the packet whose SNR is
    under the threshold; its mean is that of the channel.
    """
    count = transmitted.size
    r = np.where(transmitted, horizontal_m, 0.0)
    h = np.where(transmitted, height_m, channel.altitude_m)
    per = np.where(transmitted, (radio or channel).per(r, h), 1.0)
    luck = rng.random(count)
    if gate == "average":
        delivered = transmitted & (luck >= per)
    else:
        mu_los, mu_nlos = log_mean_snr(channel, r, height_m=h)
        los = luck < los_probability(channel, r, height_m=h)
        shadow = rng.standard_normal(count) * np.where(los, channel.sigma_los, channel.sigma_nlos)
        log_snr = np.where(los, mu_los, mu_nlos) + shadow
        threshold = np.log(channel.snr_threshold)
        delivered = transmitted & (log_snr >= threshold)
    return Arrivals(per=frozen(per), delivered=frozen(delivered))
