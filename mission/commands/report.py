"""`aerofed report`."""

from pathlib import Path

from mission.base.terminal import PLAIN, Terminal


def report(run: Path, *, plan: Path | None = None, out: Path | None = None) -> int:
    """Write the report of a run, a flight or a sweep: one HTML file that needs nothing else.

    Example: aerofed report paper6
    Example: aerofed report paper-sweep

    Parameters
    ----------
    run
        A run's folder, a sweep's folder, or a flight log (.mcap, .ulg, .bin, .tlog).
    plan
        A .plan or waypoint file to compare a flight with. Default: the mission in its log.
    out
        The HTML file. Default: report.html in the folder, or beside a log, under its name.
    """
    if (run / "sweep.json").is_file():
        from mission.report.sweep_page import write_sweep_report

        path = write_sweep_report(run, out or run / "report.html")
    else:
        from mission.report.page import write_report

        path = write_report(run, out, plan)
    Terminal(**PLAIN).print(path)
    return 0
