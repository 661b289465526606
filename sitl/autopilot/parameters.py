"""The vehicle's parameters: names, meaning and limits in one table, values in one place.

Names, units and meanings are PX4's where PX4 has the parameter; defaults are this vehicle's.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from native.errors import InputError
from sitl.config import VehicleConfig


@dataclass(frozen=True, slots=True)
class Spec:
    """One parameter: its name on the wire, its default and what it may be."""

    name: str
    default: float
    low: float
    high: float
    unit: str
    text: str
    whole: bool = False  # an integer, by whose number it chooses

    def allows(self, value: float) -> bool:
        """Whether the parameter can take a value."""
        return (
            math.isfinite(value)
            and not (self.whole and value % 1)
            and self.low <= self.stored(value) <= self.high
        )

    def stored(self, value: float) -> float:
        """Return a value that is allowed as it is stored: of a real one six significant digits.

        MAVLink carries 32-bit floats: 0.7 arrives as 0.699999988. Rounded to six significant
        digits it is 0.7 again, and stays the same however often it is read and written.
        """
        return value if self.whole else float(f"{value:.6g}")


def _choice(name: str, default: int, high: int, text: str) -> Spec:
    return Spec(name, default, 0, high, "", text, whole=True)


_FLIGHT = (
    Spec("MIS_TAKEOFF_ALT", 10.0, 1.0, 500.0, "m", "height of a take-off that orders none"),
    Spec("MPC_XY_CRUISE", 10.0, 0.5, 30.0, "m/s", "speed of legs that order none"),
    Spec("MPC_XY_VEL_MAX", 25.0, 1.0, 30.0, "m/s", "greatest horizontal speed"),
    Spec("MPC_Z_VEL_MAX_UP", 4.0, 0.5, 8.0, "m/s", "greatest climb speed"),
    Spec("MPC_Z_VEL_MAX_DN", 3.0, 0.5, 5.0, "m/s", "greatest descent speed"),
    Spec("MPC_TKO_SPEED", 3.0, 0.5, 5.0, "m/s", "climb speed of a take-off"),
    Spec("MPC_LAND_SPEED", 0.7, 0.3, 2.0, "m/s", "descent speed close to the ground"),
    Spec("MPC_LAND_ALT2", 5.0, 1.0, 50.0, "m", "height below which it sinks at landing speed"),
    Spec("MPC_ACC_HOR", 3.0, 1.0, 8.0, "m/s2", "deceleration of a stop"),
    Spec("NAV_ACC_RAD", 5.0, 0.05, 200.0, "m", "acceptance radius of items that give none"),
    Spec("MIS_DIST_1WP", 20_000.0, 100.0, 100_000.0, "m", "farthest item from home"),
    Spec("RTL_RETURN_ALT", 30.0, 1.0, 500.0, "m", "least height of a return"),
    Spec(
        "RTL_MIN_DIST",
        10.0,
        0.5,
        100.0,
        "m",
        "a return to a place closer than this does not climb first",
    ),
    Spec("COM_DISARM_LAND", 1.0, 0.1, 20.0, "s", "time on the ground after which it has landed"),
)
_FAILSAFE = (
    _choice(
        "NAV_DLL_ACT",
        0,
        5,
        "ground station lost: 0 nothing 1 hold 2 return 3 land 4 warn 5 terminate",
    ),
    Spec("COM_DL_LOSS_T", 10.0, 1.0, 300.0, "s", "ground station lost: silent so long (wall time)"),
    _choice(
        "COM_LOW_BAT_ACT",
        3,
        3,
        "low charge: 0 and 1 warn 2 land when critical 3 return when critical, "
        "land when almost empty",
    ),
    Spec("BAT_LOW_THR", 0.15, 0.05, 0.5, "", "charge that counts as low"),
    Spec("BAT_CRIT_THR", 0.07, 0.03, 0.5, "", "charge that counts as critical"),
    Spec("BAT_EMERGEN_THR", 0.05, 0.01, 0.3, "", "charge that counts as almost empty"),
    _choice("COM_POSLOSS_ACT", 3, 4, "GNSS lost: 0 nothing 1 warn 2 hold 3 land 4 terminate"),
    Spec("COM_POS_FS_DELAY", 20.0, 1.0, 100.0, "s", "GNSS lost: silent so long (simulated time)"),
    _choice("GF_ACTION", 2, 5, "fence: 0 nothing 1 warn 2 hold 3 return 4 terminate 5 land"),
    Spec("GF_MAX_HOR_DIST", 0.0, 0.0, 50_000.0, "m", "fence: distance from home, 0 for none"),
    Spec("GF_MAX_VER_DIST", 0.0, 0.0, 5_000.0, "m", "fence: height above home, 0 for none"),
)
_PILOTS = (
    Spec("COM_OF_LOSS_T", 1.0, 0.1, 60.0, "s", "setpoints lost: silent so long (wall time)"),
    _choice(
        "COM_OBL_RC_ACT",
        0,
        7,
        "setpoints lost: 0 position 1 altitude 2 stabilized (these by sticks, else return) "
        "3 return 4 land 5 hold 6 and 7 terminate",
    ),
    Spec("COM_RC_LOSS_T", 0.5, 0.1, 35.0, "s", "sticks lost: silent so long (wall time)"),
    _choice(
        "NAV_RCL_ACT",
        2,
        6,
        "sticks lost: 0 nothing 1 hold 2 return 3 land 4 warn 5 and 6 terminate",
    ),
    Spec("MPC_VEL_MANUAL", 10.0, 1.0, 25.0, "m/s", "speed at full stick"),
    Spec("MPC_MAN_TILT_MAX", 35.0, 1.0, 60.0, "deg", "lean at full stick"),
    Spec("MPC_MAN_Y_MAX", 60.0, 5.0, 180.0, "deg/s", "turn at full stick"),
    Spec("FLW_TGT_HT", 8.0, 8.0, 500.0, "m", "height above the target, or above home"),
    Spec("FLW_TGT_DST", 8.0, 1.0, 500.0, "m", "distance from the target"),
    Spec("FLW_TGT_FA", 180.0, -180.0, 180.0, "deg", "direction from the target: 0 ahead, 90 right"),
    _choice("FLW_TGT_ALT_M", 0, 2, "follow: 0 and 1 above home 2 above the target"),
    Spec("FLW_TGT_MAX_VEL", 5.0, 0.0, 20.0, "m/s", "greatest speed relative to the target"),
    Spec("FLW_TGT_RS", 0.1, 0.0, 1.0, "", "share of its old course that a report leaves"),
)
_SIMULATION = (_choice("SYS_FAILURE_EN", 1, 1, "whether ground stations may inject failures"),)
TABLE: tuple[Spec, ...] = tuple(
    sorted(_FLIGHT + _FAILSAFE + _PILOTS + _SIMULATION, key=lambda spec: spec.name)
)
SPECS: Mapping[str, Spec] = {spec.name: spec for spec in TABLE}


class Parameters:
    """The values in force. Reading is by name; writing checks name and limits."""

    def __init__(self) -> None:
        self._values = {spec.name: spec.default for spec in TABLE}

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def apply(self, values: Mapping[str, float], origin: str) -> None:
        """Set all of `values`, or none.

        Raises:
            InputError: a name or value is not acceptable; says which, and what is.
        """
        for name, value in values.items():
            if why := refusal(name, value):
                raise InputError(f"{origin}: {name} = {value:g}: {why}")
        self._values.update({name: SPECS[name].stored(value) for name, value in values.items()})

    def set(self, name: str, value: float) -> bool:
        """Set an existing parameter; return False if the value is outside of its limits."""
        spec = SPECS[name]
        if allowed := spec.allows(value):
            self._values[name] = spec.stored(value)
        return allowed

    def reset(self) -> None:
        """Reset all values to the defaults."""
        self._values = {spec.name: spec.default for spec in TABLE}

    def as_dict(self) -> dict[str, float]:
        """All values by name, in the order of the table."""
        return dict(self._values)


def refusal(name: str, value: float) -> str:
    """Why a parameter cannot have a value, and what is allowed; empty if it can."""
    spec = SPECS.get(name)
    if spec is None:
        close = get_close_matches(name, SPECS, n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        return f"no such parameter{hint} (known: {', '.join(SPECS)})"
    unit = f", in {spec.unit}" if spec.unit else ""
    number = "whole number" if spec.whole else "number"
    allowed = f"must be a {number} from {spec.low:g} to {spec.high:g}{unit}"
    return "" if spec.allows(value) else allowed


def parameters_of(config: VehicleConfig) -> Parameters:
    """Return the configured parameters: defaults, then the file, then the configuration itself."""
    parameters = Parameters()
    path = config.parameter_file
    if path is not None and path.exists():
        parameters.apply(load_parameters(path), str(path))
    parameters.apply(config.parameters, "parameters")
    return parameters


def problems_of(vehicle: VehicleConfig) -> Iterator[tuple[str, object, str]]:
    """Settings that cannot be used: key within the vehicle's, value, and why not."""
    path, parameters = vehicle.parameter_file, Parameters()
    if path is not None:
        if not path.is_file():
            # A ground station may save into it, but a slip of the name must not pass for that.
            hint = "; to have parameters saved there, make an empty file"
            yield "parameter_file", str(path), f"no such file{hint}"
        else:
            try:
                parameters.apply(load_parameters(path), str(path))
            except InputError as error:
                yield "parameter_file", str(path), str(error)
    for name, value in vehicle.parameters.items():
        if why := refusal(name, value):
            yield f"parameters.{name}", value, why


