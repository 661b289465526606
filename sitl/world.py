"""A world: aircraft with their brains on one clock, in one air, where they may meet."""

import math
from collections.abc import Mapping
from operator import attrgetter
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mav

from flightdyn.plant import Plant
from flightdyn.state import Vector
from native.errors import InputError
from sitl.autopilot.codec.traffic import Transponder
from sitl.nearness import STEP_S, TOUCH_M, Nearest, Nearness, straight_pieces

_STEP_NS = round(STEP_S * 1e9)
_LOOK_NS = 5 * _STEP_NS  # where nobody can touch another: when they look at themselves anyway
_SECOND_NS = 10**9
_MOVING = attrgetter("moving")
_AXES = np.vstack((np.zeros(3), np.eye(3)))


class Flown(Protocol):
    """An aircraft under a brain, whichever that is. A reboot gives it another aircraft."""

    near_m: float  # within what distance it wants to hear of others; 0: never
    waited_for: bool  # others go on with it step by step, as it may take long for one

    @property
    def traffic(self) -> str:
        """As which messages it hears others; "off": not at all."""

    @property
    def aircraft(self) -> Plant: ...

    @property
    def t_ns(self) -> int: ...

    @property
    def moving(self) -> bool: ...

    def stride(self, until_ns: float = math.inf) -> bool:
        """Run on, at most until no tick begins at `until_ns` or later; whether it is moving."""

    def step(self) -> bool:
        """Run to the next step of its brain; whether it is moving."""

    def told(self, text: str, severity: int) -> None:
        """Say something to whoever listens to this aircraft."""

    def transponder(self, name: str) -> Transponder:
        """What it tells others of itself under that name."""

    def overhear(self, said: Transponder) -> None:
        """Take what the transponder of another one says."""


