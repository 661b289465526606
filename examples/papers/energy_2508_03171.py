"""Energy-efficient federated learning: the cheapest round in which enough devices take part.

Chien-Wei Fu, Meng-Lin Ku: Energy-efficient Federated Learning for UAV Communications, 2025
(arXiv 2508.03171). The paper minimises the energy of the whole system over trajectory, user
participation, power and data volume, under a convergence bound that participation enters, by
alternating optimisation (ECO).

What is here, written from its abstract; the full text was not at hand:
- joint trajectory and participation, by alternation: a path for given participants by the
  configured planner, whose length is cut as far as participation allows; then the participants for
  that path, of whom none is scheduled whom the round can do without;
- participation as a constraint: the expected arrivals of a round are `SHARE` of the devices at
  least, or what the whole path budget reaches, if that is less;
- energy: propulsion of a rotary wing (Zeng, Xu, Zhang: Energy Minimization for Wireless
  Communication with Rotary-Wing UAV, IEEE TWC 2019), which is our choice, and what a device spends
  to train and transmit (TRAIN_J, SEND_J: ours).

What is not: the convergence bound itself (SHARE stands for it), power and data volume (the radio of
the configuration sends with one power, and devices train on all they own), and the paper's figures.

    aerofed run --set mission.strategy=examples.papers.energy_2508_03171:make
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from aerofed import Planner, RoundInfo, RoundPlan, RoundProblem, Sortie, StrategyContext, finish

Floats = NDArray[np.float64]

SHARE = 0.3  # of the devices, expected to arrive in a round
TRAIN_J, SEND_J = 5.0, 1.0  # of one device in a round
HALVINGS = 5  # of the path budget: to 3 % of it


def propulsion_w(speed_mps: float) -> float:
    """Power of a rotary wing in level flight: blade profile, induced and parasite."""
    blade_w, induced_w, tip_mps, hover_mps = 79.86, 88.63, 120.0, 4.03
    drag, density, solidity, disc_m2 = 0.6, 1.225, 0.05, 0.503
    v2 = speed_mps**2
    profile = blade_w * (1.0 + 3.0 * v2 / tip_mps**2)
    ratio = v2 / (2.0 * hover_mps**2)
    induced = induced_w * np.sqrt(np.sqrt(1.0 + ratio**2) - ratio)
    parasite = 0.5 * drag * density * solidity * disc_m2 * speed_mps**3
    return float(profile + induced + parasite)


@dataclass(frozen=True)
class Eco:
    """The cheapest plan that has enough arrivals, found by halving the path budget."""

    planner: Planner
    speed_mps: float
    fairness: bool = False
    approach_m: Floats | None = None

    def importance(self, info: RoundInfo) -> Floats:
        """Every arrival counts alike: the objective of a plan is its expected arrivals."""
        return np.ones(len(info.p))

    def sortie(self, round_index: int, problem: RoundProblem) -> Sortie:
        """The shortest path that still reaches enough, without those whom it does not need."""
        best = self.planner.plan(problem)
        target = min(SHARE * len(problem.devices_m), best.value)
        low_m, high_m = 0.0, best.path_m
        for _ in range(HALVINGS):
            middle_m = 0.5 * (low_m + high_m)
            plan = self.planner.plan(problem.with_own(path_budget_m=middle_m))
            if plan.value >= target:
                best, high_m = min(best, plan, key=self.energy_j), middle_m
            else:
                low_m = middle_m
        return Sortie(participants(problem, best, target))

    def energy_j(self, plan: RoundPlan) -> float:
        """Of the flight at cruise speed, and of the devices that take part."""
        flight_j = propulsion_w(self.speed_mps) * plan.path_m / self.speed_mps
        return flight_j + (TRAIN_J + SEND_J) * float(plan.schedule.sum())


def participants(problem: RoundProblem, plan: RoundPlan, target: float) -> RoundPlan:
    """The plan without the devices that it can spare: the least likely to arrive go first."""
    steps, devices = np.nonzero(plan.schedule[0])
    offset_m = plan.waypoints_m[steps] - problem.devices_m[devices]
    arrives = 1.0 - problem.channel.per(np.hypot(*offset_m.T))
    spare, chosen = float(arrives.sum()) - target, np.ones(len(devices), dtype=bool)
    for index in np.argsort(arrives, kind="stable"):
        if arrives[index] > spare:
            break
        spare -= float(arrives[index])
        chosen[index] = False
    needed = np.zeros(len(problem.devices_m))
    needed[devices[chosen]] = 1.0
    # Who is worth nothing is not scheduled; and all others are worth 1, as in the round's problem.
    return finish(replace(problem, importance=needed), plan.waypoints_m)


def make(context: StrategyContext) -> Eco:
    """What `mission.strategy` names."""
    return Eco(context.planner, context.mission.speed_mps)
