"""Failures that a ground station may inject: what they mean to this aircraft. One table."""

import math
from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from flightdyn.faults import Fault, GnssJump, GnssOff, ImuBias, MotorLoss
from native.errors import FaultError
from sitl.autopilot.codec import ranges
from sitl.autopilot.codec.orders import CommandOrder
from sitl.autopilot.monitor import Monitor
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.protocol.commands import Commands, RefusedError, UnsupportedError

_MOTORS = 4
# MAVLink says that something is wrong, not by how much: enough for an autopilot to notice.
_JUMP_M = 50.0
_GYRO_BIAS_RADPS = (0.01, -0.01, 0.01)
_ACCEL_BIAS_MPS2 = (0.4, -0.4, 0.2)

Make = Callable[[int], list[Fault]]


def _motors(instance: int) -> list[Fault]:
    chosen = range(_MOTORS) if instance == 0 else (instance - 1,)
    return [MotorLoss(motor=motor) for motor in chosen]


_GNSS, _GYRO = mav.FAILURE_UNIT_SENSOR_GPS, mav.FAILURE_UNIT_SENSOR_GYRO
_ACCEL, _MOTOR = mav.FAILURE_UNIT_SENSOR_ACCEL, mav.FAILURE_UNIT_SYSTEM_MOTOR
_OK, _OFF, _WRONG = mav.FAILURE_TYPE_OK, mav.FAILURE_TYPE_OFF, mav.FAILURE_TYPE_WRONG
# What a unit (FAILURE_UNIT) that fails in some way (FAILURE_TYPE) is here.
FAILURES: Mapping[tuple[int, int], Make] = {
    (_GNSS, _OFF): lambda _: [GnssOff()],
    (_GNSS, _WRONG): lambda _: [GnssJump(north_m=_JUMP_M)],
    (_GYRO, _WRONG): lambda _: [ImuBias(gyro_radps=_GYRO_BIAS_RADPS)],
    (_ACCEL, _WRONG): lambda _: [ImuBias(accel_mps2=_ACCEL_BIAS_MPS2)],
    (_MOTOR, _OFF): _motors,
}
_UNITS = {
    *(_GYRO, _ACCEL, mav.FAILURE_UNIT_SENSOR_MAG, mav.FAILURE_UNIT_SENSOR_BARO, _GNSS),
    *(mav.FAILURE_UNIT_SYSTEM_BATTERY, _MOTOR),
}


def unit_of(fault: Fault) -> int | None:
    """Return the FAILURE_UNIT that a fault belongs to; None for wind."""
    match fault:
        case GnssOff() | GnssJump():
            return _GNSS
        case MotorLoss():
            return _MOTOR
        case ImuBias(gyro_radps=gyro):
            return _GYRO if any(gyro) else _ACCEL
        case _:
            return None


class Injector:
    """Carries out MAV_CMD_INJECT_FAILURE."""

    def __init__(self, aircraft: Aircraft, parameters: Parameters, *, monitor: Monitor) -> None:
        self._aircraft = aircraft
        self._parameters = parameters
        self._monitor = monitor
        self.commands: Commands = {mav.MAV_CMD_INJECT_FAILURE: self._command}

    def _command(self, order: CommandOrder) -> None:
        """Begin a failure, or with the type OK end those of the unit."""
        if self._parameters["SYS_FAILURE_EN"] == 0:
            raise RefusedError("failure injection is switched off (SYS_FAILURE_EN)")
        unit, kind, instance = order.params[:3]
        if unit not in _UNITS or kind not in mav.enums["FAILURE_TYPE"]:
            raise UnsupportedError
        instance = 0.0 if math.isnan(instance) else instance
        if instance not in ranges.Range(0, _MOTORS if unit == _MOTOR else 1, whole=True):
            raise RefusedError(f"no instance {instance:g}")
        try:
            if kind == _OK:
                self._end(int(unit), int(instance))
            else:
                self._begin(int(unit), int(kind), int(instance))
        finally:
            self._monitor.watch_faults()

    def _begin(self, unit: int, kind: int, instance: int) -> None:
        make = FAILURES.get((unit, kind))
        if make is None:
            names = mav.enums["FAILURE_TYPE"][kind].name, mav.enums["FAILURE_UNIT"][unit].name
            raise UnsupportedError("there is no {} of {}".format(*names))
        try:
            for fault in make(instance):
                self._aircraft.inject(fault)
        except FaultError as error:
            raise RefusedError(str(error)) from None

    def _end(self, unit: int, instance: int) -> None:
        for fault in self._aircraft.faults.active:
            one = instance == 0 or not isinstance(fault, MotorLoss) or fault.motor == instance - 1
            if one and unit_of(fault) == unit:
                self._aircraft.faults.end(fault)
