"""The air-to-ground channel: line of sight, average packet error rate, its logistic approximation.

A packet of device k sent while the aircraft is at horizontal distance r and height H meets,
with probability rho, a line-of-sight segment and otherwise a non-line-of-sight one. The gain
of segment s is beta_s d^(-alpha_s) xi_s with xi_s log-normal(0, sigma_s^2); the packet is lost
when the SNR stays under a threshold.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, Field, create_model
from pydantic.fields import FieldInfo

from fl.arrays import Floats
from fl.native import library
from native.errors import SettingError

NEPERS_PER_DB = math.log(10.0) / 10.0
# The path-loss law is a far-field law; nearer than this it would promise more power than sent.
REFERENCE_DISTANCE_M = 1.0


def _shadowing(segment: str) -> object:
    words = f"standard deviation of the natural log of the {segment} shadowing"
    return Field(gt=0.0, le=10.0, description=words)


@dataclass(frozen=True)
class Channel:
    """Constants of one channel; the settings and the files of planning problems are made of them.

    dB values are powers; sigma is of the natural logarithm.
    """

    altitude_m: Annotated[float, Field(gt=0.0, le=1e7, description="H, which the plan assumes")]
    alpha_los: Annotated[float, Field(gt=0.0, le=10.0, description="path-loss exponent, LoS")]
    alpha_nlos: Annotated[float, Field(gt=0.0, le=10.0, description="path-loss exponent, NLoS")]
    beta_los_db: Annotated[float, Field(ge=-200.0, le=50.0, description="LoS gain at 1 m")]
    beta_nlos_db: Annotated[float, Field(ge=-200.0, le=50.0, description="NLoS gain at 1 m")]
    sigma_los: Annotated[float, _shadowing("LoS")]  # standard deviation of ln(xi)
    sigma_nlos: Annotated[float, _shadowing("NLoS")]
    # rho = 1 / (1 + exp(-a1 theta + a2)), theta in radians
    a1_per_rad: Annotated[
        float,
        Field(gt=0.0, le=1000.0, description="slope of the LoS probability over the elevation"),
    ]
    a2: Annotated[float, Field(ge=-100.0, le=100.0, description="offset of the LoS probability")]
    tx_power_db: Annotated[float, Field(ge=-200.0, le=100.0, description="transmit power P")]
    noise_db: Annotated[
        float, Field(ge=-300.0, le=100.0, description="noise power N0, in the unit of P")
    ]
    snr_threshold: Annotated[
        float,
        Field(gt=0.0, le=1e6, description="SNR under which a packet is lost, linear (10 = 10 dB)"),
    ]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value):
                raise SettingError(field.name, value, "must be a finite number")
        for name in ("altitude_m", "sigma_los", "sigma_nlos", "snr_threshold"):
            if getattr(self, name) <= 0.0:
                raise SettingError(name, getattr(self, name), "must be above 0")

    @cached_property
    def constants(self) -> Floats:
        """Constants (9,) of the average PER, in the order of `native/include/channel.h`."""
        lacking = math.log(self.snr_threshold)
        lacking -= (self.tx_power_db - self.noise_db) * NEPERS_PER_DB
        los, nlos = (
            (lacking - beta_db * NEPERS_PER_DB, alpha, sigma)
            for beta_db, alpha, sigma in (
                (self.beta_los_db, self.alpha_los, self.sigma_los),
                (self.beta_nlos_db, self.alpha_nlos, self.sigma_nlos),
            )
        )
        return np.array([self.a1_per_rad, self.a2, REFERENCE_DISTANCE_M, *los, *nlos])

    def per(self, distance_m: ArrayLike, height_m: ArrayLike | None = None) -> Floats:
        """Average packet error rate in [0, 1] over horizontal distances, as `average_per`.

        Raises:
            ValueError: a distance is negative or NaN.
        """
        distances = np.asarray(distance_m, dtype=np.float64)
        if not np.all(distances >= 0.0):
            wrong = distances[~(distances >= 0.0)].flat[0]
            raise ValueError(f"distance_m holds {wrong}: must be 0 or more, in metres")
        return average_per(self, distances, height_m=height_m)


def constants_model(name: str, base: type[BaseModel], *, optional: bool) -> Any:
    """Make a pydantic model of the constants of a `Channel`, with limits, beside `base`'s fields.

    `optional`: all but the altitude, None by default.
    """
    made: dict[str, Any] = {}
    for constant, hint in get_type_hints(Channel, include_extras=True).items():
        _, told = get_args(hint)
        assert isinstance(told, FieldInfo)
        if not optional:
            made[constant] = (hint, ...)
        elif constant != "altitude_m":
            made[constant] = (hint | None, Field(None, description=told.description))
    return create_model(name, __base__=base, **made)


@dataclass(frozen=True)
class LogisticFit:
    """Logistic approximation of a channel's average PER: 1 / (1 + exp(b1 theta + b2))."""

    b1_per_rad: float
    b2: float
    worst_error: float  # largest |q_tilde - q_bar| over the fitted distances


