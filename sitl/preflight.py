"""Checks of a vehicle's parameters in a configuration, before the vehicle is made."""

from collections.abc import Iterator
from difflib import get_close_matches

from sitl.autopilot.parameters import SPECS, Parameters, known_names, load_parameters
from sitl.config import VehicleConfig
from sitl.errors import SitlInputError


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
            except SitlInputError as error:
                yield "parameter_file", str(path), str(error)
    for name, value in vehicle.parameters.items():
        spec = SPECS.get(name)
        if spec is None:
            close = get_close_matches(name, SPECS, n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            reason = f"no such parameter{hint} (known: {known_names()})"
            yield f"parameters.{name}", value, reason
        elif not spec.allows(value):
            unit = f", in {spec.unit}" if spec.unit else ""
            reason = f"must be a number from {spec.low:g} to {spec.high:g}{unit}"
            yield f"parameters.{name}", value, reason
