"""Examples of the configuration page, by heading. Each is read as a configuration, see checks."""

EXAMPLES = {
    "mission": """
[mission]
strategy = "no_cov"
rounds = 20
steps = 8
path_budget_m = 600.0
""",
    "channel": """
# A channel of one's own: a preset, and what is different.
[channel]
preset = "suburban"
gate = "instantaneous"    # draw segment and shadowing for each packet
beta_los_db = -32.0
alpha_los = 2.1
sigma_los = 0.6
tx_power_db = 20.0
snr_threshold = 8.0
""",
    "communities[]": """
# Two communities: bundled data, two labels a device; files from --data-dir, unevenly spread.
[[communities]]
name = "digits"
task = "digits"
devices = 6
labels_per_device = 2

[[communities]]
name = "photos"
task = "cifar10"
devices = 10
partition = "dirichlet"
dirichlet_alpha = 0.3
network = "mcmahan"
""",
    "learning": """
[learning]
algorithm = "fedadam"
local_epochs = 2
server_learning_rate = 0.02
""",
    "vehicle": """
[vehicle]
parameters = { RTL_RETURN_ALT = 45.0, GF_MAX_HOR_DIST = 900.0 }
""",
    "vehicle.aircraft.wind": """
[vehicle.aircraft.wind]
speed_mps = 6.0
from_deg = 270.0
turbulence_severity = 3
""",
    "vehicle.aircraft.wind.gusts[]": """
[[vehicle.aircraft.wind.gusts]]
start_s = 30.0
duration_s = 4.0
north_mps = 8.0

[[vehicle.aircraft.wind.gusts]]
start_s = 55.0
east_mps = -6.0
down_mps = 2.0
""",
    'vehicle.aircraft.faults[] kind = "gnss_off"': """
# The receiver gives nothing from 40 s to 50 s.
[[vehicle.aircraft.faults]]
kind = "gnss_off"
at_s = 40.0
duration_s = 10.0
""",
    'vehicle.aircraft.faults[] kind = "gnss_jump"': """
# From 40 s on, positions are 50 m too far north.
[[vehicle.aircraft.faults]]
kind = "gnss_jump"
at_s = 40.0
north_m = 50.0
""",
    'vehicle.aircraft.faults[] kind = "motor_loss"': """
# The rear left motor gives nine tenths of what is ordered.
[[vehicle.aircraft.faults]]
kind = "motor_loss"
at_s = 40.0
motor = 1
share = 0.9
""",
    'vehicle.aircraft.faults[] kind = "imu_bias"': """
[[vehicle.aircraft.faults]]
kind = "imu_bias"
at_s = 40.0
duration_s = 30.0
gyro_radps = [0.02, 0.0, 0.0]
accel_mps2 = [0.0, 0.0, 0.3]
""",
    'vehicle.aircraft.faults[] kind = "wind_burst"': """
[[vehicle.aircraft.faults]]
kind = "wind_burst"
at_s = 40.0
duration_s = 3.0
east_mps = 9.0
""",
    'vehicle.aircraft.faults[] kind = "link_off"': """
[[vehicle.aircraft.faults]]
kind = "link_off"
after = "take-off"
at_s = 20.0
duration_s = 15.0
""",
    "link": """
# Watched by QGroundControl on this machine, in real time.
[link]
gcs = ["udpout://127.0.0.1:14550"]
speed = 1
""",
}