@dataclass(frozen=True)
class LinkBudget:
    """Link budget of a channel straight overhead: SNR, line-of-sight probability and PER."""

    snr_los_db: float  # median SNR over the line of sight
    snr_nlos_db: float
    threshold_db: float
    los_probability: float
    per: float

    def __str__(self) -> str:
        return (
            f"overhead: SNR {self.snr_los_db:.1f} dB in line of sight, {self.snr_nlos_db:.1f} dB"
            f" without, threshold {self.threshold_db:.1f} dB, LoS probability"
            f" {self.los_probability:.3f}, PER {self.per:.4f}"
        )


def elevation_rad(
    channel: Channel, horizontal_m: ArrayLike, *, height_m: ArrayLike | None = None
) -> Floats:
    """theta = arctan(H / r) in [0, pi/2]; straight overhead is pi/2, on the ground 0."""
    height = channel.altitude_m if height_m is None else height_m
    return np.arctan2(
        np.maximum(np.asarray(height, dtype=np.float64), 0.0),
        np.abs(np.asarray(horizontal_m, dtype=np.float64)),
    )


def los_probability(
    channel: Channel, horizontal_m: ArrayLike, *, height_m: ArrayLike | None = None
) -> Floats:
    """rho = 1 / (1 + exp(-a1 theta + a2)), the form of Al-Hourani et al. 2014.

    `horizontal_m` and `height_m` (the channel's altitude by default) broadcast.
    """
    theta = elevation_rad(channel, horizontal_m, height_m=height_m)
    return np.asarray(_logistic(channel.a1_per_rad * theta - channel.a2), dtype=np.float64)


