"""`aerofed report`."""

from pathlib import Path

from mission.base.console import PLAIN, Terminal
from mission.commands.options import Offsets, given_offsets


def report(
    run: Path,
    *others: Path,
    plan: Path | None = None,
    offset: Offsets = (),
    out: Path | None = None,
) -> int:
    """Write the report of a run, a flight or a sweep: one HTML file that needs nothing else.

    Example: aerofed report paper6
    Example: aerofed report paper-sweep
    Example: aerofed report a.ulg b.ulg --out both.html

    Args:
        run: A run's folder, a sweep's folder, or a flight log (.mcap, .ulg, .bin, .tlog); or a
            folder of flights of one world, or of one time and place.
        others: More logs of the same time and place: one page of all of them together.
        plan: A .plan or waypoint file to compare a flight with. Default: the mission in its log.
        offset: LOG=SECONDS to add to the times of a log, as of `aerofed compare`.
        out: The HTML file. Default: report.html in the folder, or beside a log, under its name; of
            several flights together.html.
    """
    if (run / "sweep.json").is_file():
        from mission.report.sweep_page import write_sweep_report

        path = write_sweep_report(run, out or run / "report.html")
    else:
        from mission.report.page import write_report

        path = write_report(run, out, plan, others=others, offsets=given_offsets(offset))
    Terminal(**PLAIN).print(path)
    return 0
