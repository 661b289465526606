"""Packet error rates on a grid of places at one height: a radio as a plan believes it."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from fl.arrays import Bools, Floats, Ints
from fl.radio.place import Radio


@dataclass(frozen=True, eq=False)
class PerGrid:
    """A `Radio` interpolated bilinearly on a grid of places; beyond the edge as at the edge, at any
    height as at the grid's."""

    success: Floats  # (K, Y, X) 1 - PER
    first_m: tuple[float, float]  # the south-western place, area coordinates
    cell_m: float

    @classmethod
    def of(
        cls,
        radio: Radio,
        devices: int,
        *,
        size_m: tuple[float, float],
        height_m: float,
        cell_m: float,
    ) -> Self:
        """Sample a radio for `devices` devices on a grid over an area of `size_m` (east, north)."""
        columns, rows = (max(2, 1 + int(np.ceil(side / cell_m))) for side in size_m)
        success = np.ones((devices, rows, columns))
        grid = cls(success, (0.0, 0.0), cell_m)
        places_m = grid.places_m(height_m)
        for device in range(devices):
            per = radio.per(np.full(len(places_m), device), places_m)
            success[device] -= np.reshape(per, (rows, columns))
        success.flags.writeable = False
        return grid

    def places_m(self, height_m: float) -> Floats:
        """(Y * X, 3) the places of the grid at a height above home, row by row."""
        north, east = np.indices(self.success.shape[1:]).reshape(2, -1)
        at_m = self.first_m + self.cell_m * np.column_stack((east, north))
        return np.column_stack((at_m, np.full(len(at_m), height_m)))

    def per(self, device: Ints, place_m: Floats) -> Floats:
        """Return packet error rates (n,), as `Radio.per`."""
        return 1.0 - self.between(self.success, device, place_m)

    def between(self, values: Floats, device: Ints, place_m: Floats) -> Floats:
        """Interpolate `values` (K, Y, X) of the grid bilinearly for devices at places, (n,)."""
        rows, columns = self.success.shape[1:]
        on = (place_m[..., :2] - self.first_m) / self.cell_m
        x, y = np.clip(on[..., 0], 0.0, columns - 1), np.clip(on[..., 1], 0.0, rows - 1)
        i, j = np.minimum(x.astype(int), columns - 2), np.minimum(y.astype(int), rows - 2)
        u, v = x - i, y - j
        low, high = (
            values[device, row, i] * (1.0 - u) + values[device, row, i + 1] * u
            for row in (j, j + 1)
        )
        return np.asarray(low * (1.0 - v) + high * v)

    def best_within(self, place_m: Floats, metres: float) -> Floats:
        """Return an upper bound (K,) of 1 - PER within `metres` of a place (2,)."""
        near = self._patches_within(place_m, metres)
        return np.asarray(self.success[:, near].max(axis=1))

    def best_places(self, place_m: Floats, metres: float) -> Floats:
        """Return the grid points (K, 2) that give the bounds of `best_within`."""
        near = np.where(self._patches_within(place_m, metres), self.success, -1.0)
        at = near.reshape(len(near), -1).argmax(axis=1)
        rows, columns = np.unravel_index(at, near.shape[1:])
        return np.asarray(np.stack((columns, rows), axis=1) * self.cell_m + self.first_m)

    def _patches_within(self, place_m: Floats, metres: float) -> Bools:
        """Mask (Y, X) of the corners of cells within `metres` of a place (2,), which is clipped to
        the grid first, as beyond its edge the radio is as at the edge."""
        rows, columns = self.success.shape[1:]
        last_m = self.cell_m * np.array((columns - 1, rows - 1))
        place_m = np.clip(place_m, self.first_m, self.first_m + last_m)
        x_m, y_m = (
            first + self.cell_m * np.arange(count) - at
            for first, count, at in zip(self.first_m, (columns, rows), place_m, strict=True)
        )
        far_m = np.hypot(x_m[None, :], y_m[:, None])
        return np.asarray(far_m <= metres + math.sqrt(2.0) * self.cell_m)

    def seen_from(self, devices: Ints, origin_m: Floats) -> "PerGrid":
        """Return the grid of some devices, in coordinates relative to an origin (2,)."""
        x, y = (np.array(self.first_m) - origin_m).tolist()
        return PerGrid(np.ascontiguousarray(self.success[devices]), (x, y), self.cell_m)
