"""The C interface of what is done at every tick (`ticks.h`), and the memory it works on.

JSBSim is called through Python's own C interface, from C: at these rates the interpreter's way
from one such call to the next costs more than what is done in them. The calls keep Python's lock.
"""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from native.building import library
from native.loading import address, interface

FLIGHT = interface(library("flight"), keeps_lock=True)
AXES: int = FLIGHT.AXES  # of a sample: body rates (rad/s), specific force (m/s2)
_ROW = 8 * AXES  # bytes

Getter = Callable[[], float]
Setter = Callable[[float], object]


def addresses(*functions: Any) -> tuple[int | None, ...]:
    """Addresses of functions, for C."""
    return tuple(ctypes.cast(function, ctypes.c_void_p).value for function in functions)


_API = ctypes.pythonapi
_CALL, _VALUE, _ERROR, _NUMBER, _RELEASE = addresses(
    _API.PyObject_Vectorcall, _API.PyFloat_AsDouble, _API.PyErr_Occurred, _API.PyFloat_FromDouble,
    _API.Py_DecRef,
)  # fmt: skip
_PYTHON = FLIGHT.Interpreter(
    call=_CALL, value=_VALUE, error=_ERROR, number=_NUMBER, release=_RELEASE
)
PYTHON_AT = ctypes.addressof(_PYTHON)


class Gauges:
    """JSBSim properties that are read together and converted to SI units."""

    def __init__(self, gauges: Sequence[tuple[Getter, float, float]]) -> None:
        """Each is a getter, an offset and a scale: (get() - offset) scale."""
        self.count = len(gauges)
        each = (FLIGHT.Gauge(get=get, offset=by, scale=scale) for get, by, scale in gauges)
        self._gauges = (FLIGHT.Gauge * self.count)(*each)
        self.at = ctypes.addressof(self._gauges)
        self._values = np.zeros(self.count)
        self._out = address(self._values, np.float64, (self.count,), written=True)

    def bind(self, getters: Sequence[Getter]) -> None:
        """Replace the getters; offsets and scales stay."""
        for gauge, get in zip(self._gauges, getters, strict=True):
            gauge.get = get

    def read(self) -> list[float]:
        """Values of the gauges at this tick."""
        FLIGHT.read_gauges(PYTHON_AT, self.at, self.count, self._out)
        values: list[float] = self._values.tolist()
        return values


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
        self._memory = FLIGHT.Inner(
            python=PYTHON_AT, set_rates=tuple(rates), set_errors=tuple(errors),
            set_feeds=tuple(feeds), set_collective=collective, dt=dt_s,
        )  # fmt: skip
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
        self._memory = FLIGHT.Imu(python=PYTHON_AT, gauges=gauges.at)
        self.at = ctypes.addressof(self._memory)
        self._errors = np.zeros((1, AXES))
        self._end = address(self._errors, np.float64, (1, AXES))  # behind the errors left
        self._memory.errors = self._end
        self._sample = (ctypes.c_double * AXES)()

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
        FLIGHT.sample(self.at, ctypes.addressof(self._sample))
        return self._sample[:]


class Driven:
    """Motors that are driven from outside, and the IMU that is read at every tick."""

    def __init__(self, imu: Imu, setters: Sequence[Setter], run: Callable[[], object]) -> None:
        """`setters` take the four motors' duty cycles, which are 0 now."""
        self._imu = imu
        self._memory = FLIGHT.Driven(imu=imu.at, run=run, set_motors=tuple(setters))
        self.at = ctypes.addressof(self._memory)

    def ready(self, run: Callable[[], object], ticks: int) -> None:
        """Prepare the loop for so many ticks, each run by `run`."""
        self._memory.run = run
        self._imu.draw(ticks)
