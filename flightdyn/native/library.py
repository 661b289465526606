"""The C interface of navigation, guidance and outer loop (`flight.h`), and the memory it works on.

The calls take well under a microsecond, so they keep Python's lock.
"""

import ctypes
from array import array
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from flightdyn.native.ticks import Gauges, Imu, Inner
from native.building import library
from native.loading import address, check_sizes, functions, load

_POINTER, _INT, _DOUBLE = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
SAMPLE, INCREMENT = 6, 7  # numbers each
STATE, BIAS, EARTH, GAINED, FORCE, DOWN = 0, 10, 16, 19, 22, 25  # where they begin in `Strapdown`

STATES, ROWS, KINDS = 22, 8, 4  # of the filter
PIECE, GAINS, TRACE = 13, 16, 31  # numbers each
NOTHING, TRACK, TARGET, ATTITUDE = range(4)
FINISHED, STALLED, LIMITED, NEAR = 1, 2, 4, 8

_Triple = tuple[float, float, float]
_Quaternion = tuple[float, float, float, float]
_Floats = NDArray[np.float64]


class _Functions(ctypes.Structure):
    _fields_ = (
        ("integrate", ctypes.PYFUNCTYPE(None, _POINTER, _INT, _DOUBLE, _POINTER, _POINTER)),
        ("carry", ctypes.PYFUNCTYPE(None, _POINTER, _POINTER, _INT)),
        ("transition", ctypes.PYFUNCTYPE(None, _POINTER, _POINTER, _POINTER, _DOUBLE)),
        ("innovate", ctypes.PYFUNCTYPE(
            None, _POINTER, _POINTER, _POINTER, _POINTER, _POINTER, _POINTER)),
        ("reference", ctypes.PYFUNCTYPE(None, _POINTER, _DOUBLE, _DOUBLE, _POINTER)),
        ("guide", ctypes.PYFUNCTYPE(ctypes.c_int, _POINTER, _POINTER, _POINTER)),
        ("land", ctypes.PYFUNCTYPE(None, _POINTER, _DOUBLE)),
        ("cruise", ctypes.PYFUNCTYPE(
            _INT, _POINTER, ctypes.py_object, _INT, _POINTER, _POINTER)),
        ("compute_trajectory", ctypes.PYFUNCTYPE(
            _DOUBLE, _POINTER, _POINTER, _POINTER, ctypes.c_int)),
        ("pass_points", ctypes.PYFUNCTYPE(None, _POINTER, _POINTER, _POINTER)),
        ("power", ctypes.PYFUNCTYPE(None, _POINTER, _INT, _POINTER, _POINTER, _POINTER)),
    )  # fmt: skip


_LIBRARY = load(library("flight"))
_FUNCTIONS = functions(_LIBRARY, _Functions)
_INTEGRATE, _CARRY = _FUNCTIONS.integrate, _FUNCTIONS.carry
_TRANSITION, _INNOVATE = _FUNCTIONS.transition, _FUNCTIONS.innovate
_REFERENCE, _GUIDE, _LAND = _FUNCTIONS.reference, _FUNCTIONS.guide, _FUNCTIONS.land
_CRUISE = _FUNCTIONS.cruise
_COMPUTE, _PASS, _POWER = _FUNCTIONS.compute_trajectory, _FUNCTIONS.pass_points, _FUNCTIONS.power


_ROOM = 8  # times as many increments, so that they are seldom moved to the front


