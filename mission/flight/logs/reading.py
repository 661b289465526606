"""Reads the flight log of another program, of whichever kind it is."""

from pathlib import Path

from mission.flight.logs.flight import told_damage
from mission.log.values import FlightData


def read_flight(path: Path) -> FlightData:
    """A flight of a PX4 ULog (.ulg), an ArduPilot DataFlash log (.bin) or a telemetry log (.tlog).

    Raises:
        InputError: it cannot be read, is none, or holds no flight of a multicopter.
    """
    with told_damage(path):
        if path.suffix.lower() == ".ulg":
            from mission.flight.logs.ulog import read_ulog

            return read_ulog(path)
        if path.suffix.lower() == ".bin":
            from mission.flight.logs.dataflash import read_dataflash

            return read_dataflash(path)
        from mission.flight.logs.tlog import read_tlog

        return read_tlog(path)
