"""The vehicle of `aerofed.vehicle`: simulated time passes in it as its user says."""

import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from flightdyn.state import GeodeticPoint
from mission.api.comparing import compare
from mission.api.comparison import Comparison
from mission.api.configuring import as_path
from mission.api.life import Life, Simulated, is_time
from mission.base.arrays import Floats
from mission.base.errors import InputError
from mission.flight.missions.plan_check import checked_path, placed
from mission.flight.missions.plan_file import read_plan_file
from mission.flight.pilot.connection import connect
from mission.flight.serve.hosts import BuiltIn, FirmwareHost, Order, State, enu, pymavlink_client


class SimulatedVehicle(Simulated):
    """A simulated vehicle, as a context manager; inside, it is to be used from one thread.

    It is heard and answered at `url` at any time. Where its host's time is ordered, simulated time
    passes in `step`, `until` and `fly` only (of a firmware also while it answers), so that what
    comes out does not depend on how fast the machine is: what was sent before a step is taken
    before it. Positions are metres: x east and y north of home, height above home.
    """

    KIND = "vehicle"

    def __init__(self, host: BuiltIn | FirmwareHost, life: Life) -> None:
        self._host, self._life = host, life

    @property
    def url(self) -> str:
        """URL for MAVSDK; pymavlink takes `udpout:` in place of `udpout://`."""
        self._life.check_open()
        return f"udpout://127.0.0.1:{self._host.port.port}"

    @property
    def _state(self) -> State:
        return self._life.look(lambda: self._host.state)

    @property
    def t_s(self) -> float:
        """Simulated seconds since the vehicle was switched on."""
        return self._state.truth.t_ns * 1e-9

    @property
    def position_m(self) -> Floats:
        """True position (3,): x east and y north of home, height above home."""
        return enu(self._state.truth.pos_ned_m)

    @property
    def velocity_mps(self) -> Floats:
        """True velocity (3,): east, north, up."""
        return enu(self._state.truth.vel_ned_mps)

    @property
    def height_m(self) -> float:
        """True height above home."""
        return float(self.position_m[2])

    @property
    def armed(self) -> bool:
        """Whether the motors may run."""
        return self._state.armed

    @property
    def mode(self) -> str:
        """The flight mode: of the built-in autopilot by PX4's names, "HOLD", "MISSION" ..., of a
        firmware by MAVSDK's."""
        return self._state.mode

    @property
    def battery(self) -> float:
        """Battery charge that is left, 0 to 1."""
        return self._state.battery

    def step(self, seconds: float) -> None:
        """Let simulated time pass, as fast as the machine can.

        Raises:
            InputError: it is no time, or time passes by itself here.
            FlightError: the aircraft left the range of its physics.
        """
        if not is_time(seconds) or not seconds:
            raise InputError(
                f"step({seconds!r}): simulated seconds, more than 0, less than a million"
            )
        if self._life.world.runs != "ordered":
            raise InputError("step: time passes by itself here; it waits with pace='steps' only")
        self._life.do(lambda: self._life.world.run_for(float(seconds)))

    def _where(self) -> str:
        x, y, height = self.position_m
        return (
            f"; the vehicle is in mode {self.mode}, {'armed' if self.armed else 'disarmed'}, at "
            f"x = {x:.1f} m, y = {y:.1f} m, height {height:.1f} m"
        )

    def fly(self, plan: Path | str) -> None:
        """Fly a plan file from the ground to the ground, by MAVSDK, as `aerofed fly` does.

        Raises:
            InputError: the plan holds what may not be flown here, or the vehicle is armed.
            FlightError: the vehicle refuses it, leaves it, or is lost.
        """
        orders = {self._host.name: self.order(plan)}
        for error in self._life.do(lambda: self._life.world.fly(orders, {})).values():
            raise error

    def order(self, plan: Path | str) -> Order:
        """The plan file, checked and placed at home, and its path.

        Raises:
            InputError: as `fly`.
        """
        file = read_plan_file(as_path(plan, "plan"))
        if self.armed:
            raise InputError(f"fly({file.path}): the vehicle is armed; a plan begins on the ground")
        home, host = self._host.area.home, self._host

        def begun_at(home: GeodeticPoint) -> Order:
            moved = replace(file, items=placed(file.items, home))
            return moved, checked_path(
                moved, home, parameters=host.parameters, limits=host.guidance
            )

        try:
            return begun_at(home)
        except InputError as error:
            if file.home is None or file.home == home or math.isnan(file.home.alt_msl_m):
                raise
            begun_at(file.home)  # raises what would be wrong there, too
            begin = f"aerofed.vehicle(home={str(file.path)!r}) stands at the plan's own home"
            raise error.in_words(f"{error}; {begin}") from None

    def mavlink(self) -> Any:
        """Open a pymavlink connection that has heard the vehicle; it closes with the vehicle.

        Raises:
            LinkLostError: it does not answer.
        """
        self._life.check_open()
        return self._life.clients.enter_context(closing(pymavlink_client(self.url)))

    @asynccontextmanager
    async def mavsdk(self) -> AsyncIterator[Any]:
        """`async with vehicle.mavsdk() as system:` connects MAVSDK, for its plug-ins.

        Raises:
            LinkLostError: the vehicle does not answer.
        """
        self._life.check_open()
        async with connect(self.url) as pilot:
            yield pilot.system

    def truth(self) -> pd.DataFrame:
        """True positions so far: `t_s`, `x_m`, `y_m`, `height_m`; ten rows a simulated second,
        under a firmware one at each position that it tells."""
        rows = self._life.look(lambda: list(self._host.track.rows))
        return pd.DataFrame(rows, columns=["t_s", "x_m", "y_m", "height_m"], dtype=float)

    def compare(self, plan: Path | str | None = None) -> Comparison:
        """Compare the last flight that has landed with `plan`, else with the missions it was given.

        vehicle.compare("survey.plan").check(cross_track_max_m=2)

        Raises:
            InputError: no flight is logged, or it cannot be compared.
        """
        return compare(self.log, plan=None if plan is None else as_path(plan, "plan"))

    @property
    def log(self) -> Path:
        """The log of the last flight that has landed.

        Raises:
            InputError: there is none, or no folder for logs.
        """
        logs = [] if self._host.logs is None else self._host.logs.written
        if not logs:
            raise InputError(
                "no flight is logged: a log goes from arming to disarming, and needs logs=FOLDER"
            )
        return logs[-1]
