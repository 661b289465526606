"""Pilots outside the vehicle whose stream of messages must not fall silent while they fly it."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import ClassVar

from flightdyn.aircraft import Aircraft
from sitl.autopilot.failsafe import Cause, Failsafes
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.flying.modes import Mode
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.reporter import Reporter


@dataclass(slots=True)
class Cockpit:
    """The parts of the vehicle that a pilot outside it reads and orders."""

    aircraft: Aircraft
    flight: Flight
    parameters: Parameters
    reporter: Reporter
    now: float = 0.0  # seconds, on the clock by which silence is measured


class StreamPilot:
    """Base of pilots that stream orders in their modes; silence then triggers a failsafe."""

    _MODES: ClassVar[Collection[Mode]]
    _CAUSE: ClassVar[Cause]
    _PATIENCE: ClassVar[str]  # the parameter that says how long, in seconds

    def __init__(self, cockpit: Cockpit) -> None:
        self._aircraft, self._flight = cockpit.aircraft, cockpit.flight
        self._parameters = cockpit.parameters
        self._cockpit = cockpit
        self._heard_at = -math.inf

    @property
    def _alive(self) -> bool:
        """Whether a message of the stream came lately."""
        return self._cockpit.now - self._heard_at < self._parameters[self._PATIENCE]

    @property
    def _flies(self) -> bool:
        return self._flight.mode in self._MODES

    def _heard(self) -> None:
        """Note that a message of the stream came now."""
        self._heard_at = self._cockpit.now

    def watch(self, failsafes: Failsafes) -> None:
        """Tell `failsafes` whether the stream is lost, until it is back or the motors are off."""
        missed = self._flies or failsafes.acted(self._CAUSE)
        lost = self._aircraft.armed and missed and not self._alive
        silence_s = self._cockpit.now - self._heard_at
        failsafes.update(self._CAUSE, lost, lambda: f"{silence_s:.1f} s")

    def due(self) -> float:
        """Return the time (s) at which a loss will show; infinite if there is nothing to lose."""
        lose = self._flies and self._alive
        return self._heard_at + self._parameters[self._PATIENCE] if lose else math.inf
