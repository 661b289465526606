"""Flight performance as plans depend on it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flightdyn.config import LimitsConfig
from flightdyn.foresight import SETTLING_S, least_duration, least_energy, longest_within
from flightdyn.guidance.path import steering_of
from flightdyn.native.library import Structure
from flightdyn.physics.power import air_of, power_w
from mission.base.arrays import Floats, given_alone
from mission.planner.native import rounds

_ROUNDED = 1.01  # times: watts between samples of a table
AHEAD_S, AHEAD_SHARE = 0.5, 0.02  # by which a flight may be ahead of what was foreseen
SHARES = (0.8, 0.6, 0.5, 0.4, 0.3, 0.2)  # of the widest acceptance radius
NARROWEST_M = 1.0  # narrower is no use to an aircraft that knows its place to a metre
_LONGEST_M, _ENERGY_STEP_M = 20_000.0, 0.5  # of a round's path; how finely its energy is tabled


@dataclass(frozen=True)
class Foreseen:
    """What a flight takes from rest to rest, in the steady wind, as predicted."""

    arrived_s: Floats  # (S,) at each of its stops
    # In the order of `native/planner.h`, where limits weigh them.
    duration_s: float
    energy_j: float  # electrical, of the simulated aircraft
    flown_m: float = 0.0  # from stop to stop
    hovered_s: float = 0.0
    turned_rad: float = 0.0  # at stops


@dataclass(frozen=True)
class Performance:
    """Flight performance: speed, corners, guidance limits, air density and wind."""

    speed_mps: float
    widest_m: float  # acceptance radius at most: less where a plan bears less
    # What the guidance keeps to; None: always at its speed, as where nothing is flown.
    guidance: LimitsConfig | None
    density: float = 1.0  # of the air, over that at sea level
    wind_mps: tuple[float, float] = (0.0, 0.0)  # the air's velocity, east and north
    pace: float = 1.0  # times as long as the guidance's own: of vehicles that fly otherwise
    stopping_s: float = SETTLING_S  # until it stands for a hover on its way

    __getstate__ = given_alone

    def foresee(self, points_m: Floats, hold_s: Sequence[float], radius_m: float) -> Foreseen:
        """Predict a flight through stops (S, 2), hovers `hold_s` (S,), acceptance `radius_m`."""
        flight = rounds.ForeseenFlight(self._flying, points_m, hold_s, radius_m)
        arrived_s, counted = flight.foreseen()
        return Foreseen(arrived_s, *counted.tolist())

    def follow(
        self,
        points_m: Floats,
        hold_s: Sequence[float],
        radius_m: float,
        *,
        step_s: float,
        count: int,
    ) -> Floats:
        """Predict where such a flight is (count, 2), every `step_s` from its start; where it ends
        it stays."""
        flight = rounds.ForeseenFlight(self._flying, points_m, hold_s, radius_m)
        return flight.followed(step_s=step_s, count=count)

    @cached_property
    def _flying(self) -> Structure:
        return self.flying()

    def flying(self, limits: Sequence[tuple[float, Sequence[float]]] = ()) -> Structure:
        """Return the C structure of performance and a round's limits, as `rounds.flying` has it."""
        guided = self.guidance is not None
        return rounds.flying(
            guided=guided, steering=steering_of(self.guidance or LimitsConfig()),
            air=air_of(self.density, (*self.wind_mps, 0.0)), speed=self.speed_mps,
            widest=self.widest_m, pace=self.pace, stopping=self.stopping_s, settling=SETTLING_S,
            ahead=guided * AHEAD_S, ahead_share=guided * AHEAD_SHARE, limits=limits,
        )  # fmt: skip

    def foresee_hover(self, hover_s: float) -> Foreseen:
        """Predict a hover on the spot of `hover_s` seconds."""
        return self.foresee(np.zeros((1, 2)), [hover_s], self.widest_m)

    def with_hovers_begun(self, flight: Foreseen, count: int) -> Foreseen:
        """Return the flight with what `count` hovers on the spot take until they begin."""
        hover = self.foresee_hover(1.0)
        begun_s, begun_j = hover.duration_s - 1.0, hover.energy_j - self.hover_j(1.0)
        duration_s = flight.duration_s + count * begun_s
        return replace(flight, duration_s=duration_s, energy_j=flight.energy_j + count * begun_j)

    def longest_m(self, duration_s: float) -> float:
        """Return an upper bound (m) on the path flown in `duration_s`, whatever its corners."""
        if self.guidance is None:
            return duration_s * self.speed_mps
        if math.isinf(duration_s):
            return math.inf
        return longest_within(
            duration_s / self.pace, speed_mps=self.speed_mps, limits=self.guidance
        )

    def least_s(self, length_m: float) -> float:
        """Return a lower bound in seconds on the flight time of a path of `length_m`."""
        if self.guidance is None:
            return length_m / self.speed_mps
        least_s = least_duration(length_m, speed_mps=self.speed_mps, limits=self.guidance)
        return least_s * self.pace

    def farthest_m(self, energy_j: float, legs: float = math.inf) -> float:
        """Return an upper bound (m) on the length of a path flown with `energy_j`, of up to `legs`
        straight legs, whatever its corners; infinity beyond 20 km, unless there is no guidance."""
        if math.isinf(energy_j):
            return math.inf
        if self.guidance is None:
            return energy_j / self._cruise_w * self.speed_mps
        lengths, joules = self._energy_table(legs)
        beyond = int(np.searchsorted(joules, energy_j, side="right"))
        return float(lengths[beyond]) if beyond < len(lengths) else math.inf

    def least_j(self, length_m: float, legs: float = math.inf) -> float:
        """Return a lower bound (J) on the energy of a path of `length_m`, of up to `legs` legs."""
        if self.guidance is None:
            return self._cruise_w * length_m / self.speed_mps
        lengths, joules = self._energy_table(legs)
        # The longer the path, the cheaper its fastest metre, until the speed is reached: within
        # the table, at any acceleration that is allowed. From there on all cost the same.
        further_m = max(0.0, length_m - lengths[-1])
        return float(np.interp(length_m, lengths, joules) + further_m * self.cheapest_j(legs))

    @property
    def fastest_mps(self) -> float:
        """Upper bound on progress along a path, in metres a second."""
        if self.guidance is None:
            return self.speed_mps
        return min(self.speed_mps, self.guidance.speed_mps) / self.pace

    @property
    def stop_m(self) -> tuple[float, float]:
        """Cost of a stop, in metres at full speed: a fixed part, and one for braking and starting,
        which is also the length of leg from which on it counts in full."""
        if self.guidance is None:
            return 0.0, 0.0
        speed_mps = self.fastest_mps * self.pace
        fixed_m = speed_mps * (self.guidance.smoothing_s + self.stopping_s)
        return fixed_m, speed_mps**2 / self.guidance.acceleration_mps2

    def cheapest_j(self, legs: float = math.inf) -> float:
        """Return a lower bound on the joules per metre of a path of up to `legs` straight legs."""
        if self.guidance is None:
            return self._cruise_w / self.speed_mps
        lengths, joules = self._energy_table(legs)
        return float((joules[-1] - joules[-2]) / (lengths[-1] - lengths[-2]))

    @property
    def least_w(self) -> float:
        """Lower bound on electrical power in flight, in watts."""
        return float(self._cruise[1].min()) / _ROUNDED

    @property
    def best_endurance_mps(self) -> float:
        """Speed through the air of the least power: the longest time of a battery."""
        speeds_mps, watts = self._cruise
        return float(speeds_mps[watts.argmin()])

    @property
    def best_range_mps(self) -> float:
        """Speed of the least energy a metre, in still air: the longest way of a battery."""
        speeds_mps, watts = self._cruise
        return float(speeds_mps[(watts / speeds_mps).argmin()])

    @property
    def best_speeds(self) -> str:
        """Its speed beside these two, in words."""
        return (
            f"flown at {self.speed_mps:g} m/s: power is least at {self.best_endurance_mps:.1f} m/s "
            f"through the air, energy of a metre at {self.best_range_mps:.1f} m/s"
        )

    @cached_property
    def _cruise(self) -> tuple[Floats, Floats]:
        speeds_mps = np.linspace(0.1, 40.0, 400)
        return speeds_mps, power_w(speeds_mps, density=self.density)

    def hover_j(self, duration_s: float) -> float:
        """Return the energy in joules of a hover of `duration_s` in the steady wind."""
        return self._hover_w * duration_s

    @cached_property
    def _hover_w(self) -> float:
        return self._level_w(math.hypot(*self.wind_mps))

    @cached_property
    def _cruise_w(self) -> float:
        return self._level_w(self.speed_mps)

    def _level_w(self, speed_mps: float) -> float:
        return float(power_w(np.array([speed_mps]), density=self.density)[0])

    def _energy_table(self, legs: float) -> tuple[Floats, Floats]:
        if legs in self._energy_tables:
            return self._energy_tables[legs]
        assert self.guidance is not None
        lengths = np.arange(0.0, _LONGEST_M + _ENERGY_STEP_M, _ENERGY_STEP_M)
        joules = least_energy(
            lengths,
            legs=legs,
            speed_mps=self.speed_mps,
            limits=self.guidance,
            cut_m=self.guidance.corner_cut * self.widest_m,
            density=self.density,
            wind_mps=math.hypot(*self.wind_mps),
        )
        self._energy_tables[legs] = lengths, joules
        return lengths, joules

    @cached_property
    def _energy_tables(self) -> dict[float, tuple[Floats, Floats]]:
        return {}


def acceptance_radii(widest_m: float) -> Floats:
    """Acceptance radii in metres that a flight may have, the widest first."""
    narrower = [share * widest_m for share in SHARES if share * widest_m > NARROWEST_M]
    return np.array([widest_m, *narrower])
