"""Measurements: kept until the fusion horizon reaches them, then compared with its state."""

import math
from collections import deque
from typing import NamedTuple

from flightdyn.config import SensorsConfig
from flightdyn.frames import Triple, rotation_matrix, wrap_pi
from flightdyn.inertial import EARTH_RADIUS_M, NavState
from flightdyn.native.library import Innovations
from flightdyn.navigation.error_model import (
    BARO,
    BMAG,
    HEADING,
    Alignment,
    magnetometer_row,
    measurement_matrix,
    measurement_noise,
)
from flightdyn.physics.air import altitude_m
from flightdyn.physics.sensors import BaroSample, MagSample
from flightdyn.state import GnssFix


class Biases(NamedTuple):
    """Estimated biases: gyro (rad/s), accel (m/s2), mag (gauss) in FRD; gnss (m, NED); baro (m)."""

    gyro: Triple = (0.0, 0.0, 0.0)
    accel: Triple = (0.0, 0.0, 0.0)
    gnss: Triple = (0.0, 0.0, 0.0)
    mag: Triple = (0.0, 0.0, 0.0)
    baro: float = 0.0


class Kind(NamedTuple):
    """A kind of measurement, accepted or rejected as one."""

    name: str
    number: int  # in C
    part: slice  # its rows of the measurement
    gate: float  # 99.99 % point of chi-square, with as many degrees of freedom


_GATE_3, _GATE_1 = 21.1, 15.1
_GNSS = (
    Kind("gnss position", 0, slice(0, 3), _GATE_3),
    Kind("gnss velocity", 1, slice(3, 6), _GATE_3),
)
_BARO = Kind("baro", 2, slice(BARO, BARO + 1), _GATE_1)
_HEADING = Kind("heading", 3, slice(HEADING, HEADING + 1), _GATE_1)


class Measurements:
    """Buffers of samples not yet fused, and the rows `H`, `R`, `residual` of those to be fused.

    `H` (8, 22) and `R` (8, 8) are those of `error_model`, for the present attitude and number of
    samples.
    """

    def __init__(
        self, config: SensorsConfig, align: Alignment, *, pa_per_m: float, increment_ns: int
    ) -> None:
        self._mag_config = mag = config.mag
        self.declination_rad = math.atan2(mag.field_east_gauss, mag.field_north_gauss)
        self._ground_m = altitude_m(align.pressure_pa)
        self._increment_ns = increment_ns
        # What waits, the oldest first: whoever reads a sensor appends its samples of now.
        self.fixes: deque[GnssFix] = deque()
        self.baro: deque[BaroSample] = deque()
        self.mag: deque[MagSample] = deque()
        # Of the state after each of the increments from the last correction to the horizon.
        self.downs: list[float] = []
        self.H = measurement_matrix(config)
        self.R = measurement_noise(config, pa_per_m=pa_per_m)
        self._baro_var = float(self.R[BARO, BARO])
        self.expected = Innovations(self.H, self.R)
        self.residual = self.expected.residual

    def take_fix(self, t_ns: int) -> GnssFix | None:
        """Return the latest waiting GNSS solution up to an instant, or None; drops older ones."""
        fix: GnssFix | None = None
        while self.fixes and self.fixes[0].t_ns <= t_ns:
            fix = self.fixes.popleft()
        return fix

    def compare(self, fix: GnssFix | None, state: NavState, biases: Biases) -> list[Kind]:
        """Fill in the rows of what was measured up to `state`; return the kinds that were."""
        kinds: list[Kind] = []
        if fix is not None:
            self._compare_fix(fix, state, biases.gnss)
            kinds += _GNSS
        if self.baro and self.baro[0].t_ns <= state.t_ns:
            self._compare_baro(state, biases.baro)
            kinds.append(_BARO)
        mag: MagSample | None = None
        while self.mag and self.mag[0].t_ns <= state.t_ns:
            mag = self.mag.popleft()
        # A heading of another instant would be wrong by what the aircraft turned since.
        if mag is not None and mag.t_ns == state.t_ns:
            self._compare_heading(mag, state, biases.mag)
            kinds.append(_HEADING)
        return kinds

    def _compare_fix(self, fix: GnssFix, state: NavState, bias: Triple) -> None:
        (pn, pe, pd), (vn, ve, vd) = state.p, state.v
        bn, be, bd = bias
        age = (state.t_ns - fix.t_ns) * 1e-9  # below one filter step
        n, e, d = fix.pos_ned_m.tolist()
        un, ue, ud = fix.vel_ned_mps.tolist()
        self.residual[:6] = (
            n + vn * age - pn - bn,
            e + ve * age - pe - be,
            d + vd * age - pd - bd,
            un - vn,
            ue - ve,
            ud - vd,
        )

    def _compare_baro(self, state: NavState, bias: float) -> None:
        """Fill in the mean of the waiting samples, each against the height of its own instant."""
        north, east, down = state.p
        total, count = 0.0, 0
        while self.baro and self.baro[0].t_ns <= state.t_ns:
            sample = self.baro.popleft()
            back, between = divmod(state.t_ns - sample.t_ns, self._increment_ns)
            # `down` where it fell between increments, or before the last correction.
            then = down if between or back >= len(self.downs) else self.downs[-1 - back]
            total += altitude_m(sample.pressure_pa) - self._ground_m + then
            count += 1
        self.downs.clear()
        # The air follows the curved Earth, positions the plane that touches it at home.
        curve = (north * north + east * east) / (2 * EARTH_RADIUS_M)
        self.residual[BARO] = total / count - curve - bias
        self.R[BARO, BARO] = self._baro_var / count

    def _compare_heading(self, sample: MagSample, state: NavState, bias: Triple) -> None:
        (x, y, z), b = sample.field_frd_gauss, bias
        x, y, z = x - b[0], y - b[1], z - b[2]
        r = rotation_matrix(state.q)
        self.H[HEADING, BMAG] = magnetometer_row(self._mag_config, r)
        north = r[0] * x + r[1] * y + r[2] * z
        east = r[3] * x + r[4] * y + r[5] * z
        self.residual[HEADING] = wrap_pi(self.declination_rad - math.atan2(east, north))
