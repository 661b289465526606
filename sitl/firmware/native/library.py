"""The C interface of the bridges (`bridge.h`), and the structures that both languages share.

The loop over ticks is in C. It releases Python's lock while it waits for the firmware, and takes it
to step the aircraft.
"""

import ctypes

import numpy as np
from numpy.typing import NDArray

from flightdyn.native.ticks import DRIVE_AT, PYTHON_AT, READ_AT, Driven, Imu, of_python
from flightdyn.plant import Plant
from native.building import library
from native.loading import address, check_sizes, load

_INT, _LONG, _UNSIGNED, _DOUBLE = ctypes.c_int, ctypes.c_int64, ctypes.c_uint64, ctypes.c_double
_POINTER, _BYTES = ctypes.c_void_p, ctypes.c_char_p
_THREE, _FOUR, _SIX = _DOUBLE * 3, _DOUBLE * 4, _DOUBLE * 6

KEPT = 4096  # guidance intervals, 80 s
TRUTHS, MOTORS = 15, 4  # numbers of an instant: what `Multirotor.all` reads, and what is ordered
# What came of a call. ORDERED: the motors are what the firmware wants for the next tick; GONE: it
# has hung up; FREE_RUNNING: its clock is not ours; RESTARTED: it has begun anew.
NOTHING, ORDERED, GONE, FREE_RUNNING, RESTARTED, _FAILED = range(6)


class _Ring(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_void_p) for name in ("rows", "instants")) + tuple(
        (name, ctypes.c_int64) for name in ("count", "interval_ns", "newest")
    )


class TruthRing:
    """A ring buffer: a row of numbers for each guidance interval of a plant, the newest `KEPT`."""

    def __init__(self, plant: Plant) -> None:
        """Its first row is the present state of the plant."""
        self._count, interval_ns = KEPT, plant.interval * plant.dt_ns
        shape = (KEPT, TRUTHS + MOTORS)
        self._rows, self._instants = np.zeros(shape), np.zeros(KEPT, dtype=np.int64)
        first = plant.t_ns // interval_ns
        self._memory = _Ring(
            address(self._rows, np.float64, shape, written=True),
            address(self._instants, np.int64, (KEPT,), written=True),
            KEPT,
            interval_ns,
            first,
        )
        self.address = ctypes.addressof(self._memory)
        self._rows[first % KEPT, :TRUTHS] = plant.vehicle.all.read()
        self._instants[first % KEPT] = plant.t_ns

    @property
    def newest(self) -> int:
        """The number of the newest interval."""
        number: int = self._memory.newest
        return number

    def row_of(self, interval: int) -> tuple[int, NDArray[np.float64]]:
        """The instant (ns) and the numbers at the end of an interval."""
        slot = interval % self._count
        return int(self._instants[slot]), self._rows[slot].copy()


class _World(ctypes.Structure):
    _fields_ = (
        *((name, _POINTER) for name in ("drive", "read_gauges", "let_go", "take")),
        *((name, _POINTER) for name in ("driven", "interpreter", "gauges", "ring")),
        *(("t_ns", _LONG), ("dt_ns", _LONG)),
    )


class _HilSensor(ctypes.Structure):
    _fields_ = (
        *(("t_us", _UNSIGNED), ("sample", _SIX), ("field_gauss", _THREE)),
        *((name, _DOUBLE) for name in ("pressure_hpa", "height_m", "temperature_c")),
        ("fields", _UNSIGNED),
    )


class Hil(ctypes.Structure):
    """C structure of a TCP connection to PX4; `sensor` holds the next HIL_SENSOR."""

    _fields_ = (
        *(("world", _World), ("sensor", _HilSensor), ("motors", _FOUR)),
        *((name, _UNSIGNED) for name in ("sent_us", "answered_us")),
        *((name, _LONG) for name in ("socket", "error", "sequence", "came", "size", "left")),
        *(("stream", ctypes.c_uint8 * 4096), ("out", ctypes.c_uint8 * 560)),
    )


class Json(ctypes.Structure):
    """C structure of a UDP socket to ArduPilot; `errors` are those of position and velocity."""

    _fields_ = (
        *(("world", _World), ("sample", _SIX), ("state", _DOUBLE * 9), ("errors", _SIX)),
        ("motors", _FOUR),
        *((name, _LONG) for name in ("count", "answered", "asked", "came")),
        *((name, _LONG) for name in ("socket", "peer", "length", "magic", "size")),
        ("reply", ctypes.c_uint8 * 1024),
    )


_LIBRARY = load(library("bridge"))
check_sizes(_LIBRARY, Hil=Hil, Json=Json, Ring=_Ring)
# Each takes the address of its structure; `hil_send` a payload of HIL_GPS, too, or None.
hil_wait = ctypes.CFUNCTYPE(_INT, _POINTER, _INT)(("hil_wait", _LIBRARY))
hil_send = ctypes.CFUNCTYPE(_INT, _POINTER, _BYTES)(("hil_send", _LIBRARY))
json_wait = ctypes.CFUNCTYPE(_INT, _POINTER)(("json_wait", _LIBRARY))
json_send = ctypes.CFUNCTYPE(None, _POINTER)(("json_send", _LIBRARY))
# These step the aircraft and keep Python's lock, but while they wait.
_hil_tick = ctypes.PYFUNCTYPE(_INT, _POINTER)(("hil_tick", _LIBRARY))
_hil_run = ctypes.PYFUNCTYPE(_INT, _POINTER, _LONG)(("hil_run", _LIBRARY))
_json_run = ctypes.PYFUNCTYPE(_INT, _POINTER, _LONG)(("json_run", _LIBRARY))


class Stepped:
    """Steps a plant from C, by the orders in a firmware's structure, and keeps true states."""

    def __init__(self, plant: Plant, imu: Imu, link: Hil | Json) -> None:
        """Fill in `link` for C; the motors stand still until there is an order."""
        self._plant, self._link = plant, link
        vehicle, self.truths = plant.vehicle, TruthRing(plant)
        vehicle.drive((0.0,) * 4)
        self._driven = Driven(imu, vehicle.set_motors, plant.run)
        lock = of_python("PyEval_SaveThread", "PyEval_RestoreThread")
        places = self._driven.at, PYTHON_AT, vehicle.all.at, self.truths.address
        link.world = _World(DRIVE_AT, READ_AT, *lock, *places, plant.t_ns, plant.dt_ns)
        self.at = ctypes.addressof(link)

    def hil_run(self, ticks: int) -> int:
        """Take ticks as PX4 asks for them, and answer all but the last; return how many."""
        return self._count(_hil_run(self._ready(ticks), ticks))

    def hil_tick(self) -> int:
        """Take a tick for a PX4 that boots and does not ask yet; return 1 if taken, else 0."""
        return self._count(_hil_tick(self._ready(1)))

    def json_run(self, ticks: int) -> int:
        """Take ticks as ArduPilot asks for them, and answer all but the last; return how many."""
        return self._count(_json_run(self._ready(ticks), ticks))

    def _ready(self, ticks: int) -> int:
        self._driven.ready(self._plant.run, ticks)
        return self.at

    def _count(self, ticks: int) -> int:
        if ticks:
            self._plant.advance_clock(ticks)
        return ticks
