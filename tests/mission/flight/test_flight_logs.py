"""The flight logs of a vehicle that stands alone."""

from pathlib import Path

import numpy as np
import pytest
from synthetic_flight import AREA

from flightdyn.state import Kinematics
from mission.flight.serve.flight_logs import FlightLogs
from mission.log.inspection import info
from sitl.observer import VehicleEvent

_ZERO = np.zeros(3)
STILL = Kinematics(0, _ZERO, _ZERO, np.array([1.0, 0.0, 0.0, 0.0]), _ZERO)


def test_a_later_flight_is_as_long_as_it_was(tmp_path: Path) -> None:
    logs = FlightLogs(tmp_path, area=AREA)
    for t_s, text in ((2.0, "armed"), (9.5, "disarmed"), (32.0, "armed"), (49.5, "disarmed")):
        logs.happened(VehicleEvent(round(t_s * 1e9), "armed", text, STILL, STILL))
    for number, (start_s, end_s) in enumerate(((2.0, 9.5), (32.0, 49.5)), start=1):
        found = info(tmp_path / f"flight-{number:04d}.mcap")
        assert (found.start_s, found.end_s) == (start_s, end_s)
        hours = (end_s - start_s) / 3600.0
        assert found.megabytes_per_hour == pytest.approx(found.size_bytes / 1e6 / hours)
