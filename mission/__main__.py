"""The `aerofed` command, also as `python -m mission`."""

import sys

from mission.errors import INTERRUPTED


def main() -> None:
    """Entry point; an interruption while the program is still loading is no traceback either."""
    try:
        from mission.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("aerofed: interrupted\n")
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
