"""The state estimator: an error-state INS/GNSS Kalman filter. The one home of filterpy.

The nominal state is carried by the IMU outside the filter; filterpy's KalmanFilter holds the error
of it (zero after every correction) and its covariance. Everything is fused in order at a horizon
that lies in the past by the receiver's delay, and the state of now is the horizon's state carried
forward by the IMU increments since (the arrangement of PX4's EKF2).

Its states and matrices are those of `error_model`.
"""

import math
import sys
from collections import Counter, deque
from collections.abc import Sequence
from itertools import takewhile
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.lapack import dgesv

from flightdyn.config import SensorsConfig
from flightdyn.frames import quaternion_multiply, rotation_matrix, rotation_quaternion
from flightdyn.inertial import Earth, NavState
from flightdyn.native.library import Increments, Strapdown, Transition
from flightdyn.navigation.airspeed import DragAirspeed
from flightdyn.navigation.error_model import (
    ATT,
    BA,
    BG,
    POS,
    STATES,
    VEL,
    Alignment,
    gnss_correlation,
    initial_covariance,
    level,
    process_noise,
    transition,
)
from flightdyn.navigation.measurements import Biases, Kind, Measurements
from flightdyn.physics.air import pressure_slope
from flightdyn.physics.airframe.parameters import QUAD_X
from flightdyn.state import GnssFix, Innovation, Vector

# Velocity or height disbelieved that many times in a row: it is the inertial side that is wrong.
_DOUBTS = 3
_DOUBT_STD = ((POS, 1.0), (VEL, 1.0), (ATT, 0.05), (BG, 0.02), (BA, 0.4))  # SI
_UNAIDED_NS = 1_000_000_000  # without a velocity of GNSS for so long, nothing is learnt of the wind
_ADRIFT_NS = 10_000_000_000  # and for so long, the velocity by drag is better than the inertial one
_AIR_STD_MPS = 2.0  # of it: its errors last, and are not those of one sample
_CORRECT_NS = 200_000_000  # without GNSS the rest is fused at this interval


_ONES = [np.eye(rows) for rows in range(9)]

# What filterpy imports, a third of a program's start, for what is not asked of it here: likelihoods
# and filters on grids.
_NOT_ASKED = {
    "scipy.stats": ("norm", "multivariate_normal"),
    "scipy.ndimage": ("convolve", "shift"),
}


def _kalman_filter() -> Any:
    """The class in a filterpy of our own without `_NOT_ASKED`: who else imports it gets all."""
    there = "filterpy" in sys.modules
    absent = [name for name in _NOT_ASKED if not there and name not in sys.modules]
    nothing = SimpleNamespace(logpdf=lambda *_, **__: None)  # which is tried at once
    for name in absent:
        sys.modules[name] = ModuleType(name)
        vars(sys.modules[name]).update(dict.fromkeys(_NOT_ASKED[name], nothing))
    try:
        from filterpy.kalman import KalmanFilter
    finally:
        ours = [name for name in sys.modules if name.partition(".")[0] == "filterpy"]
        for name in (*absent, *([] if there else ours)):
            del sys.modules[name]
    return KalmanFilter


_KalmanFilter = _kalman_filter()


class _Model(NamedTuple):
    """Error-state model over a time: transition, process noise, GNSS correlation that is left."""

    F: Vector
    Q: Vector
    keep: float
    transition: Transition


def _inverse(matrix: Vector) -> Vector:
    """Inverse of a matrix as numpy computes it, without checks that take a quarter of an update."""
    _, _, inverse, singular = dgesv(matrix, _ONES[len(matrix)])
    if singular:
        raise np.linalg.LinAlgError("singular innovation covariance")
    return np.asarray(inverse)


