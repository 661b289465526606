"""Runs one program and ends it, with all that it started, when the supervisor's own parent is gone.

Started as a file by `sitl.firmware.launch`, with nothing but the standard library: standard
input is a pipe that the parent holds, and it ends however the parent ends, killed or not.
"""

import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress

GRACE_S = 3.0


def main(processor: str, argv: list[str]) -> int:
    """Run `argv`, on `processor` if one is named; return its exit code, or 128 + signal."""
    if processor:
        os.sched_setaffinity(0, {int(processor)})
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # meant for the parent, whose end ends this too
    program = subprocess.Popen(argv, stdin=subprocess.DEVNULL, start_new_session=True)

    def end_with_parent() -> None:
        while os.read(0, 64):
            pass
        for number in (signal.SIGTERM, signal.SIGKILL):
            try:
                os.killpg(program.pid, number)
                program.wait(GRACE_S)
            except (ProcessLookupError, subprocess.TimeoutExpired):
                continue

    watcher = threading.Thread(target=end_with_parent, daemon=True)
    watcher.start()
    code = program.wait()
    with suppress(ProcessLookupError):
        os.killpg(program.pid, signal.SIGKILL)  # whatever it has left behind
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
