"""Follow-me mode: the vehicle keeps its place relative to the positions of FOLLOW_TARGET."""

import math

from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import Triple, wrap_pi
from flightdyn.guidance.pursuit import Target
from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import Handlers, Peer
from sitl.autopilot.codec.units import from_deg_e7
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying.modes import Trigger
from sitl.autopilot.pilots.stream import Cockpit

_KEPT_S = 3.0  # wall time for which a silent target is extrapolated
_COURSE_MPS = 1.0  # slower than that a target has no course; its last one counts
_LOWEST_M = 2.0  # above home: a target's own altitude may be anything
_PERIOD_S = 0.1


class Follower:
    """Takes the target's positions, and flies beside it in the mode FOLLOW."""

    def __init__(self, cockpit: Cockpit) -> None:
        self._aircraft, self._flight = cockpit.aircraft, cockpit.flight
        self._parameters, self._cockpit = cockpit.parameters, cockpit
        self._heard_at = -math.inf
        self._pos: Triple = (0.0, 0.0, 0.0)
        self._vel: Triple = (0.0, 0.0, 0.0)
        self._course_rad = 0.0
        self.handlers: Handlers = {mav.MAVLink_follow_target_message: self._receive}

    def _receive(self, _peer: Peer, msg: mav.MAVLink_follow_target_message, _now: float) -> None:
        """Take a position of the target; an impossible one is dropped."""
        lat_deg, lon_deg = from_deg_e7(msg.lat), from_deg_e7(msg.lon)
        vx, vy, vz = (0.0 if math.isnan(part) else part for part in msg.vel)
        possible = (
            lat_deg in ranges.LATITUDE
            and lon_deg in ranges.LONGITUDE
            and msg.alt in ranges.ALTITUDE
            and all(part in ranges.VELOCITY for part in (vx, vy, vz))
        )
        if not possible:
            return
        x, y, z = map(float, self._flight.frame.to_ned(lat_deg, lon_deg, msg.alt))
        if math.hypot(x, y, z) not in ranges.AWAY:
            return
        self._heard_at = self._cockpit.now
        self._pos, self._vel = (x, y, z), (vx, vy, vz)
        if math.hypot(vx, vy) > _COURSE_MPS:
            turn = wrap_pi(math.atan2(vy, vx) - self._course_rad)
            self._course_rad += (1 - self._parameters["FLW_TGT_RS"]) * turn

    def enter(self) -> str | None:
        """Follow from now on, or stay without a target; return the reason if that cannot be."""
        return self._flight.order(Trigger.ORDER_FOLLOW, self._piloted)

    def _piloted(self) -> do.Manoeuvre:
        return do.Piloted(
            self._aircraft,
            self._fly,
            every_s=_PERIOD_S,
            settle_s=self._parameters["COM_DISARM_LAND"],
        )

    def _fly(self) -> None:
        age_s = self._cockpit.now - self._heard_at
        if age_s > _KEPT_S:
            self._aircraft.pursue(Target())  # brakes and stays
            return
        p = self._parameters
        x, y, z = (self._pos[i] + self._vel[i] * age_s for i in range(3))
        beside = self._course_rad + math.radians(p["FLW_TGT_FA"])
        distance = p["FLW_TGT_DST"]
        by_target = int(p["FLW_TGT_ALT_M"]) == 2
        home_down = float(self._flight.guard.home_ned_m[2])
        floor = z if by_target else home_down
        place = (
            x + distance * math.cos(beside),
            y + distance * math.sin(beside),
            min(floor - p["FLW_TGT_HT"], home_down - _LOWEST_M),
        )
        limits = self._flight.navigator.speed_limits
        own_mps = math.hypot(self._vel[0], self._vel[1])
        here = self._aircraft.belief.pos_ned_m
        self._aircraft.pursue(
            Target(
                pos=place,
                vel=(self._vel[0], self._vel[1], self._vel[2] if by_target else 0.0),
                yaw=math.atan2(y - here[1], x - here[0]),
                speed_mps=min(limits.speed_mps, own_mps + p["FLW_TGT_MAX_VEL"]),
                climb_mps=limits.climb_mps,
                descent_mps=limits.descent_mps,
            )
        )