class Increments:
    """Buffer of IMU samples summed by guidance step, the oldest first, `most` at a time."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.count = 0
        self._first = 0
        self._rows = np.zeros((_ROOM * most, INCREMENT))
        self._at = address(self._rows, np.float64, (_ROOM * most, INCREMENT), written=True)
        self._size = self._rows.itemsize * INCREMENT

    def add(
        self, samples: Sequence[float], *, dt_s: float, carried: "Strapdown | None" = None
    ) -> None:
        """Sum samples, each held for `dt_s`: rates (rad/s) and specific force (m/s2), six numbers
        each, end to end; biases are left in. Integrate the sum into `carried`.

        Raises:
            ValueError: not six numbers each, or too many increments.
        """
        numbers = samples if isinstance(samples, array) else array("d", samples)
        where, count = numbers.buffer_info()
        if count % SAMPLE:
            raise ValueError(f"{count} numbers of samples, not {SAMPLE} each")
        to = self.reserve(1)
        _INTEGRATE(where, count // SAMPLE, dt_s, to, None if carried is None else carried.at)
        self.count += 1

    def reserve(self, count: int) -> int:
        """Return the address behind the last row, with room for `count` more.

        Raises:
            ValueError: they are too many.
        """
        if self.count + count > self.most:
            raise ValueError(f"{count} more than {self.count} of {self.most} increments")
        if self._first + self.count + count > len(self._rows):
            self._rows[: self.count] = self._rows[self._first : self._first + self.count]
            self._first = 0
        return self._at + (self._first + self.count) * self._size

    def drop(self, count: int) -> None:
        """Drop the `count` oldest rows."""
        self.count -= count
        self._first += count

    def rows(self, first: int, count: int) -> int:
        """Return the address of a range of rows.

        Raises:
            ValueError: there are no such.
        """
        if not 0 <= first <= first + count <= self.count:
            raise ValueError(f"increments {first} to {first + count} of {self.count}")
        return self._at + (self._first + first) * self._size


class Strapdown:
    """Strapdown integration: position, velocity (NED) and attitude, carried by increments."""

    def __init__(self, earth: Sequence[float], *, most: int) -> None:
        """`earth`: gravity (m/s2), its rate north and down (rad/s); `most` increments at a time."""
        self._most = most
        self._memory = memory = np.zeros(DOWN + most)
        self.at = address(memory, np.float64, (DOWN + most,), written=True)
        memory[EARTH:GAINED] = earth
        self._state, self._bias = memory[STATE:BIAS], memory[BIAS:EARTH]
        self._gained, self._force = memory[GAINED:FORCE], memory[FORCE:DOWN]

    def place(self, p: _Triple, v: _Triple, q: _Quaternion) -> None:
        """Set the state from which increments are integrated."""
        self._state[:] = (*p, *v, *q)

    def set_force(self, force: _Triple) -> None:
        """Set the specific force (m/s2, body) of a state that is placed, not carried."""
        self._force[:] = force

    def correct(self, gyro: _Triple, accel: _Triple) -> None:
        """Set the biases (rad/s, m/s2) that are taken off the increments from now on."""
        self._bias[:] = (*gyro, *accel)

    def carry(self, increments: Increments, first: int, count: int) -> None:
        """Integrate a range of increments into the state.

        Raises:
            ValueError: there are no such, or they are too many.
        """
        if count > self._most:
            raise ValueError(f"{count} increments at once, {self._most} at most")
        _CARRY(self.at, increments.rows(first, count), count)

    @property
    def numbers(self) -> list[float]:
        """State as ten numbers: position, velocity, attitude quaternion."""
        numbers: list[float] = self._state.tolist()
        return numbers

    @property
    def force(self) -> list[float]:
        """Mean specific force (m/s2, body) of the increment carried last, bias taken off."""
        force: list[float] = self._force.tolist()
        return force

    @property
    def gained(self) -> list[float]:
        """Velocity (m/s, NED) gained in the last `carry` by specific force, without gravity."""
        gained: list[float] = self._gained.tolist()
        return gained

    def downs(self, count: int) -> list[float]:
        """Return the position down (m) after each of the `count` increments of the last `carry`."""
        downs: list[float] = self._memory[DOWN : DOWN + count].tolist()
        return downs


class Transition:
    """Writer of the blocks of the filter's transition matrix that depend on the flight."""

    def __init__(self, matrix: _Floats) -> None:
        """`matrix` (22, 22) has to stay where it is. Raises ValueError for another shape."""
        self._matrix = matrix
        self._q, self._gained = np.zeros(4), np.zeros(3)
        self._at = (
            address(matrix, np.float64, (STATES, STATES), written=True),
            address(self._q, np.float64, (4,)),
            address(self._gained, np.float64, (3,)),
        )

    def write(self, q: _Quaternion, gained: _Triple, dt_s: float) -> None:
        """Write the blocks for `dt_s` from attitude `q` (body to NED) on, with the velocity
        `gained` (m/s, NED) by specific force."""
        self._q[:] = q
        self._gained[:] = gained
        _TRANSITION(*self._at, dt_s)


