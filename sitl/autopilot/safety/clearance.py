"""Whether a flight may begin, and where it may lead: by GNSS, fence and battery."""

from flightdyn.aircraft import Aircraft
from flightdyn.state import Vector
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.safety.battery import Charge
from sitl.autopilot.safety.fence import Geofence
from sitl.autopilot.safety.gnss import GnssWatch


class Clearance:
    """Answers `Permissions`. It knows nothing of the flight that asks."""

    def __init__(self, aircraft: Aircraft, parameters: Parameters) -> None:
        self.gnss = GnssWatch(aircraft, parameters)
        self.fence = Geofence(aircraft.frame, parameters)
        self.charge = Charge(aircraft, parameters)

    def position_ok(self) -> bool:
        """Whether the aircraft knows where it is."""
        return self.gnss.navigable()

    def forbidden(self, places_ned_m: Vector, *, home_ned_m: Vector) -> str:
        """What the fence has against places."""
        return self.fence.breach(places_ned_m, home_ned_m=home_ned_m)

    def arming_denied(self) -> str:
        """Why the motors must not be released; empty if they may."""
        if self.gnss.current() is None:
            return "no GNSS solution"
        return "battery critical" if self.charge.critical else ""
