"""The flight logs of a vehicle that stands alone."""

from pathlib import Path

import numpy as np
import pytest
from synthetic_flight import AREA

from flightdyn.state import BatteryState, Kinematics
from mission.base.errors import InputError
from mission.flight.serve.flight_logs import FlightLogs
from mission.log.inspection import info
from sitl.logfolder import LogFolder, next_log
from sitl.observer import VehicleEvent, VehicleSample

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


def test_the_clock_of_a_vehicle_that_starts_anew_goes_on_from_where_it_did(tmp_path: Path) -> None:
    logs, still = FlightLogs(tmp_path, area=AREA), BatteryState(22.0, 1.0, 0.0, 1.0)
    logs.began_ns = 60_000_000_000
    for t_s, text in ((2, "armed"), (9, "disarmed")):
        logs.sampled(VehicleSample(t_s * 10**9, STILL, STILL, None, still, "hold", armed=True))
        logs.happened(VehicleEvent(t_s * 10**9, "armed", text, STILL, STILL))
    found = info(tmp_path / "flight-0001.mcap")
    assert (found.start_s, found.end_s) == (62.0, 69.0)


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs /proc")
def test_a_folder_that_takes_no_files_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match=r"^--logs /proc/self: cannot be written to: [^\n]+$"):
        FlightLogs(Path("/proc/self"), area=AREA)


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "logs").touch()
    with pytest.raises(InputError, match=r"logs: is a file; give a folder$"):
        FlightLogs(tmp_path / "logs", area=AREA)


def test_a_link_to_nowhere_is_not_written_through(tmp_path: Path) -> None:
    (tmp_path / "flight-0001.mcap").symlink_to(tmp_path / "elsewhere")
    assert next_log(tmp_path).name == "flight-0002.mcap"


def test_the_newest_log_is_the_last_one_also_where_some_were_removed(tmp_path: Path) -> None:
    for number in (2, 9999, 10000):
        (tmp_path / f"flight-{number}.mcap".replace("-2", "-0002")).touch()
    assert [log.name[7:-5] for log in LogFolder(tmp_path).logs()] == ["0002", "9999", "10000"]
    assert next_log(tmp_path).name == "flight-10001.mcap"


def test_a_log_that_is_deleted_ends_and_the_flight_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    logs = FlightLogs(tmp_path, area=AREA)
    still = BatteryState(22.0, 1.0, 0.0, 1.0)

    def fly(start_s: int) -> None:
        logs.happened(VehicleEvent(start_s * 10**9, "armed", "armed", STILL, STILL))
        for t_s in range(start_s, start_s + 5):
            t_ns = t_s * 10**9
            logs.sampled(VehicleSample(t_ns, STILL, STILL, None, still, "hold", armed=True))
            if t_s == 2:
                (tmp_path / "flight-0001.mcap").unlink()
        logs.happened(VehicleEvent((start_s + 5) * 10**9, "armed", "disarmed", STILL, STILL))

    fly(0)
    (line,) = caplog.messages
    assert "flight-0001.mcap: deleted or moved" in line
    assert line.endswith("the rest of this flight is not recorded")
    fly(10)
    assert [path.name for path in tmp_path.iterdir()] == ["flight-0001.mcap"]
    assert info(tmp_path / "flight-0001.mcap").start_s == 10.0
    assert len(caplog.messages) == 1
