"""The simulated vehicle of a run or of a plan's flight."""

from flightdyn.errors import FlightInputError
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from mission.base.errors import InputError
from sitl.config import VehicleConfig
from sitl.errors import SitlInputError
from sitl.vehicle import Vehicle


def simulated_vehicle(
    config: VehicleConfig, *, home: GeodeticPoint, streams: RandomStreams
) -> Vehicle:
    """On the ground at `home`, and with nothing that goes by wall time.

    Raises:
        InputError: the vehicle's settings are refused.
    """
    try:
        vehicle = Vehicle(config, home=home, streams=streams)
    except (SitlInputError, FlightInputError) as error:
        raise InputError(str(error)) from None
    if (action := vehicle.autopilot.parameters["NAV_DLL_ACT"]) != 0:
        raise InputError(
            f"vehicle.parameters.NAV_DLL_ACT = {action:g}: this failsafe goes by wall time, so a "
            "flight would depend on the machine; here it must be 0 (aerofed sitl takes any)"
        )
    return vehicle
