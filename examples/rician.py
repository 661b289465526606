"""Another radio: a line of sight with Rician fading, in place of log-normal shadowing.

The power gain of a Rician channel with factor K is a noncentral chi-square variable, so a packet
is lost with probability 1 - Q_1(sqrt(2 K), sqrt(2 (1 + K) gamma_0 / snr)), where snr is the mean
(Simon, Alouini: Digital Communication over Fading Channels, section 2.2.1.2). Plans are still made
with the configured channel: plan_per says what the planner believed, true_per what this radio did.

    aerofed run --set radio.truth=examples.rician:make
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chndtr

from aerofed import Channel

Floats, Ints = NDArray[np.float64], NDArray[np.int64]

K_DB = 10.0  # power of the line of sight over that of all reflections


@dataclass(frozen=True)
class Rician:
    """The configured channel's line-of-sight link budget, with Rician fading."""

    channel: Channel
    devices_m: Floats  # (K, 2)
    k: float

    def per(self, device: Ints, place_m: Floats) -> Floats:
        """Packet error rates of devices (n,) with the aircraft at places (n, 3)."""
        c = self.channel
        away_m = np.hypot(*(place_m[:, :2] - self.devices_m[device]).T)
        slant_m = np.maximum(np.hypot(away_m, place_m[:, 2]), 1.0)
        mean_db = c.tx_power_db + c.beta_los_db - c.noise_db - 10 * c.alpha_los * np.log10(slant_m)
        relative = c.snr_threshold / 10.0 ** (mean_db / 10.0)
        return chndtr(2.0 * (1.0 + self.k) * relative, 2.0, 2.0 * self.k)


def make(channel: Channel, devices_m: Floats) -> Rician:
    """What `radio.truth` names."""
    return Rician(channel, devices_m, 10.0 ** (K_DB / 10.0))