def log_mean_snr(
    channel: Channel, horizontal_m: ArrayLike, *, height_m: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """mu_s = ln(P beta_s / (N0 d^alpha_s)) for the two segments (LoS, NLoS).

    Distances under 1 m count as 1 m, where the path-loss law ends.
    """
    height = channel.altitude_m if height_m is None else height_m
    distance = np.hypot(
        np.asarray(horizontal_m, dtype=np.float64), np.asarray(height, dtype=np.float64)
    )
    log_d = np.log(np.maximum(distance, REFERENCE_DISTANCE_M))
    budget_db = channel.tx_power_db - channel.noise_db
    los = (budget_db + channel.beta_los_db) * NEPERS_PER_DB - channel.alpha_los * log_d
    nlos = (budget_db + channel.beta_nlos_db) * NEPERS_PER_DB - channel.alpha_nlos * log_d
    return los, nlos


def average_per(
    channel: Channel, horizontal_m: ArrayLike, *, height_m: ArrayLike | None = None
) -> Floats:
    """Average packet error rate q_bar = rho Phi_LoS + (1 - rho) Phi_NLoS, in [0, 1].

    Phi_s = 1/2 [1 + erf((ln gamma_0 - mu_s) / (sigma_s sqrt 2))]. `horizontal_m` and
    `height_m` (the channel's altitude by default), in metres, broadcast.
    """
    height = channel.altitude_m if height_m is None else height_m
    distances, heights = np.broadcast_arrays(horizontal_m, height)
    far = np.array(distances, dtype=np.float64, order="C")
    high = np.array(heights, dtype=np.float64, order="C")
    return library.average_per(
        channel.constants, np.abs(far, out=far), np.maximum(high, 0.0, out=high)
    )


def link_budget(channel: Channel) -> LinkBudget:
    """Return the link budget of a channel straight overhead, at its altitude."""
    mu_los, mu_nlos = log_mean_snr(channel, 0.0)
    return LinkBudget(
        snr_los_db=float(mu_los) / NEPERS_PER_DB,
        snr_nlos_db=float(mu_nlos) / NEPERS_PER_DB,
        threshold_db=math.log(channel.snr_threshold) / NEPERS_PER_DB,
        los_probability=float(los_probability(channel, 0.0)),
        per=float(average_per(channel, 0.0)),
    )


def fit_logistic(channel: Channel) -> LogisticFit:
    """Regress q_tilde on q_bar at distances uniform in [0, 800 sqrt 2] m, in least squares.

    The start is the straight line through logit(q_bar), so that the fit needs no tuning. Where
    q_bar is the same everywhere (a channel that loses or delivers everything) the slope is 0 up
    to rounding, and b2 says how surely.
    """
    horizontal = np.linspace(0.0, 800.0 * math.sqrt(2.0), 1024)
    theta = elevation_rad(channel, horizontal)
    target = average_per(channel, horizontal)
    # 1e-6: beyond it the logit weighs tails that the least squares do not see.
    slope, offset = np.polyfit(theta, _logit(np.clip(target, 1e-6, 1.0 - 1e-6)), 1)

    def residual(b: Floats) -> Floats:
        return np.asarray(_logistic(-(b[0] * theta + b[1])) - target, dtype=np.float64)

    def jacobian(b: Floats) -> Floats:
        q = _logistic(-(b[0] * theta + b[1]))
        dq = -q * (1.0 - q)
        return np.stack([dq * theta, dq], axis=1)

    start = np.array([np.clip(-slope, 0.0, 500.0), np.clip(-offset, -100.0, 100.0)])
    # Imported here: every configuration imports this module, and few runs fit anything (270 ms).
    from scipy.optimize import least_squares

    best = least_squares(
        residual, start, jac=jacobian, bounds=([0.0, -100.0], [500.0, 100.0]), x_scale=(10.0, 5.0)
    )
    return LogisticFit(
        b1_per_rad=float(best.x[0]),
        b2=float(best.x[1]),
        worst_error=float(np.abs(residual(best.x)).max()),
    )


def smooth_per(fit: LogisticFit, channel: Channel, horizontal_m: ArrayLike) -> Floats:
    """Logistic PER q_tilde = 1 / (1 + exp(b1 theta + b2)) at the channel's altitude."""
    theta = elevation_rad(channel, horizontal_m)
    return np.asarray(_logistic(-(fit.b1_per_rad * theta + fit.b2)), dtype=np.float64)


def _logistic(x: Floats) -> Floats:
    """1 / (1 + exp(-x)), without overflow."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)), dtype=np.float64)


def _logit(p: Floats) -> Floats:
    """The inverse of `_logistic`: ln(p / (1 - p))."""
    return np.asarray(np.log(p) - np.log1p(-p), dtype=np.float64)


def _al_hourani(a: float, b_per_deg: float) -> tuple[float, float]:
    """(a1 per radian, a2) from Al-Hourani's rho = 1 / (1 + a exp(-b (theta_deg - a)))."""
    return math.degrees(b_per_deg), a * b_per_deg + math.log(a)


def _preset(
    *,
    extra_db: float = 0.0,
    environment: tuple[float, float] = (4.88, 0.43),
    log_variances: tuple[float, float] | None = None,
) -> Channel:
    """The paper's link budget plus `extra_db`, shadowing variances of 2 and 5 dB^2."""
    a1, a2 = _al_hourani(*environment)
    sigma_los = math.sqrt(2.0) * NEPERS_PER_DB
    sigma_nlos = math.sqrt(5.0) * NEPERS_PER_DB
    if log_variances is not None:
        sigma_los, sigma_nlos = map(math.sqrt, log_variances)
    return Channel(
        altitude_m=60.0,
        alpha_los=2.27,
        alpha_nlos=3.64,
        beta_los_db=-30.0,
        beta_nlos_db=-40.0,
        sigma_los=sigma_los,
        sigma_nlos=sigma_nlos,
        a1_per_rad=a1,
        a2=a2,
        tx_power_db=-20.0 + extra_db,
        noise_db=-95.0,
        snr_threshold=10.0,
    )


DEFAULT_PRESET = "suburban"

# As printed, the paper's numbers lose every packet even straight overhead ("literal"), so at
# least one differs from what was used. "suburban" adds 17 dB, our choice: from the barycentre
# of an 800 m square most packets are lost, on an 800 m tour most arrive.
CHANNEL_PRESETS: Mapping[str, Channel] = {
    "suburban": _preset(extra_db=17.0),
    "suburban+10dB": _preset(extra_db=10.0),
    "suburban+15dB": _preset(extra_db=15.0),
    "suburban+20dB": _preset(extra_db=20.0),
    # P read in dBW against N0 in dBm
    "suburban+30dB": _preset(extra_db=30.0),
    "literal": _preset(),
    # "2, 5" read as variances of the natural logarithm: a harder, flatter channel
    "literal-log-variance": _preset(log_variances=(2.0, 5.0)),
    "suburban-log-variance": _preset(extra_db=17.0, log_variances=(2.0, 5.0)),
    "urban": _preset(extra_db=17.0, environment=(9.61, 0.16)),
    "dense-urban": _preset(extra_db=17.0, environment=(12.08, 0.11)),
    "high-rise": _preset(extra_db=17.0, environment=(27.23, 0.08)),
}


def served_radius_m(channel: Channel) -> float:
    """Largest horizontal distance in whole metres up to which the mean PER is at most a half."""
    r_m = np.arange(0.0, 50_000.0)
    above = np.flatnonzero(average_per(channel, r_m) > 0.5)
    return float(r_m[-1]) if not len(above) else max(0.0, float(r_m[above[0]]) - 1.0)
