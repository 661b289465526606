"""Buildings between devices and aircraft: line of sight by geometry, 3GPP's path loss, shadowing.

`native/city.h` has the formulas. A building is a prism with a flat roof. The path loss with and
without line of sight is that of 3GPP TR 38.901 up to a height of 22.5 m, and TR 36.777's for
aircraft above. Shadowing is a normal field over the places of the aircraft whose correlation falls
as exp(-d / d_cor), the same in every round (TR 38.901, 7.4.4), made of plane waves. A device inside
a building has the entry loss of its wall (7.4.3, low loss).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self, TypeAlias

import numpy as np

from fl.arrays import Bools, Floats, Ints
from fl.native import library

# Metres: d_cor in sight, and without (TR 38.901, table 7.5-6).
_CORRELATION_M = {"UMi": (10.0, 13.0), "UMa": (37.0, 50.0)}
Ring: TypeAlias = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Building:
    """A building: a prism on the ground with a flat roof."""

    outlines_m: tuple[Floats, ...]  # (n, 2) corners, x east, y north: around it, then of courtyards
    height_m: float  # of the roof, above home

    @classmethod
    def of(cls, polygon_m: Ring, height_m: float, holes_m: Sequence[Ring] = ()) -> Self:
        """Make a building from a configuration's corners [x, y] of its outline and courtyards."""
        return cls(tuple(map(np.array, (polygon_m, *holes_m))), height_m)


class City:
    """Path gains from devices to the aircraft among buildings. A `Gains`."""

    def __init__(
        self,
        buildings: Sequence[Building],
        devices_m: Floats,
        *,
        device_height_m: float,
        carrier_hz: float,
        environment: Literal["UMi", "UMa"],
        rng: np.random.Generator | None,
    ) -> None:
        """`devices_m` (K, 2). Shadowing is drawn from `rng`; without, there is none."""
        count, carrier_ghz = len(devices_m), carrier_hz / 1e9
        places_m = np.column_stack((devices_m, np.full(count, device_height_m)))
        self._native = library.City(
            [building.outlines_m for building in buildings],
            np.array([building.height_m for building in buildings], dtype=np.float64),
            devices=places_m,
            fields=None if rng is None else _fields(rng, count, _CORRELATION_M[environment]),
            carrier_ghz=carrier_ghz,
            macro=environment == "UMa",
        )
        self.indoors = ~self.in_sight(np.arange(count), places_m)  # (K,) of themselves
        self._entry_db = np.where(self.indoors, _entry_loss_db(carrier_ghz), 0.0)

    def gain_db(self, device: Ints, place_m: Floats) -> Floats:
        """Return path gains (n,) in dB, as `Gains.gain_db`; includes the loss into buildings."""
        return self._native.gains(device, place_m)[0] - self._entry_db[device]

    def in_sight(self, device: Ints, place_m: Floats) -> Bools:
        """(n,) whether no building stands between devices (n,) and places (n, 3)."""
        return self._native.gains(device, place_m)[1]

    def shadowing_db(self, device: Ints, place_m: Floats) -> Floats:
        """(n,) standard deviation of the shadowing on the paths from devices to places (n, 3)."""
        return self._native.gains(device, place_m)[2]


def _entry_loss_db(carrier_ghz: float) -> float:
    """Building entry loss in dB: a wall of 30 % window and 70 % concrete."""
    glass_db, concrete_db = 2.0 + 0.2 * carrier_ghz, 5.0 + 4.0 * carrier_ghz
    through = 0.3 * 10 ** (-glass_db / 10.0) + 0.7 * 10 ** (-concrete_db / 10.0)
    return 5.0 - 10.0 * math.log10(through)


def _fields(rng: np.random.Generator, count: int, lengths_m: tuple[float, float]) -> Floats:
    """Draw waves (count, 2, 3, WAVES), two fields a device: turns/m east and north, phase in turns.

    In the plane exp(-d / d_cor) is the transform of a density over wave numbers k that falls as
    (1 + (k d_cor)^2)^(-3/2), so that 1 / sqrt(1 + (k d_cor)^2) is uniform.
    """
    u = 1.0 - rng.random((count, 2, library.WAVES))  # in (0, 1]
    k = np.sqrt(1.0 / u**2 - 1.0) / np.array(lengths_m)[:, None] / (2.0 * np.pi)
    east, north = rng.standard_normal((2, *u.shape))  # of no preferred direction
    turns = k / np.sqrt(east**2 + north**2)
    return np.stack((turns * east, turns * north, rng.random(u.shape)), axis=2)
