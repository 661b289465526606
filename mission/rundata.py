"""A run read back: from its folder, or from its log alone."""

from dataclasses import replace
from pathlib import Path

from mission.errors import InputError
from mission.log.reader import read_log
from mission.log.values import FlightData, Track
from mission.plancompare import is_plan_flight
from mission.records import RoundRecord
from mission.tables import read_rounds, read_uplinks

LOG_NAME = "flight.mcap"


def load_run(path: Path) -> FlightData:
    """A run's folder (`rounds.csv`, `uplinks.csv`, `flight.mcap`) or a log file by itself.

    Raises:
        InputError: neither; a part of the folder is missing; a part is damaged.
    """
    if path.is_file():
        return read_log(path)
    if not path.is_dir():
        raise InputError(f"{path}: no such run folder or log file")
    log = path / LOG_NAME
    if not log.is_file():
        raise InputError(f"{path}: not a run folder: it has no {LOG_NAME}")
    if is_plan_flight(path):
        raise InputError(
            f"{path}: the folder of an aerofed fly, without rounds; see aerofed compare {path}"
        )
    return replace(
        read_log(log),
        rounds=read_rounds(path / "rounds.csv"),
        uplinks=read_uplinks(path / "uplinks.csv"),
    )


def flown(run: FlightData, record: RoundRecord, *, track: Track | None = None) -> Track:
    """The part of the true track (or of `track`) that belongs to a round."""
    start_ns = round(record.start_t_s * 1e9)
    end_ns = round((record.start_t_s + record.duration_s) * 1e9)
    return (track or run.truth).between(start_ns, end_ns)