class Estimator:
    """Error-state INS/GNSS Kalman filter at a delayed fusion horizon, predicted to now."""

    def __init__(
        self,
        config: SensorsConfig,
        *,
        align: Alignment,
        fix: GnssFix,
        t_ns: int,
        earth: Earth,
        step_s: float,
        increments: int,
    ) -> None:
        """Start at rest at height zero; a filter step has `step_s` and so many IMU `increments`."""
        self._config = config
        self._step_ns = round(step_s * 1e9)
        self._step_s = step_s
        self._per_step = increments
        self._delay_ns = round(config.gnss.delay_s * 1e9)
        increment_ns = self._step_ns // increments
        self._pa_per_m = pa_per_m = pressure_slope(align.pressure_pa)
        self.measurements = Measurements(
            config, align, pa_per_m=pa_per_m, increment_ns=increment_ns
        )
        # At rest and nearly level the z accelerometer tells its bias; x and y pass for a tilt.
        self.biases = Biases(
            gyro=align.rates, accel=(0.0, 0.0, align.specific_force[2] + earth.gravity_mps2)
        )
        self.horizon = NavState(
            t_ns,
            (float(fix.pos_ned_m[0]), float(fix.pos_ned_m[1]), 0.0),
            (0.0, 0.0, 0.0),
            level(align, declination_rad=self.measurements.declination_rad),
        )
        # Those since the horizon, by which whoever reads the IMU carries the state of now on.
        most = math.ceil((_CORRECT_NS + self._step_ns + self._delay_ns) / increment_ns)
        self.increments = Increments(most)
        self._from_horizon = Strapdown(earth, most=most)
        self.to_now = Strapdown(earth, most=most)
        self._few, self.between = Increments(1), Strapdown(earth, most=1)
        self._take_over()
        self.t_ns = t_ns  # of the last update
        # Since the covariance was brought up to date: the attitude then, velocity gained, steps.
        self._before, self._gained, self._steps = self.horizon.q, (0.0, 0.0, 0.0), 0
        self._corrected_ns = t_ns
        self._look_ahead()
        self._refused: Counter[str] = Counter()  # in a row
        self.innovations: deque[Innovation] = deque(maxlen=64)
        # When each kind was last believed; the first fix is where the filter starts.
        self.fused_ns: dict[str, int] = dict.fromkeys(("gnss position", "gnss velocity"), fix.t_ns)
        self._air = DragAirspeed(QUAD_X.drag, pressure_pa=align.pressure_pa)
        self._kf = _KalmanFilter(dim_x=STATES, dim_z=3)
        self._kf.inv = _inverse
        self._kf.x = np.zeros((STATES, 1))
        self._models: dict[int, _Model] = {}
        self._kf.P = initial_covariance(
            config, align, attitude=self.horizon.q, gravity_mps2=earth.gravity_mps2
        )

    @property
    def now(self) -> NavState:
        """State estimate at `t_ns`, the last update: the horizon carried forward by the IMU."""
        return NavState.of(self.t_ns, self.to_now)

    def std(self, part: slice) -> Vector:
        """Standard deviations of one part of the error state."""
        return np.sqrt(np.diag(self._kf.P)[part])

    def update(self, t_ns: int, fix: GnssFix | None) -> None:
        """Bring the filter up to `t_ns`, corrected where due; `fix`: a solution just arrived."""
        self.t_ns = t_ns
        if fix is not None:
            self.measurements.fixes.append(fix)
        elif t_ns < self.due_ns:
            return
        increments = self.increments
        while self.horizon.t_ns + self._step_ns <= t_ns - self._delay_ns:
            self._advance()
            if self._correct():
                self.to_now.carry(increments, 0, increments.count)
        self._look_ahead()

    def _look_ahead(self) -> None:
        """Set `due_ns`, by which `update` is due: when the horizon next comes to a correction."""
        here, step_ns = self.horizon.t_ns, self._step_ns
        wait_ns = self._corrected_ns + _CORRECT_NS - here
        steps = 1 if self.measurements.fixes else math.ceil(wait_ns / step_ns)
        self.due_ns = here + max(1, steps) * step_ns + self._delay_ns

    def ahead(self, samples: Sequence[float], t_ns: int, *, dt_s: float) -> NavState:
        """Return the state at `t_ns`: `now` carried forward by IMU samples, six numbers each."""
        few = self._few
        few.drop(few.count)
        ahead, (_, p, v, q), b = self.between, self.now, self.biases
        ahead.place(p, v, q)
        ahead.correct(b.gyro, b.accel)
        few.add(samples, dt_s=dt_s, carried=ahead)
        return NavState.of(t_ns, ahead)

    def innovations_after(self, t_ns: int) -> tuple[Innovation, ...]:
        """Return the innovations after an instant, oldest first; the filter keeps the last 64."""
        newest = takewhile(lambda item: item.t_ns > t_ns, reversed(self.innovations))
        return tuple(newest)[::-1]

    def _advance(self) -> None:
        """Carry the horizon over one filter step."""
        b, dt, count = self.biases, self._step_s, self._per_step
        carried = self._from_horizon
        carried.carry(self.increments, 0, count)
        self.increments.drop(count)
        n, e, d = carried.gained
        gn, ge, gd = self._gained
        self._gained = (gn + n, ge + e, gd + d)
        self._steps += 1
        self.measurements.downs += carried.downs(count)
        self.horizon = state = NavState.of(self.horizon.t_ns + self._step_ns, carried)
        force = (n / dt, e / dt, d / dt)
        self._air.take(force, rotation_matrix(state.q), down_mps=state.v[2], bias=b.accel)
        if self._unaided_ns < _UNAIDED_NS:
            self._air.learn_wind(state.v, bias=b.accel, dt_s=dt)

    def _predict(self) -> None:
        """Bring the covariance from the last correction to the horizon."""
        model = self._models.get(self._steps) or self._model(self._steps)
        model.transition.write(self._before, self._gained, self._steps * self._step_s)
        self._kf.F, self._kf.Q = model.F, model.Q
        self._kf.predict()
        b, (n, e, d), keep = self.biases, self.biases.gnss, model.keep
        self.biases = Biases(b.gyro, b.accel, (n * keep, e * keep, d * keep), b.mag, b.baro)
        self._before, self._gained, self._steps = self.horizon.q, (0.0, 0.0, 0.0), 0

    def _model(self, steps: int) -> _Model:
        """Transition and noise of so many filter steps in one."""
        step_s = steps * self._step_s
        F = transition(self._config, step_s=step_s)
        made = self._models[steps] = _Model(
            F,
            process_noise(self._config, step_s=step_s, pa_per_m=self._pa_per_m),
            gnss_correlation(self._config, step_s=step_s),
            Transition(F),
        )
        return made

    def _correct(self) -> bool:
        """Fuse the measurements up to the horizon where due; return whether any was used."""
        t_ns = self.horizon.t_ns
        fix = self.measurements.take_fix(t_ns)
        if fix is None and t_ns - self._corrected_ns < _CORRECT_NS:
            return False
        self._corrected_ns = t_ns
        self._predict()
        kinds = self.measurements.compare(fix, self.horizon, self.biases)
        extra: list[int] = []
        if fix is None and self._unaided_ns > _ADRIFT_NS:
            # No innovation: it says nothing about a sensor, and holds the velocity only loosely.
            extra = [3, 4]
            drift = np.subtract(self._air.over_ground_ne_mps, self.horizon.v[:2])
            self.measurements.residual[3:5] = drift
        return self._fuse(kinds, extra)

    @property
    def _unaided_ns(self) -> int:
        """Time (ns) since a GNSS velocity was last accepted."""
        return self.horizon.t_ns - self.fused_ns["gnss velocity"]

    def _fuse(self, kinds: Sequence[Kind], extra: Sequence[int]) -> bool:
        """Fuse the rows whose innovations pass their gates, and `extra`; return whether any."""
        kf, measured = self._kf, self.measurements
        z, H, R = measured.residual, measured.H, measured.R
        stds, squares = measured.expected.measure(kf.P)
        use = list(extra)
        t_ns, values = self.horizon.t_ns, z.tolist()
        for kind, number, part, gate in kinds:
            innovation = Innovation(
                t_ns, kind, tuple(values[part]), tuple(stds[part]), squares[number], gate
            )
            self.innovations.append(innovation)
            self._refused[kind] = 0 if innovation.accepted else self._refused[kind] + 1
            if innovation.accepted:
                use.extend(range(part.start, part.stop))
                self.fused_ns[kind] = t_ns
        for kind in ("gnss velocity", "baro"):
            if self._refused[kind] >= _DOUBTS:
                self._widen_covariance()
        if not use:
            return False
        if len(use) < 8:
            use.sort()
            z, H, R = z[use], H[use], R[np.ix_(use, use)]
            for row, number in enumerate(use):
                if number in extra:
                    R[row, row] = _AIR_STD_MPS**2
        kf.R = R
        kf.update(z[:, None], H=H)
        self._inject_error()
        return True

    def _widen_covariance(self) -> None:
        """Widen the covariance: an IMU whose bias jumps is not in the model of the filter."""
        P = self._kf.P
        for part, std in _DOUBT_STD:
            P[part, part] += np.eye(3) * std**2
        self._refused.clear()

    def _inject_error(self) -> None:
        """Move the estimated error into the nominal state and the biases."""
        kf = self._kf
        x = kf.x[:, 0].tolist()
        kf.x = np.zeros((STATES, 1))
        h, b = self.horizon, self.biases
        self.horizon = NavState(
            h.t_ns,
            (h.p[0] + x[0], h.p[1] + x[1], h.p[2] + x[2]),
            (h.v[0] + x[3], h.v[1] + x[4], h.v[2] + x[5]),
            quaternion_multiply(rotation_quaternion(x[6], x[7], x[8]), h.q),
        )
        self.biases = Biases(
            (b.gyro[0] + x[9], b.gyro[1] + x[10], b.gyro[2] + x[11]),
            (b.accel[0] + x[12], b.accel[1] + x[13], b.accel[2] + x[14]),
            (b.gnss[0] + x[15], b.gnss[1] + x[16], b.gnss[2] + x[17]),
            (b.mag[0] + x[18], b.mag[1] + x[19], b.mag[2] + x[20]),
            b.baro + x[21],
        )
        self._take_over()

    def _take_over(self) -> None:
        """Carry on from the corrected horizon, with the corrected biases."""
        _, p, v, q = self.horizon
        for carried in (self._from_horizon, self.to_now):
            carried.place(p, v, q)
            carried.correct(self.biases.gyro, self.biases.accel)
        self._before = q
