"""Radio models: packet error rates of devices by the place of the aircraft."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fl.arrays import Floats, Ints
from fl.native import library
from fl.plugins import PlugIn
from fl.radio import waves
from fl.radio.channel import Channel, average_per, log_mean_snr, los_probability

THERMAL_NOISE_DBM_HZ = -174.0  # at 290 K


class Radio(Protocol):
    """Packet error rates of devices at places: what is true, or what a plan believes."""

    def per(self, device: Ints, place_m: Floats) -> ArrayLike:
        """Packet error rates, (n,), each in [0, 1].

        `device` (n,): whose packet, by its number from 0. `place_m` (n, 3): where the aircraft is
        as it is sent, in area coordinates: x east, y north, height above home (0 or less on the
        ground). The answer may depend on the arguments alone, so that a run can be resumed.
        """


@dataclass(frozen=True)
class AverageRadio:
    """A `Radio` with the channel's average PER, a function of distance and height only."""

    channel: Channel
    devices_m: Floats  # (K, 2)

    def distance_m(self, device: Ints, place_m: Floats) -> Floats:
        """Return horizontal distances (n,) from devices (n,) to places (n, 2) or (n, 3)."""
        away = place_m[:, :2] - self.devices_m[device]
        return np.asarray(np.hypot(away[:, 0], away[:, 1]))

    def per(self, device: Ints, place_m: Floats) -> Floats:
        """Return average packet error rates (n,), as `Radio.per`."""
        height_m = place_m[:, 2]
        return average_per(self.channel, self.distance_m(device, place_m), height_m=height_m)


@dataclass(frozen=True)
class SettledRadio:
    """A `Radio` of a channel whose line of sight and shadowing are drawn once.

    All packets of a device arrive at a place, or none: a second try meets what the first one met.
    """

    average: AverageRadio
    waves: Floats  # (K, 2, 3, WAVES) of line of sight and shadowing
    correlation_m: float

    def per(self, device: Ints, place_m: Floats) -> Floats:
        """Packet error rates (n,), 0 or 1; their mean over the draws is the average PER."""
        channel, height_m = self.average.channel, place_m[:, 2]
        far_m = self.average.distance_m(device, place_m)
        sight, shadow = waves.values(self.waves, device, place_m, correlation_m=self.correlation_m)
        seen = library.normal_shares(sight) < los_probability(channel, far_m, height_m=height_m)
        los, nlos = log_mean_snr(channel, far_m, height_m=height_m)
        log_snr = np.where(
            seen, los + channel.sigma_los * shadow, nlos + channel.sigma_nlos * shadow
        )
        return np.asarray(log_snr < math.log(channel.snr_threshold), dtype=np.float64)


class CustomRadio(PlugIn):
    """A plug-in `Radio` whose rates are checked."""

    setting = "radio.truth"
    members = ("per",)

    def per(self, device: Ints, place_m: Floats) -> Floats:
        """Return packet error rates (n,), as `Radio.per`, checked to be in [0, 1]."""
        rates = self.ask("per", device, place_m)
        return self.array(rates, "what per() gives", shape=device.shape, low=0, high=1)


class Gains(Protocol):
    """Path gains from devices to places of the aircraft."""

    def gain_db(self, device: Ints, place_m: Floats) -> Floats:
        """(n,) gain of the path from devices (n,) to places (n, 3), in dB, below 0."""


@dataclass(frozen=True)
class LinkTerms:
    """Terms of a link budget beside the path gain: power, noise, SNR threshold, fading."""

    tx_power_dbm: float
    bandwidth_hz: float
    noise_figure_db: float
    snr_threshold_db: float  # under it a packet is lost
    fading_db: float  # standard deviation of what no map knows

    @property
    def noise_dbm(self) -> float:
        """Power of the receiver's noise."""
        width_db = 10.0 * math.log10(self.bandwidth_hz)
        return THERMAL_NOISE_DBM_HZ + width_db + self.noise_figure_db


@dataclass(frozen=True)
class PlacedRadio:
    """A `Radio` of path gains by place, with normal fading in dB."""

    gains: Gains
    terms: LinkTerms
    # Devices (n,) and places (n, 3) to the standard deviation (n,) in dB of what the gains leave
    # out and the fading does not have; None: nothing is left out.
    unknown_db: Callable[[Ints, Floats], Floats] | None = None

    def snr_db(self, device: Ints, place_m: Floats) -> Floats:
        """Return the median signal-to-noise ratio over the fading in dB, (n,)."""
        sent = self.terms.tx_power_dbm - self.terms.noise_dbm
        return sent + self.gains.gain_db(device, place_m)

    def per(self, device: Ints, place_m: Floats) -> Floats:
        """As `Radio.per`: the probability that fading takes the SNR under the threshold."""
        lacking = self.terms.snr_threshold_db - self.snr_db(device, place_m)
        if self.unknown_db is None:
            return library.normal_shares(lacking / self.terms.fading_db)
        spread_db = np.hypot(self.terms.fading_db, self.unknown_db(device, place_m))
        return library.normal_shares(lacking / spread_db)
