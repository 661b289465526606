"""The `aerofed` command, also as `python -m mission`."""

import gc
import os
import sys


def main() -> None:
    """Run the `aerofed` command; an interruption while it still loads gives no traceback either."""
    # Some 300,000 objects live as long as the program. Looking through them again and again for
    # garbage, as Python's defaults have it, took a twentieth of a short run.
    gc.set_threshold(20_000, 20, 50)
    # NumPy and SciPy would each start a thread a core; no matrix here is large enough to share.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from mission.cli import main as run

        run()
    except KeyboardInterrupt:
        # Not at the top: loading these can be interrupted, too.
        from mission.base.errors import INTERRUPTED
        from mission.base.interrupts import prepare_exit

        prepare_exit(INTERRUPTED)
        sys.stderr.write("aerofed: interrupted\n")
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
