"""ArduPilot's own autotests of Copter, unchanged, on the aircraft of `aerofed world --ardupilot`.

    python benchmarks/ardupilot_autotests.py ARDUPILOT [TEST ...] [--binary PATH] [--wind 8]

ARDUPILOT is a working tree of the binary's version; its Tools/autotest asks for `pip install
MAVProxy pexpect`. Only the aircraft is another, with parameters for its motors. A test's name is
that of its method. Prints a line a test; the exit code is 1 where one fails. The tests wait in
simulated time and look in wall time: on a busy machine some fail at too high a --speed.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stdout
from pathlib import Path

from sitl.firmware.launch import HOVER_THRUST, THRUST_CURVE

# None of these asks anything of ArduPilot's own simulated aircraft.
TESTS = [
    "ModeAltHold", "ModeLoiter", "CopterMission", "ModeCircle", "BrakeMode", "SimpleMode",
    "LoiterToAlt", "SplineLastWaypoint", "TakeoffAlt", "RTLSpeed", "HorizontalFence", "MaxAltFence",
    "ModeFlip", "StabilityPatch", "MAV_CMD_CONDITION_YAW", "ModeZigZag", "SetpointGlobalPos",
    "SetpointGlobalVel", "GPSGlitchLoiter", "AutoTune",
]  # fmt: skip
MOTORS = {"MOT_THST_EXPO": THRUST_CURVE, "MOT_THST_HOVER": HOVER_THRUST}  # of the aircraft


def main() -> int:
    """Fly the tests; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tree", type=Path)
    parser.add_argument("tests", nargs="*", default=TESTS)
    parser.add_argument("--binary", type=Path, help="default: the tree's build/sitl/bin/arducopter")
    parser.add_argument("--wind", type=float, default=0.0, help="m/s")
    parser.add_argument("--speed", type=float, default=3.0, help="times real time, at most")
    given = parser.parse_intermixed_args()  # tests may follow options
    binary = (given.binary or given.tree / "build/sitl/bin/arducopter").resolve()
    sys.path[:0] = [str((given.tree / "Tools/autotest").resolve())]
    with redirect_stdout(sys.stderr):  # which its consoles keep to
        import arducopter

    class OnOurs(arducopter.AutoTestCopter):
        def start_SITL(self, binary=None, **how):  # noqa: N802
            ours = {"model": "JSON:127.0.0.1", "sim_rate_hz": 800, "param_defaults": MOTORS}
            super().start_SITL(binary, **{**how, **ours})

    if unknown := [name for name in given.tests if not hasattr(OnOurs, name)]:
        parser.error(f"no such test: {', '.join(unknown)}")
    home = arducopter.SITL_START_LOCATION
    world = subprocess.Popen([
        sys.executable, "-m", "mission", "world", "--ardupilot", "--wind", str(given.wind),
        "--speed", str(given.speed), "--set", f"area.home_lat_deg={home.lat}",
        f"area.home_lon_deg={home.lng}", f"area.home_alt_msl_m={home.alt}",
            f"vehicle.aircraft.heading_deg={home.heading}",
    ], stdout=subprocess.PIPE)  # fmt: skip
    failed = 0
    try:
        assert world.stdout is not None
        world.stdout.readline()  # it is there: the tests wait for a first heartbeat in wall time
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            os.environ["BUILDLOGS"] = folder
            for name in given.tests:
                began_s = time.monotonic()
                suite = OnOurs(str(binary), frame="X", logs_dir=folder, speedup=1)
                with Path(folder, f"{name}.txt").open("w") as said, redirect_stdout(said):
                    passed = suite.autotest([getattr(suite, name)])
                failed += not passed
                word = "passed" if passed else "FAILED"
                print(f"{name}: {word} ({time.monotonic() - began_s:.0f} s)", flush=True)
                for line in Path(folder, f"{name}.txt").read_text().splitlines():
                    if "FAILED: " in line:
                        print(f"  {line}")
    finally:
        world.terminate()
        world.wait()
    print(f"{len(given.tests) - failed} of {len(given.tests)} passed")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