def load_parameters(path: Path) -> dict[str, float]:
    """Read values by name from a parameter file; names and limits are not checked here.

    Reads "NAME VALUE" (MAVProxy, Mission Planner; comma or white space) and QGroundControl's
    "system component NAME VALUE type". Text after # is a comment.

    Raises:
        InputError: the file cannot be read, or a line is neither.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    values: dict[str, float] = {}
    for number, line in enumerate(lines, start=1):
        words = line.replace(",", " ").split("#")[0].split()
        if not words:
            continue
        name, value = (words[2], words[3]) if len(words) == 5 else (words[0], words[-1])
        try:
            if len(words) not in (2, 5):
                raise ValueError
            values[name] = float(value)
        except ValueError:
            raise InputError(
                f"{path}, line {number}: {line.strip()!r} is no 'NAME VALUE'"
            ) from None
    return values


def save_parameters(path: Path, values: Mapping[str, float]) -> None:
    """Write all values as "NAME VALUE" with unit and meaning beside them; whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    lines = ["# Parameters of the Aerofed autopilot"]
    for name, value in values.items():
        spec = SPECS[name]
        remark = f"{spec.unit}: {spec.text}" if spec.unit else spec.text
        lines.append(f"{name:<16} {value:.9g}  # {remark}")
    temporary = path.with_name(path.name + ".part")
    try:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error}") from None
