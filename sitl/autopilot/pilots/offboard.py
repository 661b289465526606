"""Offboard control: a program outside streams setpoints, and the vehicle goes after them.

The rules are PX4's: the mode is granted while setpoints stream in, and their loss is a failsafe
(COM_OF_LOSS_T, COM_OBL_RC_ACT). What is left open by a mask or by NaN is open.
"""

import math

import numpy as np

from flightdyn.frames import Triple, yaw_of
from flightdyn.guidance.control import AttitudeOrder
from flightdyn.guidance.pursuit import OPEN, Target
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.modes import Mode, Need, Trigger
from sitl.autopilot.pilots.stream import Cockpit, StreamPilot
from sitl.autopilot.reporter import Reporter
from sitl.autopilot.safety.failsafe import Cause
from sitl.autopilot.values import messages as m
from sitl.autopilot.values import ranges
from sitl.autopilot.values import setpoints as s
from sitl.autopilot.values.enums import GLOBAL_FRAMES, RELATIVE_FRAMES, Frame, Severity


class _InvalidError(Exception):
    """A setpoint that cannot be flown; says why."""


class Offboard(StreamPilot):
    """Takes setpoints, and flies by them in the mode OFFBOARD."""

    def __init__(self, cockpit: Cockpit, reporter: Reporter) -> None:
        parameters, cause = cockpit.parameters, Cause.SETPOINTS_LOST
        super().__init__(
            cockpit, {Mode.OFFBOARD}, cause, patience_s=lambda: parameters["COM_OF_LOSS_T"]
        )
        self._report = reporter
        self._order: Target | AttitudeOrder = Target()
        self._complaint = ""
        self._flight.needs[Need.SETPOINTS] = self._flyable

    def receive(self, body: m.Incoming) -> bool:
        """Take a setpoint; False for what is none."""
        if not isinstance(body, s.PositionTarget | s.AttitudeTarget):
            return False
        try:
            if isinstance(body, s.PositionTarget):
                self._order = self._target(body)
            else:
                self._order = _attitude_order(body)
        except _InvalidError as error:
            self._complain(f"Setpoint refused: {error}")
            return True
        self._complaint = ""
        self._heard()
        if self._flies:
            self._fly()
        return True

    def enter(self) -> str | None:
        """Fly by setpoints from now on; the reason if that cannot be."""
        if self._flies:
            return None
        return self._flight.order(Trigger.ORDER_OFFBOARD, self._piloted)

    def _flyable(self) -> bool:
        placed = isinstance(self._order, AttitudeOrder) or self._flight.position_ok()
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
        """Once, not at every setpoint of a stream."""
        if text != self._complaint:
            self._complaint = text
            self._report.say(Severity.ERROR, text)

    def _target(self, body: s.PositionTarget) -> Target:
        _check(body)
        vel, acc, pos = body.vel_mps, body.acc_mps2, body.place
        if body.frame in GLOBAL_FRAMES:
            pos = self._local(body)
        elif body.frame == Frame.BODY_NED:
            pos = OPEN
            yaw = yaw_of(self._aircraft.belief.q_frd_to_ned)
            vel, acc = _turned(vel, yaw), _turned(acc, yaw)
        elif body.frame != Frame.LOCAL_NED:
            raise _InvalidError(f"frame {body.frame}; 0, 1, 3, 5, 6 and 8 are supported")
        if all(map(math.isnan, (*pos, *vel, *acc))):
            raise _InvalidError("neither position nor velocity nor acceleration")
        limits = self._flight.navigator.speed_limits
        return Target(pos, vel, acc, body.yaw_rad, body.yaw_rate_radps, *limits)

    def _local(self, body: s.PositionTarget) -> Triple:
        lat_deg, lon_deg, altitude = body.place
        if math.isnan(lat_deg) or math.isnan(lon_deg) or math.isnan(altitude):
            return OPEN  # PX4: all of a global position, or nothing
        if body.frame in RELATIVE_FRAMES:
            altitude += self._flight.home.alt_msl_m
        north, east, down = self._flight.frame.to_ned(lat_deg, lon_deg, altitude)
        if math.hypot(north, east) not in ranges.AWAY:
            raise _InvalidError(f"position {math.hypot(north, east) / 1000:.0f} km away")
        return float(north), float(east), float(down)


def _check(body: s.PositionTarget) -> None:
    """Everything that is given is finite and physically possible."""
    if body.force:
        raise _InvalidError("force is not supported")
    place = (ranges.AWAY,) * 3
    if body.frame in GLOBAL_FRAMES:
        place = (ranges.LATITUDE, ranges.LONGITUDE, ranges.ALTITUDE)
    for what, values, within in (
        ("position", body.place, place),
        ("velocity", body.vel_mps, (ranges.VELOCITY,) * 3),
        ("acceleration", body.acc_mps2, (ranges.ACCELERATION,) * 3),
        ("yaw", (body.yaw_rad,), (ranges.HEADING,)),
        ("yaw rate", (body.yaw_rate_radps,), (ranges.SPIN,)),
    ):
        for value, allowed in zip(values, within, strict=True):
            if not (math.isnan(value) or value in allowed):
                raise _InvalidError(f"{what} {value:g}: {allowed}")


def _attitude_order(body: s.AttitudeTarget) -> AttitudeOrder:
    """Raises _InvalidError."""
    if body.thrust not in ranges.THRUST:
        raise _InvalidError(f"thrust {body.thrust:g}: {ranges.THRUST}")
    if not all(math.isnan(rate) or rate in ranges.SPIN for rate in body.rates_radps):
        raise _InvalidError(f"body rates {body.rates_radps}: {ranges.SPIN}")
    roll, pitch, yaw = body.rates_radps
    spin = 0.0 if math.isnan(yaw) else yaw
    # The rotors' thrust grows with the square of their speed, which is what `thrust` is a share of.
    collective = body.thrust**2
    if body.q_frd_to_ned is None:
        if math.isnan(roll) or math.isnan(pitch):
            raise _InvalidError("neither attitude nor body rates")
        return AttitudeOrder(None, (roll, pitch, spin), collective)
    q = np.array(body.q_frd_to_ned)
    norm = float(np.linalg.norm(q))
    if not 0.9 < norm < 1.1:
        raise _InvalidError(f"attitude: a quaternion of length {norm:g}")
    w, x, y, z = (float(part) for part in q / norm)
    return AttitudeOrder((w, x, y, z), (0.0, 0.0, spin), collective)


def _turned(vector: Triple, yaw: float) -> Triple:
    """From forward, right, down to NED; open where a part is."""
    x, y, z = vector
    c, s_ = math.cos(yaw), math.sin(yaw)
    if math.isnan(x + y + z):
        return OPEN
    return c * x - s_ * y, s_ * x + c * y, z
