"""One round as a planner sees it, decided stop by stop."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aerofed.gym.actions import checked
from fl.radio.place import AverageRadio, Radio
from fl.radio.uplink import Gate, deliver
from flightdyn.random import RandomStreams
from mission.api.configuring import Source, config, folder
from mission.base import polyline
from mission.base.area import Area
from mission.base.arrays import Bools, Floats
from mission.base.errors import InputError
from mission.config.models import RunConfig
from mission.planner.evaluate import check_problem, in_time, objective
from mission.planner.flyable import foresee_round, share_of
from mission.planner.limits import WITHIN_ROUNDING
from mission.planner.plan import PlannedPath, RoundPlan
from mission.planner.problem import RoundProblem
from mission.scenario.radios import believed, radio_of
from mission.scenario.scenario import build_scenario, device_places
from mission.scenario.strategies import longest

Observation: TypeAlias = dict[str, NDArray[Any]]

_HALVINGS = 20  # of a leg that takes more time or energy than is left
_SHORTER = 1.0 - 1e-12  # keeps rounding from putting a path over its budget


class RoundEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A round in which each action is a stop: who sends there, and where to go next.

    Action (2 + K,), each in [-1, 1]: the place of the next stop, then how much it matters that each
    device sends now. Of those above 0 the first `per_step` send, each device once in a round. A leg
    leads around areas, and ends where metres, time or energy do. At the last stop the place means
    nothing.

    Observation: `position` (2,) and `devices` (K, 2) in the action's unit; `importance` (K,);
    `asked` and `heard` (K,), who has sent and whose update has arrived; `left` (4,), the shares of
    stops, metres, time and energy that are left (1 where there is no limit).

    The reward is the importance of the updates that arrive, drawn as a run draws them. Its mean is
    `expected` in the step's information; where the channel decides what arrives, the sum of that is
    the value of `plan`.
    """

    def __init__(
        self,
        problem: RoundProblem | None = None,
        *,
        source: Source = "quickstart",
        overrides: Mapping[str, object] | None = None,
        data_dir: Path | str | None = None,
    ) -> None:
        """Each episode is `problem`; without one the first round of a configuration, whose devices
        stand elsewhere each time, as they do in runs of other seeds.

        Raises:
            InputError: the problem or the configuration is refused.
        """
        self._draws: tuple[RunConfig, Area] | None = None
        self._is_believed = True  # the radio of `_problem`, by who plans
        self._gate: Gate = "average"
        self._radio: Radio
        if problem is None:
            scenario = build_scenario(config(source, overrides), data_dir=folder(data_dir))
            problem, size_m = scenario.first_problem(), scenario.area.size_m
            self._draws = scenario.config, scenario.area
            self._gate = scenario.config.channel.gate
        check_problem(problem)
        if problem.altitudes_m is not None:
            raise InputError(
                f"altitudes_m = {list(problem.altitudes_m)}: must be None here, where a round is "
                "flown at the channel's altitude"
            )
        seen_m = np.vstack((problem.devices_m, problem.start_m))
        if self._draws is not None:
            seen_m = np.array([(0.0, 0.0), size_m])
        low_m, high_m = seen_m.min(axis=0), seen_m.max(axis=0)
        self._middle_m = (low_m + high_m) / 2.0
        self._half_m = max(1.0, float((high_m - low_m).max()) / 2.0)
        self._problem, count = problem, len(problem.devices_m)
        self._n = problem.steps  # no round is under way
        most = max(1.0, float(problem.importance.max()))
        self.action_space = spaces.Box(-1.0, 1.0, (2 + count,))
        self.observation_space = spaces.Dict(
            position=spaces.Box(-1.0, 1.0, (2,)),
            devices=spaces.Box(-1.0, 1.0, (count, 2)),
            importance=spaces.Box(0.0, most, (count,)),
            asked=spaces.MultiBinary(count),
            heard=spaces.MultiBinary(count),
            left=spaces.Box(0.0, 1.0, (4,)),
        )

    @property
    def problem(self) -> RoundProblem:
        """The planning problem of this episode, with what its configuration believes of the radio.

        Raises:
            InputError: a map is believed, and not of these devices.
        """
        if self._draws is not None and not self._is_believed:
            problem, (asked, area) = self._problem, self._draws
            grid, _ = believed(asked, problem.channel, self._radio, area, problem.devices_m)
            self._problem, self._is_believed = replace(problem, per_grid=grid), True
        return self._problem

    @property
    def plan(self) -> RoundPlan:
        """The plan as decided so far; for the rest of the round the aircraft stands still."""
        problem = self.problem
        via = () if problem.airspace.is_open else tuple(self._via)
        path = PlannedPath(self._waypoints_m.copy(), via)
        plan = RoundPlan((path,), self._schedule[None].copy(), 0.0)
        in_turn = plan.schedule & in_time(problem, plan)
        return replace(plan, value=objective(problem, plan.waypoints_m, in_turn[0]))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a round; there are no options."""
        super().reset(seed=seed, options=options)
        if self._draws is not None:
            streams = RandomStreams(int(self.np_random.integers(2**31)))
            asked, area = self._draws
            devices_m, channel = device_places(asked, area, streams), self._problem.channel
            self._radio = radio_of(asked, channel, area, devices_m, streams)
            self._problem = replace(self._problem, devices_m=devices_m, per_grid=None)
            self._is_believed = False
        else:
            self._radio = AverageRadio(self._problem.channel, self._problem.devices_m)
        problem, count = self._problem, len(self._problem.devices_m)
        self._n, self._flown_m = 0, 0.0
        self._waypoints_m = np.tile(problem.start_m, (problem.steps, 1))
        self._via = [np.empty((0, 2))] * (problem.steps - 1)
        self._schedule = np.zeros((problem.steps, count), dtype=np.bool_)
        self._heard = np.zeros(count, dtype=np.bool_)
        return self._observed(), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Send, draw what arrives, and go on to the next stop."""
        problem = self._problem
        given = checked(action, 2 + len(problem.devices_m), under_way=self._n < problem.steps)
        sends = self._send(given[2:])
        here_m = (*self._waypoints_m[self._n], problem.channel.altitude_m)
        arrivals = deliver(
            self._radio,
            np.tile(here_m, (len(sends), 1)),
            transmitted=sends,
            rng=self.np_random,
            gate=self._gate,
        )
        self._heard |= arrivals.delivered
        self._n += 1
        if self._n < problem.steps:
            self._go(self._middle_m + self._half_m * given[:2])
        reward = float(problem.importance @ arrivals.delivered)
        info = {"expected": float(problem.importance @ (1.0 - arrivals.per))}
        return self._observed(), reward, self._n == problem.steps, False, info

    def _send(self, priorities: Floats) -> Bools:
        """Choose by priority who sends at this stop; return those (K,) whose update is ready."""
        wanted = (priorities > 0.0) & ~self._schedule.any(axis=0)
        row: Bools = self._schedule[self._n]
        for device in np.argsort(-priorities, kind="stable").tolist():
            if wanted[device] and row.sum() < self._problem.per_step:
                row[device] = True
                row[device] = self._fits()
        if self._problem.ready_in_s is None:
            return row
        return np.asarray(row & in_time(self._problem, self.plan)[0, self._n])

    def _fits(self) -> bool:
        """Whether the plan so far keeps to the limits of time and energy."""
        limited = self._problem.limits is not None
        return not limited or share_of(self._problem, self.plan) <= WITHIN_ROUNDING

    def _go(self, place_m: Floats) -> None:
        """Fly towards a place (2,), as far as metres, time and energy allow."""
        here = self._waypoints_m[self._n - 1]
        way, _ = self._problem.airspace.route(np.stack((here, place_m)))
        along_m = polyline.along(way)

        def go(metres: float) -> None:
            self._via[self._n - 1] = way[1:-1][along_m[1:-1] < metres]
            self._waypoints_m[self._n :] = polyline.at(metres, along_m, way)

        def fits(metres: float) -> bool:
            go(metres)
            return self._fits()

        most_m = min(along_m[-1], (self._problem.most_m - self._flown_m) * _SHORTER)
        flown_m = longest(most_m, fits, halvings=_HALVINGS)
        go(flown_m)
        self._flown_m += flown_m

    def _observed(self) -> Observation:
        problem = self._problem
        used = [self._n / problem.steps, self._flown_m / max(problem.most_m, 1e-9), 0.0, 0.0]
        if (limits := problem.limits) is not None:
            foreseen = foresee_round(problem, self.plan)
            used[2:] = foreseen.duration_s / limits.duration_s, foreseen.energy_j / limits.energy_j
        at = self._waypoints_m[min(self._n, problem.steps - 1)]
        return {
            "position": self._seen(at),
            "devices": self._seen(problem.devices_m),
            "importance": problem.importance.astype(np.float32),
            "asked": np.asarray(self._schedule.any(axis=0), dtype=np.int8),
            "heard": self._heard.astype(np.int8),
            "left": np.clip(1.0 - np.array(used), 0.0, 1.0).astype(np.float32),
        }

    def _seen(self, places_m: Floats) -> NDArray[np.float32]:
        """Places in the action's unit; what lies beside the area is seen at its edge."""
        seen = np.clip((places_m - self._middle_m) / self._half_m, -1.0, 1.0)
        return np.asarray(seen, dtype=np.float32)
