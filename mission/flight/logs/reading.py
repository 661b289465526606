"""Reads the flight log of another program, of whichever kind it is."""

from pathlib import Path

from mission.base.errors import InputError
from mission.log import SPOILT
from mission.log.values import FlightData


def read_flight(path: Path) -> FlightData:
    """A flight of a PX4 ULog (.ulg), an ArduPilot DataFlash log (.bin) or a telemetry log (.tlog).

    Raises:
        InputError: it cannot be read, is none, or holds no flight.
    """
    kind = path.suffix.lower()
    if not path.stat().st_size:
        raise InputError(f"{path}: the file is empty")
    try:  # pymavlink takes 90 ms, which nobody waits for who has a log of ours
        if kind == ".ulg":
            from mission.flight.logs.ulog import read_ulog as read
        elif kind == ".bin":
            from mission.flight.logs.dataflash import read_dataflash as read
        else:
            from mission.flight.logs.tlog import read_tlog as read
        return read(path)
    except SPOILT as error:
        what = " ".join(str(error).split())[:100]
        raise InputError(
            f"{path}: cannot be read as a {kind} flight log: damaged, cut off, "
            f"or of another kind ({type(error).__name__}: {what})"
        ) from None
