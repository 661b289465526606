"""How low the battery is."""

from flightdyn.aircraft import Aircraft
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.safety.failsafe import Cause

_HYSTERESIS = 0.02
_THRESHOLDS = {
    Cause.BATTERY_LOW: "BAT_LOW_THR",
    Cause.BATTERY_CRITICAL: "BAT_CRIT_THR",
    Cause.BATTERY_EMERGENCY: "BAT_EMERGEN_THR",
}


class Charge:
    """Which thresholds the charge has fallen below, as of the last look."""

    def __init__(self, aircraft: Aircraft, parameters: Parameters) -> None:
        self._aircraft = aircraft
        self._parameters = parameters
        self._below = dict.fromkeys(_THRESHOLDS, False)

    def look(self) -> dict[Cause, bool]:
        """Each threshold by its cause, and whether the charge is below it."""
        charge = self._aircraft.battery.remaining
        for cause, name in _THRESHOLDS.items():
            hysteresis = _HYSTERESIS if self._below[cause] else 0.0
            self._below[cause] = charge < self._parameters[name] + hysteresis
        return self._below

    @property
    def critical(self) -> bool:
        """Whether it is too low to take off with."""
        return self._below[Cause.BATTERY_CRITICAL]