class World:
    """Steps its aircraft together. One alone is stepped as it asks for itself."""

    def __init__(self, flown: Mapping[str, Flown]) -> None:
        """`flown`: by name; positions of the world are in the local frame of the first.

        Raises:
            InputError: two stand so near to each other that they touch.
        """
        self.names, self._flown = tuple(flown), tuple(flown.values())
        self._alone = self._flown[0] if len(self._flown) == 1 else None
        self._waits = any(one.waited_for for one in self._flown)
        self._t_ns = self._flown[0].t_ns
        frame = self._flown[0].aircraft.frame
        seen = [one.aircraft.frame.in_frame(_AXES, frame) for one in self._flown]
        self._shifts = np.array([origin for origin, *_ in seen])
        self._turns = np.array(seen)[:, 1:] - self._shifts[:, None]
        self._aircraft = [one.aircraft for one in self._flown]
        self._since_ns = [0] * len(self._flown)  # the world's time at which each began
        self._nearness = Nearness([one.near_m for one in self._flown])
        self._places = self._here()
        self._speeds = np.zeros_like(self._places)
        self.near: list[Nearest] = []  # how each encounter within the wanted distance began
        self.collisions: list[tuple[int, int, int]] = []  # when (ns), and of whom
        for i, j in zip(*np.triu_indices(len(flown), 1), strict=True):
            apart_m = float(np.linalg.norm(self._shifts[i] - self._shifts[j]))
            if apart_m < TOUCH_M:
                raise InputError(
                    f"{self.names[i]} and {self.names[j]} stand {apart_m:.2f} m apart: aircraft "
                    f"touch within {TOUCH_M:.2f} m; give them homes farther apart"
                )

    @property
    def t_ns(self) -> int:
        """Simulated time."""
        return self._t_ns if self._alone is None else self._alone.t_ns

    @property
    def moving(self) -> bool:
        """Whether a manoeuvre of anybody is under way, for which simulated time should run."""
        return any(map(_MOVING, self._flown))

    @property
    def least(self) -> list[Nearest]:
        """The least distance so far of each pair."""
        return self._nearness.least

    def step(self) -> None:
        """Run to the next step of the guidance."""
        if self._alone is not None:
            self._alone.step()
        else:
            self._run((self._t_ns // _STEP_NS + 1) * _STEP_NS)

    def stride(self, until_ns: float = math.inf) -> None:
        """Run on by up to a second; no tick begins at `until_ns` or later."""
        if self._alone is not None:
            self._alone.stride(until_ns)
            return
        clear_ns = round(self._nearness.clear(self._places, self._speeds) * 1e9)
        if self._waits:
            clear_ns = _STEP_NS
        tick_ns = self._aircraft[0].dt_ns
        end = max((self._t_ns + clear_ns) // _STEP_NS * _STEP_NS, self._t_ns + tick_ns)
        end = min(end, (self._t_ns // _SECOND_NS + 1) * _SECOND_NS)  # when transponders speak
        if until_ns < end:
            end = self._t_ns + math.ceil((until_ns - self._t_ns) / tick_ns) * tick_ns
        self._run(end, _LOOK_NS)

    def _run(self, end_ns: int, step_ns: int = _STEP_NS) -> None:
        """Run all up to an instant, with the distances at each step on the way."""
        ends = [*range((self._t_ns // step_ns + 1) * step_ns, end_ns, step_ns), end_ns]
        seen = []  # places and velocities
        for i, one in enumerate(self._flown):
            if one.aircraft is not self._aircraft[i]:  # it was rebooted
                self._aircraft[i], self._since_ns[i] = one.aircraft, self._t_ns - one.t_ns
                self._places[i], self._speeds[i] = self._here()[i], 0.0
            since, aircraft = self._since_ns[i], one.aircraft
            for end in ends:
                while one.t_ns + since < end:
                    one.stride(end - since)
                seen.append((aircraft.pos_ned_m, aircraft.vel_ned_mps))
        rows = np.array(seen).reshape(len(self._flown), len(ends), 2, 3)
        places, speeds = (
            np.concatenate((before[:, None], after), axis=1)
            for before, after in (
                (self._places, rows[:, :, 0] @ self._turns + self._shifts[:, None]),
                (self._speeds, rows[:, :, 1] @ self._turns),
            )
        )
        self._places, self._speeds = places[:, -1], speeds[:, -1]
        self._meet(*straight_pieces(np.array([self._t_ns, *ends]), places, speeds))
        self._t_ns = end_ns
        if end_ns % _SECOND_NS == 0:
            self._transpond()

    def _here(self) -> Vector:
        """Where all are (n, 3)."""
        rows = np.array([[one.aircraft.pos_ned_m] for one in self._flown])
        return np.asarray(rows @ self._turns + self._shifts[:, None])[:, 0]

    def _meet(self, t_ns: NDArray[np.int64], places: Vector) -> None:
        """Tell who comes near whom on these straight pieces (n, m, 3), and wreck who touches."""
        whole = np.array([not one.aircraft.crashed for one in self._flown])
        touched, near = self._nearness.follow(t_ns, places, counts=whole)
        self.near += near
        for new in near:
            for me, other in (new.pair, new.pair[::-1]):
                self._flown[me].told(
                    f"{self.names[other]} is near: {new.distance_m:.1f} m at "
                    f"{new.t_ns * 1e-9:.2f} s", mav.MAV_SEVERITY_WARNING,
                )  # fmt: skip
        for one, two in touched:
            speed = float(np.linalg.norm(self._speeds[one] - self._speeds[two]))
            self.collisions.append((int(t_ns[-1]), one, two))
            for me, other in ((one, two), (two, one)):
                aircraft = self._flown[me].aircraft
                if not aircraft.crashed:
                    aircraft.wreck(speed, self.names[other])

    def _transpond(self) -> None:
        """Let those who want to hear all others."""
        if all(one.traffic == "off" for one in self._flown):
            return
        said = [one.transponder(name) for name, one in zip(self.names, self._flown, strict=True)]
        for me, one in enumerate(self._flown):
            for words in said[:me] + said[me + 1 :]:
                one.overhear(words)
