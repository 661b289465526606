"""Help of the commands that are imported only when they are called: a line and an example."""

SITL = """Serve the simulated vehicle to ground stations until Ctrl-C.

QGroundControl finds it on port 14550, a MAVSDK program on udpin://0.0.0.0:14540.

Example: aerofed sitl --udp 14540 --udp 14550 --speed 1"""

FLY = """Fly a QGroundControl plan or a waypoint file, planned against flown.

Example: aerofed fly survey.plan --out survey"""
