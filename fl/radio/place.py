"""Radio models: packet error rates of devices by the place of the aircraft; maps of path gains, and
normal fields over places, made of plane waves: the same again at a place."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from fl.arrays import Floats, Ints
from fl.native import library
from fl.plugins import PlugIn
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
        sight, shadow = wave_values(self.waves, device, place_m, correlation_m=self.correlation_m)
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


def drawn_waves(rng: np.random.Generator, count: int) -> Floats:
    """Draw waves (count, 2, 3, WAVES), two fields a device: turns a correlation distance d_cor east
    and north, phase in turns.

    A field is normal with variance 1, and its correlation over a distance d is exp(-d / d_cor). In
    the plane that is the transform of a density over wave numbers k that falls as
    (1 + (k d_cor)^2)^(-3/2), so that 1 / sqrt(1 + (k d_cor)^2) is uniform.
    """
    u = 1.0 - rng.random((count, 2, library.WAVES))  # in (0, 1]
    k = np.sqrt(1.0 / u**2 - 1.0) / (2.0 * np.pi)
    east, north = rng.standard_normal((2, *u.shape))  # of no preferred direction
    turns = k / np.sqrt(east**2 + north**2)
    return np.stack((turns * east, turns * north, rng.random(u.shape)), axis=2)


def wave_values(waves: Floats, device: Ints, place_m: Floats, *, correlation_m: float) -> Floats:
    """Both fields (2, n) of devices (n,) at places (n, 2 or 3)."""
    field = np.empty((2, len(device)))
    for at, (of, (x, y)) in enumerate(zip(device, place_m[:, :2] / correlation_m, strict=True)):
        east, north, phase = waves[of].transpose(1, 0, 2)  # (2, WAVES) each
        field[:, at] = np.cos(2.0 * np.pi * (x * east + y * north + phase)).sum(axis=1)
    return np.asarray(field * np.sqrt(2.0 / waves.shape[-1]))


@dataclass(frozen=True, eq=False)
class RadioMap:
    """`Gains` at the centres of cells, interpolated linearly in dB; beyond the edge as in the cells
    of the edge."""

    path_gain_db: Floats  # (K, H, Y, X)
    height_m: Floats  # (H,) above home, ascending, as the next two
    y_m: Floats  # (Y,) north in the area
    x_m: Floats  # (X,) east
    devices_m: Floats  # (K, 2)
    home: Mapping[str, float] = field(default_factory=dict)  # where its file says that home is

    @classmethod
    def of(
        cls,
        gains: Gains,
        devices_m: Floats,
        *,
        size_m: tuple[float, float],
        height_m: Floats,
        cell_m: float,
    ) -> Self:
        """Compute the map of `gains` over an area of `size_m` (east, north) in square cells."""
        x_m, y_m = (np.arange(0.5 * cell_m, side + 0.5 * cell_m, cell_m) for side in size_m)
        places = np.meshgrid(height_m, y_m, x_m, indexing="ij")
        place_m = np.stack([axis.ravel() for axis in reversed(places)], axis=1)
        every = [
            gains.gain_db(np.full(len(place_m), device), place_m).reshape(places[0].shape)
            for device in range(len(devices_m))
        ]
        return cls(np.array(every), height_m, y_m, x_m, devices_m)

    def gain_db(self, device: Ints, place_m: Floats) -> Floats:
        """Return path gains (n,) in dB, as `Gains.gain_db`."""
        # Imported here: few runs have a map, and SciPy takes 150 ms.
        from scipy.ndimage import map_coordinates

        axes = zip(place_m.T[::-1], (self.height_m, self.y_m, self.x_m), strict=True)
        cells = [np.interp(at, axis, np.arange(len(axis))) for at, axis in axes]
        gain_db = map_coordinates(self.path_gain_db, [device, *cells], order=1, mode="nearest")
        return np.asarray(gain_db, dtype=np.float64)
