"""Packet error rates as they were measured: a table over distance and height, interpolated.

The table stands in the working directory as measured_per.csv, with a header:
distance_m, height_m, per; one row for every pair of a grid.

    aerofed run --set radio.truth=examples.measured_radio:make
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from aerofed import Channel

Floats, Ints = NDArray[np.float64], NDArray[np.int64]

TABLE = Path("measured_per.csv")


@dataclass(frozen=True)
class Measured:
    """Linear between the points of the grid, constant outside it."""

    distances_m: Floats  # (D,) ascending
    heights_m: Floats  # (H,)
    rates: Floats  # (D, H)
    devices_m: Floats  # (K, 2)

    def per(self, device: Ints, place_m: Floats) -> Floats:
        """Packet error rates of devices (n,) with the aircraft at places (n, 3)."""
        table = RegularGridInterpolator((self.distances_m, self.heights_m), self.rates)
        away_m = np.hypot(*(place_m[:, :2] - self.devices_m[device]).T)
        distance = np.clip(away_m, self.distances_m[0], self.distances_m[-1])
        height = np.clip(place_m[:, 2], self.heights_m[0], self.heights_m[-1])
        return table(np.column_stack((distance, height)))


def make(channel: Channel, devices_m: Floats) -> Measured:
    """What `radio.truth` names."""
    rows = np.loadtxt(TABLE, delimiter=",", skiprows=1)
    distances, heights = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    if len(rows) != len(distances) * len(heights):
        raise ValueError(f"{TABLE}: {len(rows)} rows do not fill a grid")
    order = np.lexsort((rows[:, 1], rows[:, 0]))
    rates = rows[order, 2].reshape(len(distances), len(heights))
    return Measured(distances, heights, rates, devices_m)
