"""Everybody outside who may fly the vehicle: programs, sticks, a target, an order to circle."""

from collections.abc import Callable, Mapping

from sitl.autopilot.flying.orbit import Orbit, Orbits
from sitl.autopilot.modes import Mode
from sitl.autopilot.pilots.follow import Follower
from sitl.autopilot.pilots.offboard import Offboard
from sitl.autopilot.pilots.sticks import Sticks
from sitl.autopilot.pilots.stream import Cockpit
from sitl.autopilot.protocol.commands import Handler
from sitl.autopilot.reporter import Reporter
from sitl.autopilot.safety.failsafe import Failsafes
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import Command


class Pilots:
    """Takes what is streamed to the vehicle, and the orders to fly by it."""

    def __init__(self, cockpit: Cockpit, reporter: Reporter) -> None:
        self._clock = cockpit.clock
        self._offboard = Offboard(cockpit, reporter)
        self._sticks = Sticks(cockpit)
        self._follower = Follower(cockpit)
        self._orbits = Orbits(cockpit.aircraft, cockpit.flight)

    @property
    def orbit(self) -> Orbit | None:
        """The circle being flown; None where none is."""
        return self._orbits.current

    def modes(self) -> Mapping[Mode, Callable[[], str | None]]:
        """What enters each mode; the reason if that cannot be."""
        return {
            Mode.OFFBOARD: self._offboard.enter,
            Mode.FOLLOW: self._follower.enter,
            **self._sticks.modes(),
        }

    def give_to_sticks(self, mode: Mode, why: str) -> str | None:
        """Fly by the sticks from now on, in a mode of theirs; the reason if that cannot be."""
        return self._sticks.enter(mode, why)

    def handlers(self) -> Mapping[Command, Handler]:
        """Who answers which command."""
        return {Command.DO_ORBIT: self._orbits.command}

    def note_time(self, now: float) -> None:
        """Tell the wall time, before anything that is to happen at it."""
        self._clock.now = now

    def receive(self, _peer: m.Peer, body: m.Incoming, _now: float) -> bool:
        """Take something streamed; False for what is nothing of that."""
        return any(pilot.receive(body) for pilot in (self._offboard, self._sticks, self._follower))

    def poll(self, now: float) -> None:
        """Nothing is answered."""
        self.note_time(now)

    def watch(self, failsafes: Failsafes) -> None:
        """Look for streams that have fallen silent, at the time that was noted last."""
        self._offboard.watch(failsafes)
        self._sticks.watch(failsafes)

    def due(self) -> float | None:
        """When `watch` has something to do; None for never."""
        timers = (self._offboard.due(), self._sticks.due())
        return min((timer for timer in timers if timer is not None), default=None)
