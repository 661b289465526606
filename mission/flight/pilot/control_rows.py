"""What a firmware tells of its control, as rows of the log's `/control`."""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from flightdyn.native.library import TRACE
from mission.base.arrays import Floats

# The first column of setpoints: attitude, body rates, thrust (8 numbers); position about home,
# velocity, acceleration, yaw and its rate (11).
ATTITUDE, MOTION = 8, 20
_HELD_NS = 100_000_000  # no setpoint is in force longer unless it is told again


class ControlRows:
    """Queue of rows as `flightdyn.native.library.Trace` has them, one for each attitude message;
    unknown values are NaN."""

    def __init__(self) -> None:
        self._rows: deque[Floats] = deque()
        self._setpoints = {
            column: deque[tuple[int, Sequence[float]]]() for column in (ATTITUDE, MOTION)
        }

    def attitude(
        self, t_ns: int, q_frd_to_ned: Floats, rates_frd_radps: Floats, motors: Sequence[float]
    ) -> None:
        """Append a row with the believed attitude and body rates, and the motors' duty cycles."""
        row = np.full(TRACE, math.nan)
        row[0], row[1:5], row[5:8], row[16:20] = t_ns, q_frd_to_ned, rates_frd_radps, motors
        self._rows.append(row)

    def setpoint(self, column: int, t_ns: int, numbers: Sequence[float]) -> None:
        """Queue a setpoint for `ATTITUDE` or `MOTION` columns: SI units, FRD -> NED, NED."""
        self._setpoints[column].append((t_ns, numbers))

    def take(self, until_ns: int) -> Floats | None:
        """Remove and return rows (n, 31) up to a time, with setpoints in force; None: no rows."""
        taken = []
        while self._rows and self._rows[0][0] <= until_ns:
            taken.append(row := self._rows.popleft())
            for column, told in self._setpoints.items():
                while len(told) > 1 and told[1][0] <= row[0]:
                    told.popleft()
                if told and 0 <= row[0] - told[0][0] <= _HELD_NS:
                    row[column : column + len(told[0][1])] = told[0][1]
        return np.array(taken) if taken else None
