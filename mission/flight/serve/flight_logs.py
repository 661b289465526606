"""Flight logs of a vehicle that stands alone: a file from each arming to the disarming after it."""

import logging
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from mission.base.area import Area
from mission.base.errors import InputError
from mission.log.values import Devices
from mission.log.writer import FlightLog
from sitl.logfolder import next_log
from sitl.observer import VehicleEvent, VehicleSample

_LOGGER = logging.getLogger(__name__)
_NOBODY = Devices(np.zeros((0, 2)), ())


class FlightLogs:
    """Writes `flight-0001.mcap` and on into a folder. A `VehicleObserver`; close it at the end."""

    def __init__(self, folder: Path, *, area: Area) -> None:
        """Make the folder where it is not there; files in it stay.

        Raises:
            InputError: it cannot be made or written to.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise InputError(
                f"--logs {folder}: cannot be written to: {error.strerror or error}"
            ) from None
        self._folder = folder
        self._area = area
        self._log: FlightLog | None = None
        self.being_written: Path | None = None

    def sampled(self, sample: VehicleSample) -> None:
        if self._log is not None:
            try:
                self._log.sampled(sample)
            except InputError as error:
                self._give_up(error)

    def happened(self, event: VehicleEvent) -> None:
        try:
            self._happened(event)
        except InputError as error:
            self._give_up(error)

    def _happened(self, event: VehicleEvent) -> None:
        armed = event.kind == "armed" and event.text == "armed"
        if armed and self._log is None:
            self.being_written = next_log(self._folder)
            self._log = FlightLog(
                self.being_written, area=self._area, devices=_NOBODY, start_ns=event.t_ns
            )
        if self._log is not None:
            self._log.happened(event)
        if event.kind == "armed" and not armed:
            self.close()

    def _give_up(self, error: InputError) -> None:
        """A full disk, or a file that somebody deletes, ends the log and not the flight."""
        _LOGGER.warning("%s; the rest of this flight is not recorded", error)
        with suppress(InputError):
            self.close()
        self._log = self.being_written = None

    def close(self) -> None:
        """Complete the file that is being written."""
        if self._log is not None:
            self._log.close()
        self._log = self.being_written = None
