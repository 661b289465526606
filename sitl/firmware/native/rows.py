"""Where C keeps the truth (`keep` in `bridge.c`)."""

import ctypes

import numpy as np

from flightdyn.plant import Plant
from native.loading import address

KEPT = 4096  # guidance intervals, 80 s
NUMBERS = 15  # of an instant, as `Multirotor.all` reads them


class Past(ctypes.Structure):
    """As `bridge.h` has it."""

    _fields_ = tuple((name, ctypes.c_void_p) for name in ("rows", "instants")) + tuple(
        (name, ctypes.c_int64) for name in ("count", "interval_ns", "newest")
    )


class Rows:
    """A row of numbers for each guidance interval of a plant, the newest `KEPT` of them."""

    def __init__(self, plant: Plant) -> None:
        """Begins with the row of this instant."""
        self._count, interval_ns = KEPT, plant.interval * plant.dt_ns
        shape = (KEPT, NUMBERS)
        self._rows, self._instants = np.zeros(shape), np.zeros(KEPT, dtype=np.int64)
        first = plant.t_ns // interval_ns
        self._memory = Past(
            address(self._rows, np.float64, shape, written=True),
            address(self._instants, np.int64, (KEPT,), written=True),
            KEPT,
            interval_ns,
            first,
        )
        self.address = ctypes.addressof(self._memory)
        self._rows[first % KEPT] = plant.vehicle.all.read()
        self._instants[first % KEPT] = plant.t_ns

    @property
    def newest(self) -> int:
        """The number of the newest interval."""
        number: int = self._memory.newest
        return number

    def of(self, interval: int) -> tuple[int, list[float]]:
        """The instant (ns) and the numbers at the end of an interval."""
        slot = interval % self._count
        return int(self._instants[slot]), self._rows[slot].tolist()
