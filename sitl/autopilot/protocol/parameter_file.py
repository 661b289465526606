"""Parameter files: read in the two formats that ground stations write, written in one."""

from collections.abc import Mapping
from pathlib import Path

from sitl.autopilot.parameters import SPECS
from sitl.errors import SitlInputError


def load_parameters(path: Path) -> dict[str, float]:
    """Values by name from a parameter file; names and limits are not checked here.

    Reads "NAME VALUE" (MAVProxy, Mission Planner; comma or white space) and QGroundControl's
    "system component NAME VALUE type". Lines starting with # are comments.

    Raises:
        SitlInputError: the file cannot be read, or a line is neither.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise SitlInputError(f"{path}: cannot be read: {error}") from None
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
            raise SitlInputError(
                f"{path}, line {number}: {line.strip()!r} is no 'NAME VALUE'"
            ) from None
    return values


def save_parameters(path: Path, values: Mapping[str, float]) -> None:
    """Write all values as "NAME VALUE" with unit and meaning beside them; whole or not at all.

    Raises:
        SitlInputError: the file cannot be written.
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
        raise SitlInputError(f"{path}: cannot be written: {error}") from None
