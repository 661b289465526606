"""Logs of every kind, damaged at random: one line or a comparison, in bounded time and memory."""

import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from made_up_logs import write_dataflash, write_tlog, write_ulog
from patience import HANG_S
from synthetic_flight import fly

SCRIPT = Path(__file__).parents[1] / "flight" / "spoil_logs.py"
COUNT = 60  # of damaged logs, four kinds in turn; thousands by hand: `spoil_logs.py 0 5000 LOG...`
CPU_S = 200  # twenty times what they take: of processor time, which a busy machine does not alter
MEMORY_BYTES = 4 << 30  # of addresses; libraries alone take one


WRITE: dict[str, Callable[..., Path]] = {
    ".bin": write_dataflash,
    ".tlog": write_tlog,
    ".ulg": write_ulog,
}


def limited() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))


@pytest.mark.slow
def test_damage_ends_in_a_line_or_in_a_comparison(tmp_path: Path) -> None:
    logs = [fly(tmp_path, rounds=1).log]
    logs += [write(tmp_path / f"x{end}") for end, write in WRITE.items()]
    ended = subprocess.run(
        [sys.executable, str(SCRIPT), "0", str(COUNT), *map(str, logs)],
        capture_output=True, text=True, timeout=HANG_S, preexec_fn=limited,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
