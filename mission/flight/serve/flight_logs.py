"""Flight logs of a vehicle that stands alone: a file from each arming to the disarming after it."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile

from mission.base.area import Area
from mission.base.errors import InputError
from mission.base.user_files import or_input_error
from mission.flight.missions.mission_path import record_of
from mission.log.values import AUTOPILOT, NOBODY, SetpointRecord
from mission.log.writer import FlightLog
from sitl.autopilot.codec.orders import MissionItem
from sitl.autopilot.pilots.offboard import Setpoint, setpoint_of
from sitl.logfolder import next_log
from sitl.observer import VehicleEvent, VehicleSample

_LOGGER = logging.getLogger(__name__)


class FlightLogs:
    """Writes `flight-0001.mcap` and on into a folder, with the missions that were in force and
    every setpoint. A `VehicleObserver` and an `OrderObserver`; close it at the end.
    """

    def __init__(self, folder: Path, *, area: Area) -> None:
        """Make the folder where it is not there; files in it stay.

        Raises:
            InputError: it cannot be made or written to.
        """
        if folder.is_file():
            raise InputError(f"--logs {folder}: is a file; give a folder")
        with or_input_error(f"--logs {folder}", "cannot be written to"):
            folder.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=folder):
                pass
        self._folder = folder
        self._area = area
        self._log: FlightLog | None = None
        self._lists: dict[int, tuple[MissionItem, ...]] = {}
        self._autopilot: VehicleEvent | None = None  # what named it
        self.began_ns = 0  # when the clock of a vehicle that has started anew did, by the logs'
        self.being_written: Path | None = None
        self.written: list[Path] = []

    def sampled(self, sample: VehicleSample) -> None:
        with self._kept():
            if self._log is not None:
                self._log.sampled(sample._replace(t_ns=sample.t_ns + self.began_ns))

    def happened(self, event: VehicleEvent) -> None:
        with self._kept():
            self._happened(replace(event, t_ns=event.t_ns + self.began_ns))

    def took(self, t_ns: int, kind: int, items: tuple[MissionItem, ...]) -> None:
        self._lists[kind] = items
        with self._kept():
            if self._log is not None:
                self._log.mission(record_of(t_ns + self.began_ns, kind, items))

    def heard(self, t_ns: int, setpoint: Setpoint) -> None:
        with self._kept():
            if self._log is not None:
                self._log.setpoint(SetpointRecord(t_ns, *setpoint_of(setpoint)))

    def _happened(self, event: VehicleEvent) -> None:
        if event.text.startswith(AUTOPILOT):
            self._autopilot = event
        armed = event.kind == "armed" and event.text == "armed"
        if armed and self._log is None:
            self.being_written = next_log(self._folder)
            self._log = FlightLog(
                self.being_written, area=self._area, devices=NOBODY, start_ns=event.t_ns
            )
            if self._autopilot is not None:
                self._log.happened(replace(self._autopilot, t_ns=event.t_ns))
            for kind, items in self._lists.items():
                if items:
                    self._log.mission(record_of(event.t_ns, kind, items))
        if self._log is not None:
            self._log.happened(event)
        if event.kind == "armed" and not armed:
            self.close()

    @contextmanager
    def _kept(self) -> Iterator[None]:
        """Context manager: a full disk or a deleted file ends the log and not the flight."""
        try:
            yield
        except InputError as error:
            _LOGGER.warning("%s; the rest of this flight is not recorded", error)
            with suppress(InputError):
                self.close()
            self._log = self.being_written = None

    def close(self) -> None:
        """Complete the file that is being written."""
        if self._log is not None and self.being_written is not None:
            self._log.close()
            self.written.append(self.being_written)
        self._log = self.being_written = None
