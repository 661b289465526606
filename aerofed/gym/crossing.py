"""Several vehicles of one world that cross, as a ParallelEnv of PettingZoo."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from aerofed.gym.actions import checked, within
from aerofed.gym.steered import SEEN, Array, Steered, hovering, largest, stepped
from mission.api.configuring import Source
from mission.api.vehicles import vehicle_config
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.flight.serve.separation import pairs_of
from mission.flight.serve.vehicle import make_vehicles, names_of

try:
    from pettingzoo import ParallelEnv
except ModuleNotFoundError:
    raise ImportError("PettingZoo is not installed: pip install 'aerofed[pettingzoo]'") from None


class CrossingEnv(ParallelEnv[str, Array, Array]):
    """Vehicles hover on a circle, and each is to fly to the place of the one across.

    All agents act at once. Action (3,), each in [-1, 1]: the velocity to order for the next 0.1 s,
    to east, north and up, as shares of the vehicle's limits. Observation (6 n,) of n vehicles:
    metres to its place and its velocity, m/s, then where each other one is from it and how that one
    moves against it, the nearest first; to east, north and up, as their autopilots believe them,
    and zeros for those that are out. In an agent's information `separation_m` is the true least
    distance to another so far.

    The reward is by how many metres an agent has truly come nearer to its place, less 1 for each
    metre by which another one is nearer than `separation_m`. An agent is out where its autopilot no
    longer takes setpoints: those that touch are wrecks. The episode ends after `max_cycles` steps.
    """

    metadata: Mapping[str, Any] = {"name": "aerofed_crossing_v0", "render_modes": ()}

    def __init__(
        self,
        count: int = 2,
        *,
        radius_m: float = 20.0,
        separation_m: float = 5.0,
        max_cycles: int = 200,
        overrides: Mapping[str, object] | None = None,
        source: "Source | None" = None,
        wind_mps: float | None = None,
    ) -> None:
        """`count` vehicles; overrides, source and wind are those of `aerofed.vehicles`.

        Raises:
            InputError: a value is refused, or so many would touch on the circle.
        """
        within(radius_m=(radius_m, 300), separation_m=(separation_m, 100))
        within(max_cycles=(max_cycles, 10**6))
        self.possible_agents = names_of(count)
        self._numbers = {name: number for number, name in enumerate(self.possible_agents)}
        if count < 2:
            raise InputError(f"count = {count!r}: it takes two to cross")
        self._config = vehicle_config(overrides, source=source, wind_mps=wind_mps)
        self._most = largest(self._config, "velocity")
        self._radius_m, self._separation_m, self.max_cycles = radius_m, separation_m, max_cycles
        self._random: np.random.Generator | None = None
        self.agents: list[str] = []
        reach = np.tile(SEEN, count)
        self._actions = {name: spaces.Box(-1.0, 1.0, (3,)) for name in self.possible_agents}
        self._seen = {name: spaces.Box(-reach, reach) for name in self.possible_agents}

    def action_space(self, agent: str) -> Any:
        """The velocity that an agent orders."""
        return self._actions[agent]

    def observation_space(self, agent: str) -> Any:
        """What an agent sees."""
        return self._seen[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[dict[str, Any], ...]:  # noqa: ARG002  PettingZoo's
        """Take off in new vehicles, the circle turned by an angle that is drawn; no options.

        Raises:
            FlightError: one does not come to hover, as where faults keep it on the ground.
        """
        if seed is not None or self._random is None:
            self._random = np.random.default_rng(seed)
        count = len(self.possible_agents)
        angles = self._random.uniform(0.0, 2.0 * math.pi) + 2.0 * math.pi / count * np.arange(count)
        self._homes = self._radius_m * np.column_stack((np.cos(angles), np.sin(angles), 0 * angles))
        given = self._config.model_copy(update={"seed": int(self._random.integers(2**31))})
        homes_m = (np.array(given.area.home_m) + self._homes[:, :2]).tolist()
        at = [given.area.model_copy(update={"home_m": (x, y)}) for x, y in homes_m]
        own = {n: given.model_copy(update={"area": at[i]}) for n, i in self._numbers.items()}
        served = make_vehicles(given, count=count, each=own, udp=(), logs=None, in_step=True)
        self._fleet = {each.name: Steered(each, "velocity") for each in served}
        self._world = hovering(self._fleet)
        self._goals = np.roll(self._places(), -(count // 2), axis=0)
        self.agents, self._cycles = [*self.possible_agents], 0
        self._away_m = np.linalg.norm(self._goals - self._places(), axis=1)
        return self._observed(), self._told()

    def step(self, actions: Mapping[str, Array]) -> tuple[dict[str, Any], ...]:
        """Order the velocities of all agents, and fly for 0.1 s."""
        if set(actions) != set(self.agents):
            raise InputError(f"actions of {sorted(actions)}: the agents are {self.agents}")
        given = {name: checked(actions[name], 3, under_way=True) for name in self.agents}
        for name, action in given.items():
            self._fleet[name].set(action * self._most)
        flying = stepped(self._world, self._fleet)
        self._cycles += 1
        places, before_m = self._places(), self._away_m
        self._away_m = np.linalg.norm(self._goals - places, axis=1)
        apart_m = np.linalg.norm(places[:, None] - places, axis=2)
        np.fill_diagonal(apart_m, math.inf)
        too_near_m = np.maximum(self._separation_m - apart_m, 0.0).sum(axis=1)
        rewards = before_m - self._away_m - too_near_m
        over = self._cycles >= self.max_cycles
        found = (
            self._observed(),
            {name: float(rewards[self._numbers[name]]) for name in self.agents},
            {name: not flying[name] for name in self.agents},
            dict.fromkeys(self.agents, over),
            self._told(),
        )
        self.agents = [name for name in self.agents if flying[name] and not over]
        return found

    def _places(self) -> Floats:
        """Where all truly are (n, 3): east, north, up of the circle's middle."""
        return np.array([one.truth[:3] for one in self._fleet.values()]) + self._homes

    def _observed(self) -> dict[str, Array]:
        states = np.array([one.belief for one in self._fleet.values()])
        states[:, :3] += self._homes
        seen, here = {}, [self._numbers[name] for name in self.agents]
        for name, me in zip(self.agents, here, strict=True):
            away, rows = states[here] - states[me], np.zeros((len(states), 6))
            nearest = np.argsort(np.linalg.norm(away[:, :3], axis=1), kind="stable")
            rows[: len(here)] = away[nearest]
            rows[0] = *(self._goals[me] - states[me, :3]), *states[me, 3:]  # the nearest is itself
            seen[name] = np.clip(rows, -SEEN, SEEN).astype(np.float32).ravel()
        return seen

    def _told(self) -> dict[str, dict[str, Any]]:
        pairs = pairs_of(self._world)
        near = {n: [pair.least_m for pair in pairs if n in pair[:2]] for n in self.agents}
        return {n: {"separation_m": min(least, default=math.inf)} for n, least in near.items()}
