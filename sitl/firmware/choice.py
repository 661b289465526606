"""Which firmware: what differs between them before one is started."""

from flightdyn.plant import Plant
from sitl.config import VehicleConfig
from sitl.firmware.ardupilot import LOOPS_HZ, slowest_rate_hz
from sitl.firmware.ardupilot_start import ardupilot_launch, check_arducopter
from sitl.firmware.launch import Launch, Order
from sitl.firmware.px4_start import etc_of, px4_launch


def plant_rate_hz(vehicle: VehicleConfig) -> int:
    """Ticks a second in which the firmware has the plant stepped."""
    if vehicle.autopilot == "ardupilot":
        loops_hz = vehicle.firmware.parameters.get("SCHED_LOOP_RATE", LOOPS_HZ)
        return max(vehicle.aircraft.physics_hz, slowest_rate_hz(loops_hz))
    return vehicle.aircraft.physics_hz


def check_firmware(vehicle: VehicleConfig) -> None:
    """Refuse a binary that is not the firmware asked for, as far as it shows before it runs.

    Raises:
        FirmwareSilentError: says what it is.
    """
    path = vehicle.firmware.path
    assert path is not None
    if vehicle.autopilot == "px4":
        etc_of(path)
    else:
        check_arducopter(path)


def prepare(order: Order, plant: Plant) -> Launch:
    """Open the bridge and put together how the firmware is started.

    Raises:
        LinkError: no port can be had.
        FirmwareSilentError: the binary, or what belongs to it, is not there.
    """
    if order.vehicle.autopilot == "px4":
        return px4_launch(order, plant)
    return ardupilot_launch(order, plant)
