"""`aerofed report`."""

from pathlib import Path

from rich.console import Console


def report(run: Path, *, out: Path | None = None) -> int:
    """Write a run's report: one HTML file with maps, errors, radio and learning.

    Example: aerofed report paper6

    Parameters
    ----------
    run
        A run's folder, or a flight log (.mcap).
    out
        The HTML file. Default: report.html in the folder, or beside the log.
    """
    from mission.report.page import write_report

    path = write_report(run, out)
    Console(highlight=False, markup=False, soft_wrap=True).print(path)
    return 0