class Innovations:
    """Standard deviations and normalised squares of innovations, from their covariance."""

    def __init__(self, measurement: _Floats, noise: _Floats) -> None:
        """`measurement` (8, 22) and `noise` (8, 8) have to stay where they are.

        Raises:
            ValueError: other shapes.
        """
        self.residual = np.zeros(ROWS)  # of the measurements; to be filled in
        self._kept = measurement, noise
        self._covariance = np.zeros((STATES, STATES))
        self._std, self._nis = np.zeros(ROWS), np.zeros(KINDS)
        self._at = (
            address(self._covariance, np.float64, (STATES, STATES)),
            address(measurement, np.float64, (ROWS, STATES)),
            address(noise, np.float64, (ROWS, ROWS)),
            address(self.residual, np.float64, (ROWS,), written=True),
            address(self._std, np.float64, (ROWS,), written=True),
            address(self._nis, np.float64, (KINDS,), written=True),
        )

    def measure(self, covariance: _Floats) -> tuple[list[float], list[float]]:
        """Standard deviations (8) expected of the residual, and the normalised square of the
        residual of GNSS position, GNSS velocity, height and heading (4).

        Raises:
            ValueError: `covariance` has another shape than (22, 22).
        """
        if covariance.shape != (STATES, STATES):
            raise ValueError(f"a covariance (22, 22) is needed, not {covariance.shape}")
        self._covariance[:] = covariance
        _INNOVATE(*self._at)
        return self._std.tolist(), self._nis.tolist()


class _Trajectory(ctypes.Structure):
    _fields_ = (
        ("pieces", _POINTER), ("count", _INT), ("half", _DOUBLE), ("start", _DOUBLE),
        ("end", _DOUBLE),
    )  # fmt: skip


class Pieces:
    """Polynomial pieces of a trajectory in the layout of the C library."""

    def __init__(self, pieces: _Floats, *, half_s: float, start_s: float, end_s: float) -> None:
        """`pieces` (n, 13): beginning, position, velocity, acceleration, integral of position.

        Raises:
            ValueError: none, or another shape.
        """
        if not len(pieces):
            raise ValueError("a trajectory has at least one piece")
        self._kept = pieces
        where = address(pieces, np.float64, (len(pieces), PIECE))
        self._trajectory = _Trajectory(where, len(pieces), half_s, start_s, end_s)
        self.at = ctypes.addressof(self._trajectory)
        self._pva = np.zeros(9)
        self._out = address(self._pva, np.float64, (9,), written=True)

    def reference(self, t: float) -> list[float]:
        """Return smoothed position, velocity and acceleration at `t` seconds: nine numbers."""
        _REFERENCE(self.at, t, 0.0, self._out)  # none of them later than the others
        found: list[float] = self._pva.tolist()
        return found


_THREE = _DOUBLE * 3


class Steering(ctypes.Structure):
    """Limits of the guidance, in the layout of C; see `trajectory.h`."""

    _fields_ = tuple(
        (name, _DOUBLE)
        for name in (
            "acceleration_mps2", "vertical_acceleration_mps2", "smoothing_s", "speed_mps",
            "climb_mps", "descent_mps", "corner_cut",
        )
    )  # fmt: skip


class Air(ctypes.Structure):
    """Density, wind and power of level flight, in the layout of C; see `trajectory.h`."""

    _fields_ = (
        ("density", _DOUBLE), ("wind", _THREE), ("watts", _POINTER), ("rows", _INT),
    )  # fmt: skip

    @classmethod
    def made(cls, watts: _Floats, *, density: float, wind_mps: _Triple) -> "Air":
        """Make it of `watts` (n,), two or more, at 0, 1, 2, ... m/s, which have to outlive it."""
        rows = len(watts)
        return cls(density, _THREE(*wind_mps), address(watts, np.float64, (rows,)), rows)

    def power(self, speed_mps: _Floats, accel_mps2: _Floats) -> _Floats:
        """Watts (n,) at speeds through the air and sizes of acceleration (n,)."""
        watts = np.empty(speed_mps.shape)
        where = [address(given, np.float64, watts.shape) for given in (speed_mps, accel_mps2)]
        _POWER(ctypes.addressof(self), watts.size, *where, watts.ctypes.data)
        return watts


class Vertex(ctypes.Structure):
    """A point of a path, and the leg that ends there; see `trajectory.h`."""

    _fields_ = (
        ("point", _THREE), ("radius", _DOUBLE), ("count", _INT),
        ("u", _THREE), ("length", _DOUBLE), ("top", _DOUBLE), ("accel", _DOUBLE),
        ("v", _DOUBLE), ("sine", _DOUBLE), ("bend", _DOUBLE),
        ("normal", _THREE), ("t_s", _DOUBLE), ("half_s", _DOUBLE),
    )  # fmt: skip


