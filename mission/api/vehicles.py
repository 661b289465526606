"""Simulated vehicles for tests, and flights of plan files."""

import math
import os
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from mission.api.configuring import Source, as_path, checked, config_of
from mission.api.runs import Run, flown
from mission.base.errors import InputError
from mission.config import OF_FLIGHT, OF_VEHICLE
from mission.flight.serve import PX4_HOME
from sitl.config import BINARIES

if TYPE_CHECKING:
    from mission.api.fleet import Fleet
    from mission.api.simulated_vehicle import SimulatedVehicle
    from mission.config.models import RunConfig
    from sitl.pace import Runs

Pace: TypeAlias = Literal["steps", "moving"] | float
Home: TypeAlias = tuple[float, float, float] | Path | str
Firmware: TypeAlias = Literal["px4", "arducopter"]

_FIRMWARES = {"px4": "px4", "arducopter": "ardupilot"}  # as vehicle.autopilot calls them


class NoFirmwareError(InputError):
    """No binary is known of a firmware: AEROFED_PX4 or AEROFED_ARDUCOPTER is not set."""


def vehicle(
    overrides: Mapping[str, object] | None = None,
    *,
    source: "Source | None" = None,
    wind_mps: float | None = None,
    seed: int | None = None,
    home: "Home | None" = None,
    firmware: "Firmware | None" = None,
    pace: Pace = "steps",
    logs: Path | str | None = None,
) -> "SimulatedVehicle":
    """A vehicle on the ground, ready to be armed: with aerofed.vehicle(wind_mps=6) as vehicle: ...

    Args:
        overrides: values by dotted key of vehicle.*, area.home_*, link.signing_key and the seed:
            {"vehicle.aircraft.faults": [{"kind": "gnss_off", "after": "take-off", "at_s": 5}]}.
        source: a configuration or its file, as of `aerofed sitl`.
        wind_mps: sets vehicle.aircraft.wind.speed_mps.
        seed: sets the seed, of gusts and of what the sensors add.
        home: degrees north, degrees east, metres above mean sea level; or a plan file, for its
            planned home. Default: where PX4's simulators stand.
        firmware: "px4" or "arducopter" flies it, the binary that AEROFED_PX4 or
            AEROFED_ARDUCOPTER names; overrides of vehicle.autopilot and vehicle.firmware.path do
            the same. Default: the built-in autopilot.
        pace: "steps": simulated time passes in `step`, `until` and `fly` only, of a firmware also
            while it answers. "moving": it passes by itself, as fast as it can, while a manoeuvre is
            under way (not of a firmware). A number: always, at that many times real time, for
            scripts that wait in wall time.
        logs: folder for a log of each flight, from arming to disarming.

    Raises:
        InputError: a key or a value is refused.
        LinkLostError: no port can be had.
    """
    (one,) = _made(
        1, overrides, {}, source=source, wind_mps=wind_mps, seed=seed, home=home, firmware=firmware,
        pace=pace, logs=logs,
    )  # fmt: skip
    return one


def vehicles(
    count: int | Sequence[str],
    overrides: Mapping[str, object] | None = None,
    *,
    each: Mapping[str, Mapping[str, object]] | None = None,
    source: "Source | None" = None,
    wind_mps: float | None = None,
    seed: int | None = None,
    home: "Home | None" = None,
    firmware: "Firmware | None" = None,
    pace: Pace = "steps",
    logs: Path | str | None = None,
) -> "Fleet":
    """Several vehicles in one world: one clock, one wind, one ground, and they can collide.

    with aerofed.vehicles(3) as fleet:
        fleet.fly(["a.plan", "b.plan", "c.plan"])
        assert fleet.separation().least_m.min() > 5

    They stand 5 m apart towards the east and have system ids 1, 2, ... A firmware flies one. Other
    arguments and errors are those of `vehicle`.

    Args:
        count: how many, called vehicle-1, vehicle-2, ...; or their names.
        overrides: as of `vehicle`, for all.
        each: overrides of single ones by name, such as faults, or a home of its own:
            {"vehicle-2": {"vehicle.aircraft.battery.initial": 0.3, "area.home_m": [460, 400]}}.
    """
    return _made(
        count, overrides, each or {}, source=source, wind_mps=wind_mps, seed=seed, home=home,
        firmware=firmware, pace=pace, logs=logs,
    )  # fmt: skip


