"""Help of the commands that are imported only when they are called: a line and an example."""

INIT = """Write a configuration of your own, with comments, to begin from.

Example: aerofed init
Example: aerofed init paper --out my-paper"""

RUN = """Fly the rounds of a configuration: plan, fly, gate, learn; and leave a folder.

Example: aerofed run paper --data-dir data --rounds 6 --out paper6
Example: aerofed run --gcs udpout://127.0.0.1:14550 --set link.speed=1
Example: aerofed run my.toml --vehicle udpin://0.0.0.0:14540"""

COMPARE = """Planned against flown, in numbers: cross-track error, timing, packet error rates.

Example: aerofed compare paper6
Example: aerofed compare cov no_cov --figure both.png"""

REPORT = """One HTML page with maps, errors and curves, to send to a colleague.

Example: aerofed report paper6
Example: aerofed report paper-sweep"""

PLAN = """Plan rounds without flying them: path, schedule, value and a bound that none can exceed.

Example: aerofed plan --problem problems.json --out plans.json --figure pictures"""

LINK_BUDGET = """Who can be reached from where: packet error rate over distance.

Example: aerofed link-budget paper --set channel.extra_gain_db=3"""

LOG = """Look into flight logs, mend and export them.

Example: aerofed log info paper6/flight.mcap"""

LOG_INFO = """What is in a log: channels, counts, schemas, times.

Example: aerofed log info paper6/flight.mcap"""

LOG_CHECK = """Whether a log is whole and sound.

Example: aerofed log check paper6/flight.mcap"""

LOG_RECOVER = """Make the log of a killed run readable again.

Example: aerofed log recover killed/flight.mcap"""

LOG_EXPORT = """Export a log to CSV, Parquet or KML, or take out the files inside it.

Example: aerofed log export paper6/flight.mcap --to csv"""

LOG_DIFF = """Where two logs differ.

Example: aerofed log diff a/flight.mcap b/flight.mcap"""

SITL = """Serve the simulated vehicle to ground stations until Ctrl-C.

QGroundControl finds it on port 14550, a MAVSDK program on udpin://0.0.0.0:14540. After a crash, a
reboot ordered by the ground station puts it back home as new.

Example: aerofed sitl --udp 14540 --udp 14550 --speed 1"""

WORLD = """Serve the aircraft alone to a PX4 or ArduPilot that you start yourself, until Ctrl-C.

Physics, sensors, battery, wind and faults are ours, the autopilot is the real firmware. When the
firmware ends or starts anew, the aircraft stands at home again.

Example: aerofed world --px4 --set vehicle.aircraft.wind.speed_mps=8"""

FLY = """Fly a QGroundControl plan or a waypoint file, planned against flown.

Example: aerofed fly survey.plan --out survey"""

SWEEP = """Fly many runs side by side: strategies x seeds x settings, with tables and figures.

An interrupted sweep goes on when the same command is given again.

Example: aerofed sweep paper --data-dir data --seeds 3 --set learning.mu=0,0.1"""

DATA = """Fetch the data sets from where they are published, and check a folder.

Example: aerofed data fetch data"""

DATA_FETCH = """Download data sets; a file is kept if its checksum is right.

Example: aerofed data fetch data --task mnist cifar10"""

DATA_CHECK = """Read every data set in a folder as a run would, and say what was found.

Example: aerofed data check data"""

COMPLETION = """Print what makes a shell complete commands and options on Tab.

Example: aerofed completion bash > ~/.local/share/bash-completion/completions/aerofed"""
