"""The C interface of the error-state filter (`error_state.h`, `kalman.h`), and what it works on.

The calls take microseconds, so they keep Python's lock.
"""

from array import array
from collections.abc import Sequence

import numpy as np

from flightdyn.frames import Quaternion, Triple
from flightdyn.native.library import FUNCTIONS
from flightdyn.state import Vector
from native.loading import address

STATES, ROWS, KINDS = 22, 8, 4
_SQUARE = (STATES, STATES)


class Transition:
    """Writes into a transition matrix of the filter."""

    def __init__(self, matrix: Vector) -> None:
        """`matrix` (22, 22) has to stay where it is. Raises ValueError for another shape."""
        self._matrix = matrix
        self._q, self._gained = np.zeros(4), np.zeros(3)
        self._at = (
            address(matrix, np.float64, (STATES, STATES), written=True),
            address(self._q, np.float64, (4,)),
            address(self._gained, np.float64, (3,)),
        )

    def write(self, q: Quaternion, gained: Triple, dt_s: float) -> None:
        """The blocks that depend on the flight: over `dt_s` from the attitude `q` on (body to NED),
        with the velocity `gained` (NED, m/s) without gravity.
        """
        self._q[:] = q
        self._gained[:] = gained
        FUNCTIONS.transition(*self._at, dt_s)


class Step:
    """Transition and process noise (22, 22) over a time."""

    def __init__(self, transition: Vector, noise: Vector) -> None:
        """They have to stay where they are. Raises ValueError for other shapes."""
        self.F, self.Q = transition, noise
        self.at = tuple(address(matrix, np.float64, _SQUARE) for matrix in (transition, noise))


class Kalman:
    """Covariance of the error state, and what a measurement with it tells of the error."""

    def __init__(self, covariance: Vector, measurement: Vector, noise: Vector) -> None:
        """`covariance` (22, 22), `measurement` (8, 22), its `noise` (8, 8) have to stay where they
        are.

        Raises:
            ValueError: other shapes.
        """
        self.P = covariance
        self.residual = np.zeros(ROWS)  # of the measurements; to be filled in
        self._kept = measurement, noise
        self._std, self._nis, self._error = np.zeros(ROWS), np.zeros(KINDS), np.zeros(STATES)
        self._at = address(covariance, np.float64, _SQUARE, written=True)
        self._H = address(measurement, np.float64, (ROWS, STATES))
        self._R = address(noise, np.float64, (ROWS, ROWS))
        self._z = address(self.residual, np.float64, (ROWS,), written=True)
        self._found = (
            address(self._std, np.float64, (ROWS,), written=True),
            address(self._nis, np.float64, (KINDS,), written=True),
        )
        self._x = address(self._error, np.float64, (STATES,), written=True)

    def predict(self, step: "Step") -> None:
        """Bring the covariance over a step: F P F' + Q."""
        FUNCTIONS.predict(self._at, *step.at)

    def measure(self) -> tuple[list[float], list[float]]:
        """Standard deviations (8) expected of the residual, and the normalised square of the
        residual of GNSS position, GNSS velocity, height and heading (4).
        """
        FUNCTIONS.innovate(self._at, self._H, self._R, self._z, *self._found)
        return self._std.tolist(), self._nis.tolist()

    def correct(self, rows: Sequence[int], noise: Vector | None = None) -> list[float]:
        """The error (22) that the residuals of some rows tell of, by another `noise` (8, 8) where
        there is one.

        Raises:
            ValueError: there are no such rows.
            ArithmeticError: the covariance of the residuals is not positive definite.
        """
        numbers = array("q", rows)
        if not all(0 <= row < ROWS for row in rows) or len(set(rows)) != len(rows):
            raise ValueError(f"rows {rows} of {ROWS}")
        r = self._R if noise is None else address(noise, np.float64, (ROWS, ROWS))
        where, count = numbers.buffer_info()
        if not FUNCTIONS.correct(self._at, self._H, r, self._z, where, count, self._x):
            raise ArithmeticError("singular innovation covariance")
        error: list[float] = self._error.tolist()
        return error
