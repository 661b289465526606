"""Offboard control: a program outside streams setpoints, and the vehicle goes after them.

The rules are PX4's: the mode is granted while setpoints stream in, and their loss is a failsafe
(COM_OF_LOSS_T, COM_OBL_RC_ACT). What a type mask or NaN leaves out is not controlled.
"""

import math
from typing import TypeAlias

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import Triple, yaw_of
from flightdyn.guidance.control import AttitudeOrder
from flightdyn.guidance.pursuit import Target
from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import GLOBAL_FRAMES, RELATIVE_FRAMES, Handlers, Peer
from sitl.autopilot.codec.units import from_deg_e7
from sitl.autopilot.failsafe import Cause
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying.modes import Mode, Need, Trigger
from sitl.autopilot.pilots.stream import Cockpit, StreamPilot

_LocalTarget: TypeAlias = mav.MAVLink_set_position_target_local_ned_message
_GlobalTarget: TypeAlias = mav.MAVLink_set_position_target_global_int_message
_AttitudeTarget: TypeAlias = mav.MAVLink_set_attitude_target_message
Setpoint: TypeAlias = _LocalTarget | _GlobalTarget | _AttitudeTarget
# Bits of the type masks of positions and attitudes that say what to ignore.
_POSITION, _VELOCITY, _ACCELERATION = 0, 3, 6  # the first of three
_FORCE, _YAW, _YAW_RATE = 1 << 9, 1 << 10, 1 << 11
_NO_THRUST, _NO_ATTITUDE, _UNKNOWN_BITS = 1 << 6, 1 << 7, 0b111000
_KNOWN_BITS = 12


class _InvalidError(Exception):
    """A setpoint that cannot be flown; says why."""


class Offboard(StreamPilot):
    """Takes setpoints, and flies by them in the mode OFFBOARD."""

    _MODES = frozenset({Mode.OFFBOARD})
    _CAUSE, _PATIENCE = Cause.SETPOINTS_LOST, "COM_OF_LOSS_T"

    def __init__(self, cockpit: Cockpit) -> None:
        super().__init__(cockpit)
        self._report = cockpit.reporter
        self._order: Target | AttitudeOrder = Target()
        self._complaint = ""
        self._flight.needs[Need.SETPOINTS] = self._flyable
        self.handlers: Handlers = {
            _LocalTarget: self._receive,
            _GlobalTarget: self._receive,
            _AttitudeTarget: self._receive,
        }

    def _receive(self, _peer: Peer, msg: Setpoint, _now: float) -> None:
        try:
            if isinstance(msg, _AttitudeTarget):
                self._order = _attitude_order(msg)
            else:
                self._order = self._target(msg)
        except _InvalidError as error:
            self._complain(f"Setpoint refused: {error}")
            return
        self._complaint = ""
        self._heard()
        if self._flies:
            self._fly()

    def enter(self) -> str | None:
        """Fly by setpoints from now on; return the reason if that cannot be."""
        return self._flight.order(Trigger.ORDER_OFFBOARD, self._piloted)

    def _flyable(self) -> bool:
        placed = isinstance(self._order, AttitudeOrder) or self._flight.guard.position_ok()
        return self._alive and placed

    def _piloted(self) -> do.Manoeuvre:
        self._fly()
        return do.Piloted(self._aircraft, settle_s=self._parameters["COM_DISARM_LAND"])

    def _fly(self) -> None:
        if isinstance(self._order, Target):
            self._aircraft.pursue(self._order)
        else:
            self._aircraft.keep_attitude(self._order)

    def _complain(self, text: str) -> None:
        """Say what is wrong with a stream of setpoints, once as long as it is the same."""
        if text != self._complaint:
            self._complaint = text
            self._report.say(text, mav.MAV_SEVERITY_ERROR)

    def _target(self, msg: _LocalTarget | _GlobalTarget) -> Target:
        mask, frame = msg.type_mask, msg.coordinate_frame
        if mask & _FORCE or mask >> _KNOWN_BITS:
            raise _InvalidError(f"type mask {mask:#x}: force and bits beyond 11 are not supported")
        place = _place_of(msg)
        globe = (ranges.LATITUDE, ranges.LONGITUDE, ranges.ALTITUDE)
        allowed = globe if frame in GLOBAL_FRAMES else (ranges.AWAY,)
        pos = _three("position", place, mask >> _POSITION, *allowed)
        vel = _three("velocity", (msg.vx, msg.vy, msg.vz), mask >> _VELOCITY, ranges.VELOCITY)
        force = (msg.afx, msg.afy, msg.afz)
        acc = _three("acceleration", force, mask >> _ACCELERATION, ranges.ACCELERATION)
        yaw = _number("yaw", msg.yaw, mask & _YAW, ranges.HEADING)
        yaw_rate = _number("yaw rate", msg.yaw_rate, mask & _YAW_RATE, ranges.SPIN)
        if frame in GLOBAL_FRAMES:
            pos = self._local(pos, frame)
        elif frame == mav.MAV_FRAME_BODY_NED:
            if not all(map(math.isnan, pos)):
                raise _InvalidError("frame 8 takes no position: set bits 0 to 2 of the type mask")
            nose = yaw_of(self._aircraft.belief.q_frd_to_ned)
            vel, acc = _turned(vel, nose), _turned(acc, nose)
        elif frame != mav.MAV_FRAME_LOCAL_NED:
            raise _InvalidError(f"frame {frame}; 0, 1, 3, 5, 6 and 8 are supported")
        if all(map(math.isnan, (*pos, *vel, *acc))):
            raise _InvalidError("neither position nor velocity nor acceleration")
        return Target(pos, vel, acc, yaw, yaw_rate, *self._flight.navigator.speed_limits)

    def _local(self, place: Triple, frame: int) -> Triple:
        """The position of a setpoint, (3,) NED; a height without a place stays one, and a place
        without a height. Raises _InvalidError for half a place, or one too far away."""
        lat_deg, lon_deg, altitude = place
        if math.isnan(lat_deg) != math.isnan(lon_deg):
            raise _InvalidError("latitude and longitude belong together")
        local = self._flight.frame
        if frame in RELATIVE_FRAMES:
            altitude += self._flight.guard.home.alt_msl_m
        down = local.origin.alt_msl_m - altitude
        if math.isnan(lat_deg):
            return math.nan, math.nan, down
        height = local.origin.alt_msl_m if math.isnan(altitude) else altitude
        north, east, z = map(float, local.to_ned(lat_deg, lon_deg, height))
        if (away_m := math.hypot(north, east, z)) not in ranges.AWAY:
            raise _InvalidError(f"position {away_m / 1000:.0f} km away")
        return north, east, down if math.isnan(altitude) else z


