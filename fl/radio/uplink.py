"""Who gets through: packets drawn against the packet error rate where they were sent.

Every device has its own draws in a round whether it transmits or not, so that what happens to
one device depends on no other, and two strategies with one seed meet the same luck.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fl.arrays import frozen
from fl.radio.channel import Channel, log_mean_snr, los_probability
from fl.radio.custom_radio import CustomRadio

Gate = Literal["average", "instantaneous"]


@dataclass(frozen=True)
class Arrivals:
    """What became of the updates of one round."""

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