def _made(
    count: int | Sequence[str],
    overrides: Mapping[str, object] | None,
    each: Mapping[str, Mapping[str, object]],
    *,
    pace: Pace,
    logs: Path | str | None,
    **described: Any,
) -> "Fleet":
    """Vehicles that are not open yet; `described` goes to `vehicle_config`."""
    paced = isinstance(pace, Real) and 0.0 < pace <= 1000.0
    if not paced and not (isinstance(pace, str) and pace in ("steps", "moving")):
        raise InputError(
            f"pace = {pace!r}: 'steps', 'moving', or times real time: more than 0, at most 1000"
        )
    named = isinstance(count, list | tuple) and all(isinstance(name, str) for name in count)
    if not named and not isinstance(count, Integral):
        raise InputError(f"count = {count!r}: must be a whole number of vehicles, or their names")
    if not isinstance(each, Mapping):
        raise InputError(f"each = {each!r}: must be a dictionary of overrides by vehicle's name")
    resolved = vehicle_config(overrides, **described)
    own = {
        name: vehicle_config({**(overrides or {}), **checked_keys(name, keys)}, **described)
        for name, keys in each.items()
    }
    # Only now, so that wrong input is answered at once.
    from mission.api.fleet import Fleet
    from mission.flight.serve.hosts import BuiltInWorld, FirmwareHost
    from mission.flight.serve.vehicle import make_vehicles, names_of

    folder = None if logs is None else as_path(logs, "logs")
    speed = float(pace) if paced else math.inf
    runs: Runs = "ordered" if pace == "steps" else "moving" if pace == "moving" else "always"
    if resolved.vehicle.autopilot == "built-in":
        made = make_vehicles(
            resolved, count=count, each=own, udp=(), logs=folder, in_step=pace == "steps"
        )
        return Fleet(BuiltInWorld(made, speed=speed, runs=runs))
    names = names_of(count)
    if len(names) > 1:
        raise InputError(f"count = {len(names)}: a firmware flies one vehicle")
    own_config = own.get(names[0], resolved)
    return Fleet(FirmwareHost(own_config, logs=folder, speed=speed, runs=runs))


def checked_keys(name: str, keys: object) -> Mapping[str, object]:
    """The overrides of one vehicle; InputError where they are none."""
    if not isinstance(keys, Mapping):
        raise InputError(
            f"each[{name!r}] = {keys!r}: must be a dictionary, such as "
            "{'vehicle.aircraft.battery.initial': 0.3}"
        )
    return keys


def _firmware_keys(firmware: Firmware) -> dict[str, object]:
    """Return the overrides that let a firmware fly the vehicle."""
    if not isinstance(firmware, str) or firmware not in _FIRMWARES:
        raise InputError(f"firmware = {firmware!r}: must be 'px4' or 'arducopter'")

    autopilot = _FIRMWARES[firmware]
    variable = BINARIES[autopilot]
    if not (path := os.environ.get(variable)):
        raise NoFirmwareError(f"firmware = {firmware!r}: {variable} names no binary")
    return {"vehicle.autopilot": autopilot, "vehicle.firmware.path": path}


def vehicle_config(
    overrides: Mapping[str, object] | None = None,
    *,
    source: "Source | None" = None,
    wind_mps: float | None = None,
    seed: int | None = None,
    home: "Home | None" = None,
    firmware: "Firmware | None" = None,
) -> "RunConfig":
    """The configuration of a vehicle that stands alone; arguments and errors are `vehicle`'s."""

    checked("quickstart" if source is None else source, overrides)
    given = {
        **(PX4_HOME if source is None else {}),
        **({} if firmware is None else _firmware_keys(firmware)),
        **(overrides or {}),
        **({} if wind_mps is None else {"vehicle.aircraft.wind.speed_mps": wind_mps}),
        **({} if seed is None else {"seed": seed}),
        **({} if home is None else dict(zip(PX4_HOME, _place(home), strict=True))),
    }
    return config_of("quickstart" if source is None else source, given, OF_VEHICLE)


def _place(home: Home) -> tuple[float, float, float]:
    """Latitude and longitude (deg) and altitude (m) of a home."""
    if isinstance(home, str | Path):
        from mission.flight.missions.plan_file import read_plan_file

        home_of_plan = read_plan_file(Path(home)).home
        if home_of_plan is None or math.isnan(home_of_plan.alt_msl_m):
            raise InputError(f"home = {str(home)!r}: the plan has no planned home with an altitude")
        return home_of_plan.lat_deg, home_of_plan.lon_deg, home_of_plan.alt_msl_m
    try:
        lat_deg, lon_deg, alt_msl_m = home
    except (TypeError, ValueError):
        raise InputError(
            f"home = {home!r}: (degrees north, degrees east, metres above sea), or a plan file"
        ) from None
    return lat_deg, lon_deg, alt_msl_m


def fly(
    plan: Path | str,
    overrides: Mapping[str, object] | None = None,
    *,
    source: "Source" = "quickstart",
    out: Path | str | None = None,
    quiet: bool = True,
) -> Run:
    """Fly a plan file, as `aerofed fly` does: the same plan and seed give the same bytes.

    aerofed.compare(aerofed.fly("survey.plan", {"vehicle.aircraft.wind.speed_mps": 8}))

    Args:
        plan: a QGroundControl .plan or a waypoint file (.waypoints, .txt, .mission).
        overrides: values by dotted key of vehicle.*, link.* and limits.*, and the seed.
        source: a configuration or its file, of which vehicle.*, link.* and limits.* count.
        out: new or empty folder for log and track; default: a new one under runs/.
        quiet: show nothing; False shows what `aerofed fly` shows.

    Raises:
        LimitsNotMetError: it is flown, and does not meet a limit of the table [limits].
        AerofedError: what else `aerofed fly` would end with. What was flown stays in `out`.
        KeyboardInterrupt: it was interrupted.
    """
    from mission.base.run_folder import output_folder
    from mission.run.plan_flight import fly_plan

    file, resolved = as_path(plan, "plan"), config_of(source, overrides, OF_FLIGHT)
    given = None if out is None else as_path(out, "out")
    with output_folder(given, file.stem) as path:
        return flown(
            lambda around: fly_plan(resolved, file, path, around), path, resolved.limits,
            quiet=quiet, goes_on=False, figures=False,
        )  # fmt: skip
