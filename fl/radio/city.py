"""Buildings between devices and aircraft: line of sight by geometry, 3GPP's path loss, shadowing.

`native/city.h` has the formulas. A building is a prism with a flat roof. The path loss with and
without line of sight is that of 3GPP TR 38.901 up to a height of 22.5 m, and TR 36.777's for
aircraft above. Shadowing is a normal field over the places of the aircraft whose correlation falls
as exp(-d / d_cor), the same in every round (TR 38.901, 7.4.4), made of plane waves.

A device inside a building is in line of sight where the outdoor part of its path is. The way out
takes the loss of a wall, 0.5 dB for each metre within, and what the wall of this device differs
from others (7.4.3.1).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self, TypeAlias

import numpy as np

from fl.arrays import Floats, Ints
from fl.native import library
from fl.radio.place import drawn_waves

# Walls (TR 38.901, tables 7.4.3-1 and -2): share of windows, loss of their glass (and more of it
# for each GHz), and standard deviation from wall to wall, in dB. The rest is concrete.
_WALLS = {"low-loss": (0.3, 2.0, 0.2, 4.4), "high-loss": (0.7, 23.0, 0.3, 6.5)}
STREET_M = 22.5  # up to this height the aircraft is a base station, above it a terminal in the air
Ring: TypeAlias = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Building:
    """A building, or part of one: a prism with a flat floor and roof."""

    outlines_m: tuple[Floats, ...]  # (n, 2) corners, x east, y north: around it, then of courtyards
    height_m: float  # of the roof, above home
    from_m: float = 0.0  # where it begins, above home; 0: on the ground

    @classmethod
    def of(
        cls, polygon_m: Ring, height_m: float, holes_m: Sequence[Ring] = (), from_m: float = 0.0
    ) -> Self:
        """Make a building from a configuration's corners [x, y] of its outline and courtyards."""
        return cls(tuple(map(np.array, (polygon_m, *holes_m))), height_m, from_m)


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
        walls: Literal["low-loss", "high-loss"],
        rng: np.random.Generator | None,
    ) -> None:
        """`devices_m` (K, 2). Shadowing, and how walls differ, is drawn from `rng`; without, there
        is none."""
        count, carrier_ghz = len(devices_m), carrier_hz / 1e9
        places_m = np.column_stack((devices_m, np.full(count, device_height_m)))
        *wall, self._wall_db = _WALLS[walls]
        entry_db = np.full(count, _entry_loss_db(carrier_ghz, *wall))
        fields = None if rng is None else drawn_waves(rng, count)
        if rng is not None:
            entry_db += self._wall_db * rng.standard_normal(count)
        floors_m = [building.from_m or -math.inf for building in buildings]
        roofs_m = [building.height_m for building in buildings]
        self._native = library.City(
            [building.outlines_m for building in buildings],
            np.array([floors_m, roofs_m], dtype=np.float64),
            devices=places_m,
            entries=entry_db,
            fields=fields,
            carrier_ghz=carrier_ghz,
            macro=environment == "UMa",
        )
        self.indoors = self._native.gains(np.arange(count), places_m).indoors  # (K,)

    def gain_db(self, device: Ints, place_m: Floats) -> Floats:
        """Return path gains (n,) in dB, as `Gains.gain_db`; includes the way out of buildings."""
        return self._native.gains(device, place_m).gain_db

    def unknown_db(self, device: Ints, place_m: Floats) -> Floats:
        """(n,) standard deviation of shadowing and walls on paths from devices to places (n, 3)."""
        paths = self._native.gains(device, place_m)
        return np.hypot(paths.shadowing_db, np.where(paths.indoors, self._wall_db, 0.0))


def _entry_loss_db(carrier_ghz: float, windows: float, glass_db: float, per_ghz: float) -> float:
    """The mean loss of a wall in dB."""
    glass_db, concrete_db = glass_db + per_ghz * carrier_ghz, 5.0 + 4.0 * carrier_ghz
    through = windows * 10 ** (-glass_db / 10.0) + (1.0 - windows) * 10 ** (-concrete_db / 10.0)
    return 5.0 - 10.0 * math.log10(through)
