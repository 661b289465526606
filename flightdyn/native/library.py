"""The C interface of navigation, guidance and outer loop (`flight.h`), and the memory it works on.

The calls take well under a microsecond, so they keep Python's lock.
"""

import ctypes
from array import array
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flightdyn.native.ticks import FLIGHT, Gauges, Imu, Inner
from native.headers import Structure as Structure
from native.headers import columns
from native.loading import address

SAMPLE = columns(FLIGHT.Sample, "rate force")
INCREMENT = columns(FLIGHT.Increment, "dt angle velocity")
PIECE = columns(FLIGHT.Piece, "t0 p v a area")
TRACE: int = FLIGHT.TRACE  # numbers of a row
STATES, ROWS, KINDS = FLIGHT.STATES, FLIGHT.ROWS, FLIGHT.KINDS  # of the filter
NOTHING, TRACK, TARGET, ATTITUDE = FLIGHT.NOTHING, FLIGHT.TRACK, FLIGHT.TARGET, FLIGHT.ATTITUDE
FINISHED, STALLED, LIMITED, NEAR = FLIGHT.FINISHED, FLIGHT.STALLED, FLIGHT.LIMITED, FLIGHT.NEAR

_Triple = tuple[float, float, float]
_Quaternion = tuple[float, float, float, float]
_Floats = NDArray[np.float64]


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
        FLIGHT.integrate(where, count // SAMPLE, dt_s, to, None if carried is None else carried.at)
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


columns(FLIGHT.State, "p v q")
columns(FLIGHT.ImuBias, "gyro accel")
columns(FLIGHT.Earth, "gravity rate_north rate_down")
_PARTS = [
    slice(field.offset // 8, (field.offset + field.size) // 8)
    for name in ("state", "bias", "earth", "gained", "force")
    if (field := getattr(FLIGHT.Strapdown, name))
]
_CARRIED = ctypes.sizeof(FLIGHT.Strapdown) // 8


class Strapdown:
    """Strapdown integration: position, velocity (NED) and attitude, carried by increments."""

    def __init__(self, earth: Sequence[float], *, most: int) -> None:
        """`earth`: gravity (m/s2), its rate north and down (rad/s); `most` increments at a time."""
        self._most = most
        self._memory = memory = np.zeros(_CARRIED + most)
        self.at = address(memory, np.float64, memory.shape, written=True)
        self._state, self._bias, its_earth, self._gained, self._force = (
            memory[part] for part in _PARTS
        )
        its_earth[:], self._down = earth, memory[_CARRIED:]

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
        FLIGHT.carry(self.at, increments.rows(first, count), count)

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
        downs: list[float] = self._down[:count].tolist()
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
        FLIGHT.transition(*self._at, dt_s)


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
        FLIGHT.innovate(*self._at)
        return self._std.tolist(), self._nis.tolist()


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
        self._trajectory = FLIGHT.Trajectory(
            pieces=where, count=len(pieces), half=half_s, start=start_s, end=end_s
        )
        self.at = ctypes.addressof(self._trajectory)
        self._pva = np.zeros(9)
        self._out = address(self._pva, np.float64, (9,), written=True)

    def reference(self, t: float) -> list[float]:
        """Return smoothed position, velocity and acceleration at `t` seconds: nine numbers."""
        FLIGHT.reference(self.at, t, 0.0, self._out)  # none of them later than the others
        found: list[float] = self._pva.tolist()
        return found


def steering(limits: object) -> Structure:
    """Limits of the guidance as C takes them; those of `limits` have the same names."""
    fields = FLIGHT.Steering._fields_
    made: Structure = FLIGHT.Steering(**{name: getattr(limits, name) for name, _ in fields})
    return made


def air(watts: _Floats, *, density: float, wind_mps: _Triple) -> Structure:
    """Density, wind and power of level flight as C takes them: `watts` (n,), two or more, at 0, 1,
    2, ... m/s, which have to outlive it."""
    at, rows = address(watts, np.float64, watts.shape), len(watts)
    made: Structure = FLIGHT.Air(density=density, wind=wind_mps, watts=at, rows=rows)
    return made


def power(air: Structure, speed_mps: _Floats, accel_mps2: _Floats) -> _Floats:
    """Watts (n,) at speeds through the air and sizes of acceleration (n,)."""
    watts = np.empty(speed_mps.shape)
    where = [address(given, np.float64, watts.shape) for given in (speed_mps, accel_mps2)]
    FLIGHT.power(ctypes.addressof(air), watts.size, *where, watts.ctypes.data)
    return watts


class PathProfile:
    """A path in the layout of C, from which its trajectory or its passing times are computed."""

    def __init__(
        self, points: _Floats, speeds: _Floats, acceptance: _Floats, steering: Structure
    ) -> None:
        """Points (n, 3), two or more, speeds (n - 1,) and acceptance radii (n,)."""
        self._count = count = len(points)
        self._kept = points, speeds, acceptance, steering
        self._vertices, self._pieces = (FLIGHT.Vertex * count)(), np.empty((4 * count, PIECE))
        self._profile = FLIGHT.PathProfile(
            count=count,
            points=address(points, np.float64, (count, 3)),
            speeds=address(speeds, np.float64, (count - 1,)),
            acceptance=address(acceptance, np.float64, (count,)),
            at=ctypes.addressof(self._vertices),
            pieces=self._pieces.ctypes.data,
        )
        self._at = ctypes.addressof(self._profile), ctypes.addressof(steering)

    def trajectory(
        self, velocity: _Triple, *, braking: bool
    ) -> tuple[_Floats, list[Structure], float]:
        """Return pieces (m, 13) from a velocity (m/s, NED) at the start on, vertices, and end (s);
        `braking` begins with a stop."""
        start = (ctypes.c_double * 3)(*velocity)
        end_s: float = FLIGHT.compute_trajectory(*self._at, start, braking)
        profile = self._profile
        return self._pieces[: profile.piece_count].copy(), self._vertices[: profile.legs + 1], end_s

    def passing_times(self) -> _Floats:
        """Seconds (n,) after which each point is passed from rest to rest."""
        passed = np.empty(self._count)
        FLIGHT.pass_points(*self._at, passed.ctypes.data)
        return passed


def land(memory: Structure, dt_s: float) -> None:
    """Run the land detector's part of a guidance step alone."""
    FLIGHT.land(ctypes.addressof(memory), dt_s)


class Trace:
    """Recorder of estimates and setpoints at guidance steps while armed; see `flight.h`."""

    def __init__(self, actuators: Gauges, *, every: int, room: int, step_ns: int) -> None:
        """A row each `every` steps of `step_ns`, `room` at most until they are taken; `actuators`:
        `Multirotor.actuators`."""
        self._kept, self._rows = actuators, np.zeros((room, TRACE))
        where = address(self._rows, np.float64, (room, TRACE), written=True)
        self._memory = FLIGHT.Trace(
            rows=where, gauges=actuators.at, room=room, every=every, step_ns=step_ns
        )
        self.at = ctypes.addressof(self._memory)

    def take(self) -> _Floats:
        """Return the rows (n, 31) since the last call, column 0 in ns, and empty the buffer."""
        count, self._memory.count = self._memory.count, 0
        return self._rows[:count].copy()


class Guide:
    """Guidance and outer loop in C, a step at a time."""

    def __init__(self, gains: Mapping[str, float], inner: Inner) -> None:
        """`gains`: those of `Gains` in `flight.h`; `inner` takes the orders."""
        self.memory: Structure = FLIGHT.Guide()
        self._gains = FLIGHT.Gains(**gains)
        self._inner = inner
        self._pieces: Pieces | None = None
        memory, its_gains = ctypes.addressof(self.memory), ctypes.addressof(self._gains)
        self._guidance = FLIGHT.Guidance(memory=memory, gains=its_gains)
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

    def passed(self, p: _Triple, v: _Triple) -> bool:
        """Whether the next corner is passed at `p` (m, NED) with the velocity `v` (m/s)."""
        three = ctypes.c_double * 3
        return bool(FLIGHT.passed(ctypes.addressof(self.memory), three(*p), three(*v)))

    def step(self, nav: Strapdown) -> None:
        """Run one guidance step from the state `nav`; its events are flags in `memory.noted`."""
        FLIGHT.guide(self.at, nav.at, self._inner.at)


class Probe:
    """A sensor that is read at every so many ticks of a flight."""

    def __init__(self, gauges: Gauges, *, every: int) -> None:
        """`gauges` is one; it is read first after `every` ticks."""
        if gauges.count != 1:
            raise ValueError(f"a probe has one gauge, not {gauges.count}")
        self._kept = gauges
        self._memory = FLIGHT.Probe(gauge=gauges.at, every=every)
        self.at = ctypes.addressof(self._memory)
        self.most = FLIGHT.READINGS * every  # ticks until the values are taken

    def take(self) -> list[float]:
        """Return the values since the last call."""
        count, self._memory.count = self._memory.count, 0
        values: list[float] = self._memory.values[:count]
        return values


class Loop:
    """The loop of a flight in C: the ticks, and the guidance steps between them."""

    def __init__(
        self,
        imu: Imu,
        inner: Inner,
        carried: Strapdown,
        *,
        interval: int,
        dt_s: float,
        ahead: Strapdown | None = None,
        probe: Probe | None = None,
    ) -> None:
        """`interval`: ticks of the IMU between guidance steps, by which `carried` is carried.

        With `ahead`, to carry the state between them in, the loop ends where a corner is passed.
        `probe` is read on the way, its values taken after each call.
        """
        self.interval = interval
        self.samples = array("d", bytes(8 * SAMPLE * interval))  # the newest ones
        self._imu, self._probe, self._kept = imu, probe, (inner, carried, ahead)
        where, _ = self.samples.buffer_info()
        self._memory = FLIGHT.Loop(
            imu=imu.at,
            inner=inner.at,
            carried=carried.at,
            ahead=ahead and ahead.at,
            probe=probe and probe.at,
            samples=where,
            interval=interval,
            dt=dt_s,
        )
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

        Ends early, after a guidance step, where that notes an event, and where a corner is passed.
        Adds the sum of the samples up to each step to `increments`. Returns the ticks run.

        Raises:
            ValueError: there is no room for the increments or the probe's values, or no trajectory
                to track.
        """
        if self._probe is not None and ticks > self._probe.most:
            raise ValueError(f"{ticks} ticks at once, {self._probe.most} at most")
        self._imu.draw(ticks)
        before = self.count
        sums = increments.reserve((before + ticks) // self.interval)
        flown: int = FLIGHT.cruise(self._at, run, ticks, sums, guide.at)
        increments.count += (before + flown) // self.interval
        return flown
