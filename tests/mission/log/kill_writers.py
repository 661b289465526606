"""Forks writers of a log and kills each after a random sample; prints what each had been handed.

Run by `test_recover`; a process of its own, so that the fork copies no threads of the tests. The
moment is counted in samples, of which the pipe holds a few ahead, and not in seconds: however busy
the machine is, some are killed early and some late.
"""

import os
import signal
import struct
import sys
from pathlib import Path

import numpy as np
from synthetic_flight import fly_anew

from mission.log.writer import FlightLog
from sitl.observer import VehicleSample


def report_to(pipe: int) -> None:
    """Say, outside the process, up to which instant a log has been handed samples."""
    sampled = FlightLog.sampled

    def reporting(log: FlightLog, sample: VehicleSample) -> None:
        sampled(log, sample)
        os.write(pipe, struct.pack("<q", sample.t_ns))

    setattr(FlightLog, "sampled", reporting)  # noqa: B010


def main(folder: Path, kills: int, samples: int) -> None:
    rng = np.random.default_rng(int.from_bytes(os.urandom(4), "little"))
    for number in range(kills):
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            report_to(writing)
            place = folder / f"{number}"
            place.mkdir()
            fly_anew(place, rounds=2)
            signal.pause()  # finished before it was killed: the log is complete
        os.close(writing)
        after = int(rng.integers(samples))
        newest = -1
        for _ in range(after):
            (newest,) = struct.unpack("<q", os.read(reading, 8))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        while chunk := os.read(reading, 8 * 4096):
            newest = struct.unpack_from("<q", chunk, len(chunk) - 8)[0]
        os.close(reading)
        log = folder / f"{number}" / "flight.mcap"
        if log.exists():
            log.rename(folder / f"{number}.mcap")
        else:
            (folder / f"{number}.mcap").write_bytes(b"")
        sys.stdout.write(f"{number} {newest}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
