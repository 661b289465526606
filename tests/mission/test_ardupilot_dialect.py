"""The experiment in ArduPilot's dialect, towards a stand-in that insists on it."""

import math
from pathlib import Path

from ardupilot_double import RTL, ArduPilotDouble
from serving import free_port
from test_external import SMALL, rows

from mission.cli import call


def test_two_rounds_in_ardupilot_s_dialect(tmp_path: Path) -> None:
    port, out = free_port(), tmp_path / "out"
    double = ArduPilotDouble(port, lat=43.6145, lon=7.0715)
    double.start()
    try:
        url = f"udpin://127.0.0.1:{port}"
        assert call(["run", "--vehicle", url, "--out", str(out), "--rounds", "2", *SMALL]) == 0
    finally:
        double.stop()
    assert (double.uploads, double.refusals) == (2, [])
    assert (double.mode, double.armed, double.flown) == (RTL, False, True)
    rounds, uplinks = rows(out / "rounds.csv"), rows(out / "uplinks.csv")
    for row in rounds:
        plan_m = float(row["plan_path_m"])
        assert abs(float(row["flown_path_m"]) - plan_m) < 0.03 * plan_m + 2
    for uplink in uplinks:
        assert math.isfinite(float(uplink["slot_t_s"]))
        x, y = (float(uplink[f"true_{axis}_m"]) - float(uplink[f"plan_{axis}_m"]) for axis in "xy")
        assert math.hypot(x, y) < 2.0