def _place_of(msg: _LocalTarget | _GlobalTarget) -> tuple[float, float, float]:
    if isinstance(msg, _GlobalTarget):
        return from_deg_e7(msg.lat_int), from_deg_e7(msg.lon_int), msg.alt
    return msg.x, msg.y, msg.z


def setpoint_of(msg: Setpoint) -> tuple[str, int | None, int, tuple[float, ...]]:
    """Return name, frame (None: attitude), type mask and numbers; lat. and lon. in degrees."""
    name, mask = msg.get_type(), msg.type_mask
    if isinstance(msg, _AttitudeTarget):
        rates = (msg.body_roll_rate, msg.body_pitch_rate, msg.body_yaw_rate)
        return name, None, mask, (*msg.q, *rates, msg.thrust)
    place = _place_of(msg)
    moves = (msg.vx, msg.vy, msg.vz, msg.afx, msg.afy, msg.afz, msg.yaw, msg.yaw_rate)
    return name, msg.coordinate_frame, mask, (*place, *moves)


def _number(what: str, value: float, ignored: int, allowed: ranges.Range) -> float:
    """Return a number of a setpoint, NaN if left open; raise _InvalidError if out of range."""
    if ignored or math.isnan(value):
        return math.nan
    if value not in allowed:
        raise _InvalidError(f"{what} {value:g}: {allowed}")
    return value


def _three(what: str, values: Triple, mask: int, *allowed: ranges.Range) -> Triple:
    """Return three numbers by `_number`; each is ignored where its low bit of `mask` is set."""
    numbers = zip(values, allowed * (3 // len(allowed)), strict=True)
    x, y, z = (_number(what, value, mask >> i & 1, r) for i, (value, r) in enumerate(numbers))
    return x, y, z


def _attitude_order(msg: _AttitudeTarget) -> AttitudeOrder:
    """The attitude or body rates that a message orders. Raises _InvalidError."""
    mask = msg.type_mask
    if mask & _UNKNOWN_BITS:
        raise _InvalidError(f"type mask {mask:#x}: bits 3 to 5 are not supported")
    thrust = math.nan if mask & _NO_THRUST else msg.thrust
    if thrust not in ranges.THRUST:
        raise _InvalidError(f"thrust {thrust:g}: {ranges.THRUST}")
    rates = (msg.body_roll_rate, msg.body_pitch_rate, msg.body_yaw_rate)
    roll, pitch, yaw = _three("body rate", rates, mask, ranges.SPIN)
    spin = 0.0 if math.isnan(yaw) else yaw
    # The rotors' thrust grows with the square of their speed, which is what `thrust` is a share of.
    collective = thrust**2
    if mask & _NO_ATTITUDE:
        if math.isnan(roll) or math.isnan(pitch):
            raise _InvalidError("neither attitude nor body rates")
        return AttitudeOrder(None, (roll, pitch, spin), collective)
    if any(abs(rate) > 0.0 for rate in (roll, pitch)):
        raise _InvalidError("roll or pitch rate beside an attitude")
    q = np.array(msg.q)
    norm = float(np.linalg.norm(q))
    if not 0.9 < norm < 1.1:
        raise _InvalidError(f"attitude: a quaternion of length {norm:g}")
    w, x, y, z = (float(part) for part in q / norm)
    return AttitudeOrder((w, x, y, z), (0.0, 0.0, spin), collective)


def _turned(vector: Triple, yaw: float) -> Triple:
    """Rotate a vector (forward, right, down) by the heading into NED; open parts (NaN) stay open.

    If only one of forward and right is open, it counts as 0: north and east depend on both.
    """
    x, y, z = vector
    if math.isnan(x) and math.isnan(y):
        return vector
    x, y = (0.0 if math.isnan(part) else part for part in (x, y))
    c, s_ = math.cos(yaw), math.sin(yaw)
    return c * x - s_ * y, s_ * x + c * y, z
