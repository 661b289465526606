"""`aerofed report`."""

from pathlib import Path

from mission.base.terminal import PLAIN, Terminal


def report(run: Path, *, out: Path | None = None) -> int:
    """Write the report of a run or a sweep: one HTML file that needs nothing else.

    Example: aerofed report paper6
    Example: aerofed report paper-sweep

    Parameters
    ----------
    run
        A run's folder, a sweep's folder, or a flight log (.mcap).
    out
        The HTML file. Default: report.html in the folder, or beside the log.
    """
    if (run / "sweep.json").is_file():
        from mission.report.sweep_page import write_sweep_report

        path = write_sweep_report(run, out or run / "report.html")
    else:
        from mission.report.page import write_report

        path = write_report(run, out)
    Terminal(**PLAIN).print(path)
    return 0