class _PathProfile(ctypes.Structure):
    _fields_ = (
        ("count", _INT), ("points", _POINTER), ("speeds", _POINTER), ("acceptance", _POINTER),
        ("at", _POINTER), ("pieces", _POINTER), ("piece_count", _INT), ("legs", _INT),
    )  # fmt: skip


class PathProfile:
    """A path in the layout of C, from which its trajectory or its passing times are computed."""

    def __init__(
        self, points: _Floats, speeds: _Floats, acceptance: _Floats, steering: Steering
    ) -> None:
        """Points (n, 3), two or more, speeds (n - 1,) and acceptance radii (n,)."""
        self._count = count = len(points)
        self._kept = points, speeds, acceptance, steering
        self._vertices, self._pieces = (Vertex * count)(), np.empty((4 * count, PIECE))
        self._profile = _PathProfile(
            count,
            address(points, np.float64, (count, 3)),
            address(speeds, np.float64, (count - 1,)),
            address(acceptance, np.float64, (count,)),
            ctypes.addressof(self._vertices),
            self._pieces.ctypes.data,
        )
        self._at = ctypes.addressof(self._profile), ctypes.addressof(steering)

    def trajectory(
        self, velocity: _Triple, *, braking: bool
    ) -> tuple[_Floats, list[Vertex], float]:
        """Return pieces (m, 13) from a velocity (m/s, NED) at the start on, vertices, and end (s);
        `braking` begins with a stop."""
        end_s: float = _COMPUTE(*self._at, _THREE(*velocity), braking)
        profile = self._profile
        return self._pieces[: profile.piece_count].copy(), self._vertices[: profile.legs + 1], end_s

    def passing_times(self) -> _Floats:
        """Seconds (n,) after which each point is passed from rest to rest."""
        passed = np.empty(self._count)
        _PASS(*self._at, passed.ctypes.data)
        return passed


class Memory(ctypes.Structure):
    """State of guidance, outer loop and land detector, in the layout of C; see `flight.h`."""

    _fields_ = (
        ("mode", _INT), ("armed", _INT),
        ("course", _INT), ("interested", _INT), ("interest", _THREE),
        ("yaw_order", _DOUBLE), ("spin", _DOUBLE),
        ("path", _INT), ("too_fast", _INT),
        ("soon", _DOUBLE), ("corner", _THREE), ("normal", _THREE),
        ("oriented", _INT), ("q", _DOUBLE * 4), ("rates", _THREE),
        ("thrust_order", _DOUBLE), ("climb", _DOUBLE),
        ("pointed", _INT), ("p", _THREE), ("v", _THREE), ("a", _THREE),
        ("yaw", _DOUBLE), ("yaw_rate", _DOUBLE),
        ("t", _DOUBLE), ("rate", _DOUBLE), ("smooth_rate", _DOUBLE), ("room", _DOUBLE),
        ("along", _THREE), ("waited", _DOUBLE), ("went", _DOUBLE), ("over", _DOUBLE),
        ("missed", _DOUBLE), ("finished", _INT), ("stalled", _INT),
        ("saturated", _INT), ("integral", _THREE), ("drag", _DOUBLE * 2), ("lagged", _DOUBLE),
        ("effectiveness", _DOUBLE), ("thrust", _THREE), ("wanted_yaw", _DOUBLE),
        ("error", _THREE), ("feed", _THREE), ("collective", _DOUBLE), ("lift", _DOUBLE),
        ("descend", _DOUBLE), ("sink", _DOUBLE), ("knock", _DOUBLE),
        ("quiet", _DOUBLE), ("touching", _INT), ("contact", _INT), ("landed", _INT),
        ("noted", _INT),
    )  # fmt: skip

    def land(self, dt_s: float) -> None:
        """Run the land detector's part of a guidance step alone."""
        _LAND(ctypes.addressof(self), dt_s)


class _Strapdown(ctypes.Structure):
    _fields_ = (("numbers", _DOUBLE * DOWN),)


class _Guidance(ctypes.Structure):
    _fields_ = (("memory", _POINTER), ("gains", _POINTER), ("path", _POINTER), ("trace", _POINTER))


class _Trace(ctypes.Structure):
    _fields_ = (
        ("rows", _POINTER), ("gauges", _POINTER), ("room", _INT), ("every", _INT), ("count", _INT),
        ("steps", _INT),
    )  # fmt: skip


class _Loop(ctypes.Structure):
    _fields_ = (
        ("imu", _POINTER), ("inner", _POINTER), ("carried", _POINTER), ("samples", _POINTER),
        ("interval", _INT), ("taken", _INT), ("dt", _DOUBLE),
    )  # fmt: skip


