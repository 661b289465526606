"""Several vehicles of one world that cross, as a ParallelEnv of PettingZoo."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aerofed.gym.actions import checked
from aerofed.gym.steered import Steered, hovering, stepped
from mission.api.configuring import Source
from mission.api.vehicles import vehicle_config
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.flight.serve.hosts import enu
from mission.flight.serve.vehicle import make_vehicles, names_of
from mission.scenario.limits import guidance_of

try:
    from pettingzoo import ParallelEnv
except ModuleNotFoundError:
    raise ImportError(
        "aerofed.gym.crossing: PettingZoo is not installed: pip install 'aerofed[pettingzoo]'"
    ) from None

Array = NDArray[np.float32]
_SEEN = np.array([1000.0] * 3 + [50.0] * 3, dtype=np.float32)


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
        for name, value, most in (
            ("radius_m", radius_m, 300), ("separation_m", separation_m, 100),
            ("max_cycles", max_cycles, 10**6),
        ):  # fmt: skip
            if not isinstance(value, int | float) or not 0 < value <= most:
                raise InputError(f"{name} = {value!r}: must be more than 0, at most {most}")
        self.possible_agents = names_of(count)
        if count < 2:
            raise InputError(f"count = {count!r}: it takes two to cross")
        self._config = vehicle_config(overrides, source=source, wind_mps=wind_mps)
        limits = guidance_of(self._config.vehicle)
        self._most = np.array([limits.speed_mps, limits.speed_mps, limits.climb_mps])
        self._radius_m, self._separation_m, self.max_cycles = radius_m, separation_m, max_cycles
        self._random: np.random.Generator | None = None
        self.agents: list[str] = []
        reach = np.tile(_SEEN, count)
        self._actions = {name: spaces.Box(-1.0, 1.0, (3,)) for name in self.possible_agents}
        self._seen = {name: spaces.Box(-reach, reach) for name in self.possible_agents}

    def action_space(self, agent: str) -> Any:
        """The velocity that an agent orders."""
        return self._actions[agent]

    def observation_space(self, agent: str) -> Any:
        """What an agent sees."""
        return self._seen[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002  PettingZoo's
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
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
        middle = given.area.home_m
        own = {
            name: given.model_copy(update={"area": given.area.model_copy(
                update={"home_m": (middle[0] + x, middle[1] + y)})})
            for name, (x, y, _) in zip(self.possible_agents, self._homes.tolist(), strict=True)
        }  # fmt: skip
        served = make_vehicles(given, count=count, each=own, udp=(), logs=None, in_step=True)
        self._fleet = [Steered(each, "velocity") for each in served]
        self._world = hovering(dict(zip(self.possible_agents, self._fleet, strict=True)))
        self._goals = np.roll(self._places(), -(count // 2), axis=0)
        self.agents, self._cycles = [*self.possible_agents], 0
        self._away_m = np.linalg.norm(self._goals - self._places(), axis=1)
        return self._observed(), self._told()

    def step(self, actions: Mapping[str, Array]) -> tuple[dict[str, Any], ...]:
        """Order the velocities of all agents, and fly for 0.1 s."""
        if set(actions) != set(self.agents):
            raise InputError(f"actions of {sorted(actions)}: the agents are {self.agents}")
        numbers = [self.possible_agents.index(name) for name in self.agents]
        given = [checked(actions[name], 3, under_way=True) for name in self.agents]
        for n, action in zip(numbers, given, strict=True):
            self._fleet[n].set(action * self._most)
        flying = stepped(self._world, self._fleet)
        self._cycles += 1
        places, before_m = self._places(), self._away_m
        self._away_m = np.linalg.norm(self._goals - places, axis=1)
        apart_m = np.linalg.norm(places[:, None] - places, axis=2)
        np.fill_diagonal(apart_m, math.inf)
        near_m = np.maximum(self._separation_m - apart_m, 0.0).sum(axis=1)
        reward = before_m - self._away_m - near_m
        over = self._cycles >= self.max_cycles
        found = (
            self._observed(),
            {name: float(reward[n]) for name, n in zip(self.agents, numbers, strict=True)},
            {name: not flying[n] for name, n in zip(self.agents, numbers, strict=True)},
            dict.fromkeys(self.agents, over),
            self._told(),
        )
        left = [] if over else [n for n in numbers if flying[n]]
        self.agents = [self.possible_agents[n] for n in left]
        return found

    def _places(self) -> Floats:
        """Where all truly are (n, 3): east, north, up of the circle's middle."""
        truth = [enu(one.vehicle.aircraft.truth.pos_ned_m) for one in self._fleet]
        return np.array(truth) + self._homes

    def _observed(self) -> dict[str, Array]:
        beliefs = [one.vehicle.aircraft.belief for one in self._fleet]
        places = np.array([enu(each.pos_ned_m) for each in beliefs]) + self._homes
        speeds = np.array([enu(each.vel_ned_mps) for each in beliefs])
        seen, here = {}, [self.possible_agents.index(name) for name in self.agents]
        for name, me in zip(self.agents, here, strict=True):
            rows = np.zeros((len(places), 6))
            rows[0] = *(self._goals[me] - places[me]), *speeds[me]
            others = np.array([n for n in here if n != me], dtype=int)
            away = np.hstack((places[others] - places[me], speeds[others] - speeds[me]))
            nearest = np.argsort(np.linalg.norm(away[:, :3], axis=1), kind="stable")
            rows[1 : 1 + len(others)] = away[nearest]
            seen[name] = np.clip(rows, -_SEEN, _SEEN).astype(np.float32).ravel()
        return seen

    def _told(self) -> dict[str, dict[str, Any]]:
        least = np.full(len(self.possible_agents), math.inf)
        for each in self._world.least:
            for number in each.pair:
                least[number] = np.fmin(least[number], each.distance_m)
        return {
            name: {"separation_m": float(least[self.possible_agents.index(name)])}
            for name in self.agents
        }
