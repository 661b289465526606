"""The C interface of what is done at every tick (`ticks.h`), and the memory it works on.

JSBSim is called through Python's own C interface, from C: at these rates the interpreter's way
from one such call to the next costs more than what is done in them. The calls keep Python's lock.
"""

import ctypes
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from native.building import library
from native.loading import address, check_sizes, load

AXES = 6  # of a sample: body rates (rad/s), specific force (m/s2)
_ROW = 8 * AXES  # bytes

_POINTER, _INT, _DOUBLE = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
_OBJECT, _OK = ctypes.py_object, ctypes.c_int
_THREE, _SIX = _DOUBLE * 3, _DOUBLE * AXES

Getter = Callable[[], float]
Setter = Callable[[float], object]


class _Interpreter(ctypes.Structure):
    _fields_ = tuple((name, _POINTER) for name in ("call", "value", "error", "number", "release"))


def of_python(*names: str) -> tuple[int | None, ...]:
    """Addresses of functions of Python's C interface."""
    return tuple(ctypes.cast(getattr(ctypes.pythonapi, name), _POINTER).value for name in names)


_PYTHON = _Interpreter(*of_python(
    "PyObject_Vectorcall", "PyFloat_AsDouble", "PyErr_Occurred", "PyFloat_FromDouble", "Py_DecRef"
))  # fmt: skip


class _Gauge(ctypes.Structure):
    _fields_ = (("get", _OBJECT), ("offset", _DOUBLE), ("scale", _DOUBLE))


class _Imu(ctypes.Structure):
    _fields_ = (
        ("python", _POINTER), ("gauges", _POINTER), ("errors", _POINTER), ("fault", _SIX),
        ("rates", _THREE),
    )  # fmt: skip


class _Inner(ctypes.Structure):
    _fields_ = (
        ("python", _POINTER), ("set_rates", _OBJECT * 3), ("set_errors", _OBJECT * 3),
        ("set_feeds", _OBJECT * 3), ("set_collective", _OBJECT), ("bias", _THREE),
        ("rate", _THREE), ("error", _THREE), ("feed", _THREE), ("collective", _DOUBLE),
        ("dt", _DOUBLE),
    )  # fmt: skip


class _Driven(ctypes.Structure):
    _fields_ = (
        ("imu", _POINTER), ("run", _OBJECT), ("set_motors", _OBJECT * 4), ("motors", _DOUBLE * 4),
    )  # fmt: skip


class _Ticks(ctypes.Structure):
    _fields_ = (
        ("read_gauges", ctypes.PYFUNCTYPE(_OK, _POINTER, _POINTER, _INT, _POINTER)),
        ("sample", ctypes.PYFUNCTYPE(_OK, _POINTER, _POINTER)),
        ("drive", _POINTER),  # called from C
    )


_LIBRARY = load(library("flight"))
check_sizes(
    _LIBRARY, Interpreter=_Interpreter, Gauge=_Gauge, Imu=_Imu, Inner=_Inner, Driven=_Driven,
    Ticks=_Ticks,
)  # fmt: skip
_LIBRARY.ticks.restype = ctypes.POINTER(_Ticks)
_TICKS = _LIBRARY.ticks().contents
_READ, _SAMPLE = _TICKS.read_gauges, _TICKS.sample
PYTHON_AT = ctypes.addressof(_PYTHON)
# For C: a gauge's reading, and a tick of an aircraft that another brain drives.
READ_AT = ctypes.cast(_TICKS.read_gauges, _POINTER).value
DRIVE_AT = _TICKS.drive


class Gauges:
    """JSBSim properties that are read together and converted to SI units."""

    def __init__(self, gauges: Sequence[tuple[Getter, float, float]]) -> None:
        """Each is a getter, an offset and a scale: (get() - offset) scale."""
        self.count = len(gauges)
        self._gauges = (_Gauge * self.count)(*(_Gauge(*gauge) for gauge in gauges))
        self.at = ctypes.addressof(self._gauges)
        self._values = (_DOUBLE * self.count)()

    def bind(self, getters: Sequence[Getter]) -> None:
        """Replace the getters; offsets and scales stay."""
        for gauge, get in zip(self._gauges, getters, strict=True):
            gauge.get = get

    def read(self) -> list[float]:
        """Values of the gauges at this tick."""
        _READ(PYTHON_AT, self.at, self.count, ctypes.addressof(self._values))
        return self._values[:]


class Inner:
    """JSBSim's properties for the inner loops: rates, attitude errors, feed-forward, thrust."""

    def __init__(
        self,
        rates: Sequence[Setter],
        errors: Sequence[Setter],
        feeds: Sequence[Setter],
        collective: Setter,
        *,
        dt_s: float,
    ) -> None:
        self._memory = _Inner(
            PYTHON_AT, tuple(rates), tuple(errors), tuple(feeds), collective, dt=dt_s
        )
        self.at = ctypes.addressof(self._memory)

    def correct(self, bias: Sequence[float]) -> None:
        """Set the gyroscope bias (rad/s) that is taken off the rates from now on."""
        self._memory.bias[:] = bias


class Imu:
    """The IMU: samples of its gauges with errors added."""

    def __init__(self, gauges: Gauges, draw: Callable[[], NDArray[np.float64]]) -> None:
        """`gauges` are body rates (rad/s) and specific force (m/s2); `draw` gives the errors (n, 6)
        of the next ticks.
        """
        if gauges.count != AXES:
            raise ValueError(f"an IMU has {AXES} gauges, not {gauges.count}")
        self._gauges, self._draw = gauges, draw
        self._memory = _Imu(PYTHON_AT, gauges.at)
        self.at = ctypes.addressof(self._memory)
        self._errors = np.zeros((1, AXES))
        self._end = address(self._errors, np.float64, (1, AXES))  # behind the errors left
        self._memory.errors = self._end
        self._sample = (_DOUBLE * AXES)()

    @property
    def rates(self) -> tuple[float, float, float]:
        """Body rates of the last tick (rad/s), as read."""
        p, q, r = self._memory.rates[:]
        return p, q, r

    def fail(self, fault: Sequence[float]) -> None:
        """Set constant errors (6) added to rates and specific force from now on."""
        self._memory.fault[:] = fault

    def draw(self, ticks: int) -> None:
        """Draw the errors of at least `ticks` ticks ahead."""
        left = (self._end - self._memory.errors) // _ROW
        if left >= ticks:
            return
        blocks = [self._errors[len(self._errors) - left :]] if left else []
        while left < ticks:
            blocks.append(self._draw())
            left += len(blocks[-1])
        self._errors = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
        at = address(self._errors, np.float64, (left, AXES))
        self._memory.errors, self._end = at, at + left * _ROW

    def sample(self) -> list[float]:
        """IMU sample of this tick: rates (rad/s), specific force (m/s2)."""
        self.draw(1)
        _SAMPLE(self.at, ctypes.addressof(self._sample))
        return self._sample[:]


class Driven:
    """Motors that are driven from outside, and the IMU that is read at every tick."""

    def __init__(self, imu: Imu, setters: Sequence[Setter], run: Callable[[], object]) -> None:
        """`setters` take the four motors' duty cycles, which are 0 now."""
        self._imu = imu
        self._memory = _Driven(imu.at, run, tuple(setters))
        self.at = ctypes.addressof(self._memory)

    def ready(self, run: Callable[[], object], ticks: int) -> None:
        """Prepare the loop for so many ticks, each run by `run`."""
        self._memory.run = run
        self._imu.draw(ticks)