check_sizes(
    _LIBRARY, Flight=_Functions, Strapdown=_Strapdown, Trajectory=_Trajectory, Guide=Memory,
    Guidance=_Guidance, Trace=_Trace, Loop=_Loop, Steering=Steering, Vertex=Vertex,
    PathProfile=_PathProfile, Air=Air,
)  # fmt: skip


class Trace:
    """Recorder of estimates and setpoints at guidance steps while armed; see `flight.h`."""

    def __init__(self, actuators: Gauges, *, every: int, room: int, step_ns: int) -> None:
        """A row each `every` steps of `step_ns`, `room` at most until they are taken; `actuators`:
        `Multirotor.actuators`."""
        self._kept, self._rows = actuators, np.zeros((room, TRACE))
        self._scale = np.array([step_ns, *[1.0] * (TRACE - 1)])
        where = address(self._rows, np.float64, (room, TRACE), written=True)
        self._memory = _Trace(where, actuators.at, room, every)
        self.at = ctypes.addressof(self._memory)

    def take(self) -> _Floats:
        """Return the rows (n, 31) since the last call, column 0 in ns, and empty the buffer."""
        count, self._memory.count = self._memory.count, 0
        rows: _Floats = self._rows[:count] * self._scale
        return rows


class Guide:
    """Guidance and outer loop in C, a step at a time."""

    def __init__(self, gains: Sequence[float], inner: Inner) -> None:
        """`gains`: those of `Gains` in `flight.h`, in its order; `inner` takes the orders.

        Raises:
            ValueError: another number of them.
        """
        self.memory = Memory()
        self._gains = np.array(gains, dtype=np.float64)
        self._inner = inner
        self._pieces: Pieces | None = None
        where = address(self._gains, np.float64, (GAINS,))
        self._guidance = _Guidance(ctypes.addressof(self.memory), where)
        self._at = ctypes.addressof(self._guidance)

    def track(self, pieces: Pieces | None) -> None:
        """Set the trajectory to be tracked; None for none."""
        self._pieces = pieces
        self._guidance.path = None if pieces is None else pieces.at

    @property
    def at(self) -> int:
        """Address of the structure, as C takes it.

        Raises:
            ValueError: a trajectory is to be tracked, and there is none.
        """
        if self._pieces is None and self.memory.mode == TRACK:
            raise ValueError("there is no trajectory to track")
        return self._at

    def record_into(self, trace: Trace) -> None:
        """Record into `trace` from now on."""
        self._trace = trace
        self._guidance.trace = trace.at

    def step(self, nav: Strapdown) -> None:
        """Run one guidance step from the state `nav`; its events are flags in `memory.noted`."""
        _GUIDE(self.at, nav.at, self._inner.at)


class Loop:
    """The loop of a flight in C: the ticks, and the guidance steps between them."""

    def __init__(
        self, imu: Imu, inner: Inner, carried: Strapdown, *, interval: int, dt_s: float
    ) -> None:
        """`interval`: ticks of the IMU between guidance steps, by which `carried` is carried."""
        self.interval = interval
        self.samples = array("d", bytes(8 * SAMPLE * interval))  # the newest ones
        self._imu, self._kept = imu, (inner, carried)
        where, _ = self.samples.buffer_info()
        self._memory = _Loop(imu.at, inner.at, carried.at, where, interval, 0, dt_s)
        self._at = ctypes.addressof(self._memory)

    @property
    def count(self) -> int:
        """Ticks since the last guidance step."""
        count: int = self._memory.taken
        return count

    @property
    def taken(self) -> "array[float]":
        """IMU samples since the last guidance step: six numbers a tick, end to end."""
        return self.samples[: SAMPLE * self.count]

    def fly(
        self, run: Callable[[], object], ticks: int, increments: Increments, guide: Guide
    ) -> int:
        """Run `ticks` ticks by `run`, and the guidance steps between them, but none after the last.

        Ends early, after a guidance step, where that notes an event. Adds the sum of the samples
        up to each step to `increments`. Returns the ticks run.

        Raises:
            ValueError: there is no room for the increments, or no trajectory to track.
        """
        self._imu.draw(ticks)
        before = self.count
        sums = increments.reserve((before + ticks) // self.interval)
        flown: int = _CRUISE(self._at, run, ticks, sums, guide.at)
        increments.count += (before + flown) // self.interval
        return flown
