"""A real firmware on the simulated aircraft, alone in its world."""

import asyncio
import math
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp

from pymavlink.dialects.v20 import common as mav

from flightdyn.random import RandomStreams
from mission.base.errors import AerofedError, InputError
from mission.config.models import RunConfig
from mission.flight.flyers.base import Attached, Task
from mission.flight.flyers.firmware import FirmwareBackend
from mission.flight.missions.round_mission import Demand
from mission.flight.serve.flight_logs import FlightLogs
from mission.flight.serve.hosts import Host, Order, State
from mission.flight.serve.separation import Pair
from mission.flight.serve.vehicle import FIRST
from mission.scenario.limits import guidance_of
from sitl.autopilot.parameters import parameters_of
from sitl.firmware.clock import FirmwareClock
from sitl.pace import Runs

_POLL_S = 0.001  # wall time
_ANYTHING = Demand(speed_mps=0.0, altitude_m=0.0, distance_m=0.0, acceptance_m=math.inf)


class FirmwareHost(Host):
    """PX4 or ArduCopter, host and world in one. Ordered time also runs, no faster than wall
    time, while a client is being answered: a firmware answers in its own time."""

    def __init__(self, config: RunConfig, *, logs: Path | None, speed: float, runs: Runs) -> None:
        """Prepare the firmware, at `speed` times real time; the rest is as for `aerofed.vehicle`.

        Raises:
            InputError: there is no such firmware, or a setting is refused.
        """
        if runs == "moving":
            raise InputError(
                "pace = 'moving': of a firmware time passes in 'steps', or at a number of times "
                "real time"
            )
        area, ordered = config.area.build(), runs == "ordered"
        recorder = None if logs is None else FlightLogs(logs, area=area)
        super().__init__(FIRST, area, guidance_of(config.vehicle), recorder)
        self.runs, self.hosts = runs, [self]
        link = config.link.model_copy(update={"speed": "max" if ordered else speed})
        config = config.model_copy(update={"link": link})
        self.parameters = parameters_of(config.vehicle)  # of the built-in one
        self._backend = FirmwareBackend.of(
            Task(config, area, RandomStreams(config.seed), _ANYTHING)
        )
        self._backend.check()
        self._folder = logs

    @asynccontextmanager
    async def alive(self) -> AsyncIterator[None]:
        observers = (self.track, *(() if self.logs is None else (self.logs,)))
        said: list[str] = []  # what people are told of it is in its log, too
        with (
            TemporaryDirectory(prefix="aerofed-")
            if self._folder is None
            else nullcontext(mkdtemp(prefix="firmware-", dir=self._folder))
        ) as home:
            attached = Attached(observers, Path(home), said.append, (self.port,))
            async with self._backend.open(attached) as self._flyer:
                clock = self._flyer.vehicle.clock
                assert isinstance(clock, FirmwareClock)
                with clock.going():
                    await self._flyer.ready()
                clock.answers = self.runs == "ordered"
                if self.runs == "always":
                    clock.run()
                yield

    @property
    def state(self) -> State:
        now, flyer = self._flyer.vehicle.clock.truth.newest, self._flyer
        return State(now.kinematics, self.track.mode, flyer.pilot.armed, now.battery.remaining)

    @property
    def t_ns(self) -> int:
        return self._flyer.vehicle.clock.truth.newest.kinematics.t_ns

    @property
    def pairs(self) -> list[Pair]:
        return []

    async def run_for(self, seconds: float) -> None:
        vehicle = self._flyer.vehicle
        until_ns = vehicle.plant.t_ns + round(seconds * 1e9)
        vehicle.relay.take_orders()
        vehicle.clock.run(until_ns)
        try:
            while vehicle.plant.t_ns < until_ns:  # noqa: ASYNC110  in another thread
                await asyncio.sleep(_POLL_S)
        finally:
            vehicle.clock.rest()

    async def fly(
        self,
        orders: Mapping[str, Order],
        after_s: Mapping[str, float],  # noqa: ARG002  nobody is before it
    ) -> Mapping[str, AerofedError]:
        plan, path = orders[self.name]
        if self.logs is not None:
            self.logs.took(self._flyer.t_ns, mav.MAV_MISSION_TYPE_MISSION, plan.items)
        await self._flyer.carry_out(plan, path, begins=lambda: None)
        return {}
