"""A vehicle flown by setpoints at 10 Hz, through its autopilot."""

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias, get_args

import gymnasium
import numpy as np
from gymnasium import spaces

from aerofed.gym.actions import checked, within
from aerofed.gym.steered import SEEN, Array, Setpoint, Steered, hovering, largest, stepped
from mission.api.configuring import Source
from mission.api.vehicles import vehicle_config
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.flight.serve.vehicle import make_vehicles

Reward: TypeAlias = Callable[[Array, Array, Array], float]

_HEIGHTS_M = 10.0, 30.0  # of places to fly to
_OF_A_FLIGHT = "_steered", "_world"


class SetpointEnv(gymnasium.Env[Array, Array]):
    """A flight from a hover at 20 m to a place that is drawn anew for each episode.

    Action (3,), each in [-1, 1]: velocity or acceleration to order for the next 0.1 s, to east,
    north and up, as shares of the vehicle's limits. A MAVLink message takes it to the built-in
    autopilot, which flies it by its own estimate, in the wind.

    Observation (6,): metres to the place from where the autopilot believes to be, and the velocity
    that it believes in, m/s; to east, north and up. `offset_m` and `velocity_mps` in the step's
    information are the truth.

    The reward is by how many metres the vehicle has truly come nearer, or what `reward` makes of an
    observation, the action, and the observation after it. An episode ends where the autopilot no
    longer takes setpoints: on the ground, or after a failure.
    """

    def __init__(
        self,
        setpoint: Setpoint = "velocity",
        *,
        reward: Reward | None = None,
        far_m: float = 40.0,
        overrides: Mapping[str, object] | None = None,
        source: "Source | None" = None,
        wind_mps: float | None = None,
    ) -> None:
        """Places lie up to `far_m` away, 10 to 30 m high; the rest is that of `aerofed.vehicle`.

        Raises:
            InputError: a value is refused.
        """
        if setpoint not in get_args(Setpoint):
            raise InputError(f"setpoint = {setpoint!r}: must be 'velocity' or 'acceleration'")
        within(far_m=(far_m, 500))
        self._config = vehicle_config(overrides, source=source, wind_mps=wind_mps)
        self._most = largest(self._config, setpoint)
        self._setpoint, self._reward, self._far_m = setpoint, reward, far_m
        self._under_way = False
        self.action_space = spaces.Box(-1.0, 1.0, (3,))
        self.observation_space = spaces.Box(-SEEN, SEEN)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Take off in a new vehicle; there are no options.

        Raises:
            FlightError: it does not come to hover, as where faults keep it on the ground.
        """
        super().reset(seed=seed, options=options)
        self._under_way = False
        way, share = self.np_random.uniform(0.0, 2.0 * math.pi), self.np_random.uniform()
        far_m, height_m = share * self._far_m, self.np_random.uniform(*_HEIGHTS_M)
        self._place_m = np.array([far_m * math.cos(way), far_m * math.sin(way), height_m])
        given = self._config.model_copy(update={"seed": int(self.np_random.integers(2**31))})
        (served,) = make_vehicles(given, udp=(), logs=None, in_step=True)
        self._steered = Steered(served, self._setpoint)
        self._world = hovering({"vehicle": self._steered})
        self._seen, self._under_way = self._observed(), True
        return self._seen, self._truth()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Order a setpoint, and fly for 0.1 s."""
        given = checked(action, 3, under_way=self._under_way)
        before, before_m = self._seen, self._away_m
        self._steered.set(given * self._most)
        (self._under_way,) = stepped(self._world, {"vehicle": self._steered}).values()
        self._seen = self._observed()
        reward = before_m - self._away_m
        if self._reward is not None:
            reward = float(self._reward(before, action, self._seen))
        return self._seen, reward, not self._under_way, False, self._truth()

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled and copied, which is no flight: its aircraft lives outside of Python."""
        if self._under_way:
            raise InputError(
                "Setpoint-v0: a flight under way cannot be pickled or copied, only before reset(); "
                "the same seed and actions fly the same"
            )
        return {name: value for name, value in vars(self).items() if name not in _OF_A_FLIGHT}

    @property
    def _away_m(self) -> float:
        return float(np.linalg.norm(self._place_m - self._steered.truth[:3]))

    def _observed(self) -> Array:
        offset_m, velocity_mps = self._seen_by(self._steered.belief)
        seen = np.concatenate((offset_m, velocity_mps)).astype(np.float32)
        return np.clip(seen, -SEEN, SEEN)

    def _truth(self) -> dict[str, Any]:
        offset_m, velocity_mps = self._seen_by(self._steered.truth)
        return {"offset_m": offset_m, "velocity_mps": velocity_mps}

    def _seen_by(self, state: Floats) -> tuple[Floats, Floats]:
        """(3,) metres to the place and (3,) velocity."""
        return self._place_m - state[:3], state[3:]
