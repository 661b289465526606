"""Failures that a ground station may inject: what they mean to this aircraft. One table."""

import math
from collections.abc import Callable, Mapping

from flightdyn.aircraft import Aircraft
from flightdyn.errors import FaultError
from flightdyn.faults import Fault, GnssJump, GnssOff, ImuBias, MotorLoss
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.protocol.commands import Refusal
from sitl.autopilot.safety.monitor import Monitor
from sitl.autopilot.values import ranges
from sitl.autopilot.values.enums import FailureType, FailureUnit, Result
from sitl.autopilot.values.messages import CommandOrder

_MOTORS = 4
# MAVLink says that something is wrong, not by how much: enough for an autopilot to notice.
_JUMP_M = 50.0
_GYRO_BIAS_RADPS = (0.01, -0.01, 0.01)
_ACCEL_BIAS_MPS2 = (0.4, -0.4, 0.2)

Make = Callable[[int], list[Fault]]


def _motors(instance: int) -> list[Fault]:
    chosen = range(_MOTORS) if instance == 0 else (instance - 1,)
    return [MotorLoss(motor=motor) for motor in chosen]


FAILURES: Mapping[tuple[FailureUnit, FailureType], Make] = {
    (FailureUnit.GNSS, FailureType.OFF): lambda _: [GnssOff()],
    (FailureUnit.GNSS, FailureType.WRONG): lambda _: [GnssJump(north_m=_JUMP_M)],
    (FailureUnit.GYRO, FailureType.WRONG): lambda _: [ImuBias(gyro_radps=_GYRO_BIAS_RADPS)],
    (FailureUnit.ACCEL, FailureType.WRONG): lambda _: [ImuBias(accel_mps2=_ACCEL_BIAS_MPS2)],
    (FailureUnit.MOTOR, FailureType.OFF): _motors,
}
_UNITS = {float(unit): unit for unit in FailureUnit}
_TYPES = {float(kind): kind for kind in FailureType}
_INSTANCES = {FailureUnit.MOTOR: _MOTORS}  # of all other units there is one


def unit_of(fault: Fault) -> FailureUnit | None:
    """The unit that a fault is one of; None for the weather."""
    match fault:
        case GnssOff() | GnssJump():
            return FailureUnit.GNSS
        case MotorLoss():
            return FailureUnit.MOTOR
        case ImuBias(gyro_radps=gyro):
            return FailureUnit.GYRO if any(gyro) else FailureUnit.ACCEL
        case _:
            return None


class Injector:
    """Carries out MAV_CMD_INJECT_FAILURE."""

    def __init__(self, aircraft: Aircraft, parameters: Parameters, *, monitor: Monitor) -> None:
        self._aircraft = aircraft
        self._parameters = parameters
        self._monitor = monitor

    def command(self, order: CommandOrder, _now: float) -> Refusal | None:
        """Begin a failure, or with the type OK end those of the unit."""
        if self._parameters["SYS_FAILURE_EN"] == 0:
            return Refusal(Result.DENIED, "failure injection is switched off (SYS_FAILURE_EN)")
        unit, kind = _UNITS.get(order.params[0]), _TYPES.get(order.params[1])
        if unit is None or kind is None:
            return Refusal(Result.UNSUPPORTED)
        instance = 0.0 if math.isnan(order.params[2]) else order.params[2]
        if not ranges.whole(instance, ranges.Range(0, _INSTANCES.get(unit, 1), "")):
            return Refusal(Result.DENIED, f"no instance {instance:g}")
        refusal = self._inject((unit, kind), int(instance))
        self._monitor.watch_faults()
        return refusal

    def _inject(self, what: tuple[FailureUnit, FailureType], instance: int) -> Refusal | None:
        if what[1] is FailureType.OK:
            self._end(what[0], instance)
            return None
        make = FAILURES.get(what)
        if make is None:
            return Refusal(Result.UNSUPPORTED, f"no failure {what[0].name} {what[1].name}")
        try:
            for fault in make(instance):
                self._aircraft.inject(fault)
        except FaultError as error:
            return Refusal(Result.DENIED, str(error))
        return None

    def _end(self, unit: FailureUnit, instance: int) -> None:
        def meant(fault: Fault) -> bool:
            if unit_of(fault) is not unit:
                return False
            return instance == 0 or not isinstance(fault, MotorLoss) or fault.motor == instance - 1

        for fault in self._aircraft.faults:
            if meant(fault):
                self._aircraft.end(fault)
