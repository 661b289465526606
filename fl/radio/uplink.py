"""The uplink: packets drawn against the packet error rate where they were sent.

Every device has its own draws in a round whether it transmits or not, so that what happens to
one device depends on no other, and two strategies with one seed meet the same luck.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fl.arrays import Bools, Floats, frozen
from fl.radio.channel import log_mean_snr, los_probability
from fl.radio.place import AverageRadio, Radio

Gate = Literal["average", "instantaneous"]


@dataclass(frozen=True)
class Arrivals:
    """Packet error rates of one round's updates, and which of them arrived."""

    per: NDArray[np.float64]  # (K,) average PER where it was sent; 1 where nothing was sent
    delivered: NDArray[np.bool_]  # (K,)


def deliver(
    radio: Radio,
    place_m: Floats,
    *,
    transmitted: Bools,
    rng: np.random.Generator,
    gate: Gate = "average",
) -> Arrivals:
    """Draw one packet of each transmitting device.

    `place_m` (K, 3) says where the aircraft truly is at the instant of each transmission, in area
    coordinates and height above home (anything where nothing is transmitted). `rng` is this
    round's own stream.

    "average" loses a packet with the probability that `radio` gives. "instantaneous", of an
    `AverageRadio` only, draws the channel's segment and shadowing and loses the packet whose SNR is
    under the threshold; its mean is that of the channel.
    """
    count = transmitted.size
    sent = np.flatnonzero(transmitted)
    per = np.ones(count)
    per[sent] = radio.per(sent, place_m[sent])
    luck = rng.random(count)
    if gate == "average":
        delivered = transmitted & (luck >= per)
    else:
        assert isinstance(radio, AverageRadio)
        channel = radio.channel
        known_m = np.where(transmitted[:, None], place_m, 0.0)
        r, h = radio.distance_m(np.arange(count), known_m), known_m[:, 2]
        mu_los, mu_nlos = log_mean_snr(channel, r, height_m=h)
        los = luck < los_probability(channel, r, height_m=h)
        shadow = rng.standard_normal(count) * np.where(los, channel.sigma_los, channel.sigma_nlos)
        log_snr = np.where(los, mu_los, mu_nlos) + shadow
        threshold = np.log(channel.snr_threshold)
        delivered = transmitted & (log_snr >= threshold)
    return Arrivals(per=frozen(per), delivered=frozen(delivered))
