"""Flying by sticks: position, altitude and manual control, by MANUAL_CONTROL or RC channels.

Names and meanings of the modes are PX4's. Sticks that fall silent are a failsafe (COM_RC_LOSS_T,
NAV_RCL_ACT).
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import quaternion_from_euler, wrap_pi, yaw_of
from flightdyn.guidance.control import AttitudeOrder
from flightdyn.guidance.pursuit import Target
from sitl.autopilot.codec.orders import Handlers, Peer
from sitl.autopilot.failsafe import Cause
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying.modes import Mode, Need, Trigger
from sitl.autopilot.pilots.stream import Cockpit, StreamPilot

_MIDDLE_US, _HALF_US = 1500, 500
_DEADZONE = 0.1  # of the throttle's middle, and of sticks that hold a position
_PERIOD_S = 0.02  # between looks at the sticks
_ORDERS: Mapping[Mode, Trigger] = {
    Mode.POSITION: Trigger.ORDER_POSITION,
    Mode.ALTITUDE: Trigger.ORDER_ALTITUDE,
    Mode.STABILIZED: Trigger.ORDER_STABILIZED,
    Mode.MANUAL: Trigger.ORDER_MANUAL,
}


class Deflections(NamedTuple):
    """Stick deflections from -1 to 1; a throttle of 0 is in the middle."""

    pitch: float = 0.0
    roll: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0


class Sticks(StreamPilot):
    """Takes the position of the sticks, and flies by it in the modes for that."""

    _MODES, _CAUSE, _PATIENCE = _ORDERS, Cause.STICKS_LOST, "COM_RC_LOSS_T"

    def __init__(self, cockpit: Cockpit) -> None:
        super().__init__(cockpit)
        self._sticks = Deflections()
        self._channels_us = [0] * 4  # 0: channel not overridden
        self._yaw_rad = 0.0  # heading ordered
        self._flight.needs[Need.STICKS] = lambda: self._alive
        self.handlers: Handlers = {
            mav.MAVLink_manual_control_message: self._manual_control,
            mav.MAVLink_rc_channels_override_message: self._override,
        }

    def _manual_control(
        self, _peer: Peer, msg: mav.MAVLink_manual_control_message, _now: float
    ) -> None:
        # The throttle from 0 to 1000, as PX4 takes it.
        throttle = msg.z / 500 - 1 if 0 <= msg.z <= 1000 else 0.0
        self._sticks = Deflections(_stick(msg.x), _stick(msg.y), throttle, _stick(msg.r))
        self._heard()

    def modes(self) -> Mapping[Mode, Callable[[], str | None]]:
        """Return, by stick mode, the function that enters it; that returns why if it cannot."""
        return {mode: lambda mode=mode: self.enter(mode) for mode in _ORDERS}  # type: ignore[misc]

    def enter(self, mode: Mode, why: str | None = None) -> str | None:
        """Fly by the sticks from now on; return the reason if that cannot be."""
        return self._flight.order(_ORDERS[mode], lambda: self._piloted(mode), why)

    def _override(
        self, _peer: Peer, msg: mav.MAVLink_rc_channels_override_message, _now: float
    ) -> None:
        """Take channels in the usual order (us): roll, pitch, throttle, yaw."""
        for i, width in enumerate((msg.chan1_raw, msg.chan2_raw, msg.chan3_raw, msg.chan4_raw)):
            if width != 65535:  # else it stays as it is
                self._channels_us[i] = width
        if any(self._channels_us):  # else all are let go
            roll, pitch, throttle, yaw = (
                0.0 if width == 0 else min(1.0, max(-1.0, (width - _MIDDLE_US) / _HALF_US))
                for width in self._channels_us
            )
            self._sticks = Deflections(pitch, roll, throttle, yaw)
            self._heard()

    def _piloted(self, mode: Mode) -> do.Manoeuvre:
        self._yaw_rad = yaw_of(self._aircraft.belief.q_frd_to_ned)
        fly = {Mode.POSITION: self._fly_position, Mode.ALTITUDE: self._fly_altitude}.get(
            mode, self._fly_attitude
        )
        return do.Piloted(
            self._aircraft, fly, every_s=_PERIOD_S, settle_s=self._parameters["COM_DISARM_LAND"]
        )

    def _fly_position(self) -> None:
        """Position mode: sticks order a velocity along the nose; centred, they hold."""
        sticks, p = self._sticks, self._parameters
        speed = p["MPC_VEL_MANUAL"]
        forward, right = (_beyond_deadzone(each) * speed for each in (sticks.pitch, sticks.roll))
        size = math.hypot(forward, right)
        if size > speed:
            forward, right = forward * speed / size, right * speed / size
        yaw = yaw_of(self._aircraft.belief.q_frd_to_ned)
        c, s_ = math.cos(yaw), math.sin(yaw)
        velocity = (c * forward - s_ * right, s_ * forward + c * right, -self._climb_mps())
        limits = self._flight.navigator.speed_limits._asdict()
        self._aircraft.pursue(Target(vel=velocity, yaw_rate=self._yaw_rate(), **limits))

    def _fly_altitude(self) -> None:
        """Altitude mode: sticks order tilt and climb; a centred throttle holds."""
        q, rates = self._lean()
        self._aircraft.keep_attitude(AttitudeOrder(q, rates, climb_mps=self._climb_mps()))

    def _fly_attitude(self) -> None:
        """Manual and stabilized mode: sticks order tilt, the throttle orders the rotors' speed."""
        q, rates = self._lean()
        throttle = (self._sticks.throttle + 1) / 2
        self._aircraft.keep_attitude(AttitudeOrder(q, rates, throttle**2))

    def _lean(self) -> tuple[tuple[float, float, float, float], tuple[float, float, float]]:
        most = math.radians(self._parameters["MPC_MAN_TILT_MAX"])
        rate = self._yaw_rate()
        if self._aircraft.on_ground:
            self._yaw_rad = yaw_of(self._aircraft.belief.q_frd_to_ned)
        self._yaw_rad = wrap_pi(self._yaw_rad + rate * _PERIOD_S)
        # Forward is nose down.
        q = quaternion_from_euler(
            self._sticks.roll * most, -self._sticks.pitch * most, self._yaw_rad
        )
        return q, (0.0, 0.0, rate)

    def _climb_mps(self) -> float:
        stick, p = _beyond_deadzone(self._sticks.throttle), self._parameters
        return stick * (p["MPC_Z_VEL_MAX_UP"] if stick > 0 else p["MPC_Z_VEL_MAX_DN"])

    def _yaw_rate(self) -> float:
        return _beyond_deadzone(self._sticks.yaw) * math.radians(self._parameters["MPC_MAN_Y_MAX"])


def _stick(value: int) -> float:
    """Convert thousandths to -1..1; out of range (32767: no such axis) counts as centred."""
    return value / 1000 if abs(value) <= 1000 else 0.0


def _beyond_deadzone(stick: float) -> float:
    """A deflection (-1..1) less the dead zone about the middle: 0 in it, linear beyond."""
    return math.copysign(max(0.0, abs(stick) - _DEADZONE) / (1 - _DEADZONE), stick)
