"""A radio map: the gain from each device to a grid of places of the aircraft."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from fl.arrays import Floats, Ints
from fl.radio.place import Gains


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
        # Imported here: few runs have a map.
        from scipy.ndimage import map_coordinates

        axes = zip(place_m.T[::-1], (self.height_m, self.y_m, self.x_m), strict=True)
        cells = [np.interp(at, axis, np.arange(len(axis))) for at, axis in axes]
        found = map_coordinates(self.path_gain_db, [device, *cells], order=1, mode="nearest")
        return np.asarray(found, dtype=np.float64)
