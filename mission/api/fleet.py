"""The vehicles of `aerofed.vehicles`: several in one world, on one clock."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import SupportsIndex, overload

import pandas as pd

from mission.api.life import Life, Simulated, is_time
from mission.api.simulated_vehicle import SimulatedVehicle
from mission.base.errors import InputError
from mission.flight.serve.hosts import BuiltInWorld, FirmwareHost, Order
from mission.flight.serve.separation import Pair


class Fleet(Simulated, Sequence[SimulatedVehicle]):
    """Simulated vehicles that share time, wind and ground, as a context manager. A sequence of
    them: `fleet[0]`, `fleet["vehicle-1"]`, `first, second = fleet`.

    Where time is ordered it passes for all, in `step`, `until` and `fly` of the fleet or of one.
    """

    KIND = "fleet"

    def __init__(self, world: BuiltInWorld | FirmwareHost) -> None:
        self._life = Life(world)
        self._vehicles = {host.name: SimulatedVehicle(host, self._life) for host in world.hosts}

    @property
    def names(self) -> tuple[str, ...]:
        """The vehicles' names, in order."""
        return tuple(self._vehicles)

    def __len__(self) -> int:
        return len(self._vehicles)

    @overload
    def __getitem__(self, key: SupportsIndex | str) -> SimulatedVehicle: ...

    @overload
    def __getitem__(self, key: slice) -> list[SimulatedVehicle]: ...

    def __getitem__(
        self, key: SupportsIndex | str | slice
    ) -> SimulatedVehicle | list[SimulatedVehicle]:
        return (
            self._vehicles[self._named(key)]
            if isinstance(key, str)
            else [*self._vehicles.values()][key]
        )

    def _named(self, key: object) -> str:
        if isinstance(key, int) and not isinstance(key, bool) and -len(self) <= key < len(self):
            return self.names[key]
        if key in self._vehicles:
            return str(key)
        raise InputError(f"{key!r}: no vehicle of these: {', '.join(self.names)}")

    @property
    def t_s(self) -> float:
        """Simulated seconds since all were switched on."""
        return self._life.look(lambda: self._life.world.t_ns) * 1e-9

    def step(self, seconds: float) -> None:
        """Let simulated time pass for all; arguments and errors are those of a vehicle's `step`."""
        self[0].step(seconds)

    def _where(self) -> str:
        return ": " + "; ".join(
            f"{name} in mode {each.mode} at height {each.height_m:.1f} m"
            for name, each in self._vehicles.items()
        )

    def fly(
        self,
        plans: Mapping[str | int, Path | str] | Sequence[Path | str],
        *,
        after_s: Mapping[str | int, float] | None = None,
    ) -> None:
        """Fly plan files from the ground to the ground, all begun at one instant.

        fleet.fly({"vehicle-1": "a.plan", "vehicle-2": "b.plan"}, after_s={"vehicle-2": 5})

        Args:
            plans: by name or number from 0, or in the vehicles' order; the others stay.
            after_s: simulated seconds by which some begin later.

        Raises:
            InputError: a plan holds what may not be flown here, or its vehicle is armed.
            FlightError: a vehicle refused its plan, left it, or is lost. The others flew theirs.
        """
        given = dict(plans) if isinstance(plans, Mapping) else dict(enumerate(plans))
        late = {self._named(key): value for key, value in (after_s or {}).items()}
        for name, value in late.items():
            if not is_time(value):
                raise InputError(f"after_s of {name}: {value!r}: must be simulated seconds")
        orders: dict[str, Order] = {}
        for key, plan in given.items():
            if (name := self._named(key)) in orders:
                raise InputError(f"fly: {name} is given two plans; leave one of them out")
            orders[name] = self._vehicles[name].order(plan)
        if unused := [name for name in late if name not in orders]:
            raise InputError(f"after_s: {unused[0]} has no plan here")
        if not orders:
            raise InputError("fly: no plan is given")
        after = {name: float(value) for name, value in late.items()}
        errors = self._life.do(lambda: self._life.world.fly(orders, after))
        if errors:
            first = next(iter(errors.values()))
            raise first.in_words("; ".join(f"{name}: {error}" for name, error in errors.items()))

    def separation(self) -> pd.DataFrame:
        """The least distance so far of each pair of which one flew, by true positions.

        A row each: `one`, `two`, `least_m` (3D), `horizontal_m` and `vertical_m` of it, `t_s`, and
        where the middle of the two was: `x_m` east and `y_m` north of the first home, `height_m`.
        """
        pairs = self._life.look(lambda: self._life.world.pairs)
        return pd.DataFrame(pairs, columns=Pair._fields)
