"""Parameters of a vehicle: read, and set for the length of a flight."""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager

from mavsdk.asyncio import System
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.exceptions import MavsdkError

from mission.base.errors import AerofedError, FlightError
from mission.flight.pilot.raw_messages import reason, settled

logger = logging.getLogger(__name__)

RESTORE_TIMEOUT_S = 15.0  # wall time, of a link that may be lost


class Parameters:
    """The parameters of one vehicle; those that are whole numbers there come as floats too."""

    def __init__(self, system: System) -> None:
        self._plugin = ParamAsync(system)

    async def get(self, name: str) -> float | None:
        """The value of a parameter; None where the vehicle has none such, or does not answer."""
        for read in (self._plugin.get_param_float, self._plugin.get_param_int):
            try:
                return float(await settled(read(name)))
            except MavsdkError as error:
                logger.info("parameter %s: %s", name, error)
                if "WRONG_TYPE" not in reason(error):
                    return None
        return None

    async def set(self, name: str, value: float) -> None:
        """Set a parameter that is a float there.

        Raises:
            FlightError: the vehicle refuses, or does not answer.
        """
        try:
            await settled(self._plugin.set_param_float(name, value))
        except MavsdkError as error:
            raise FlightError(
                f"the vehicle did not set {name} = {value:g}: {reason(error)}"
            ) from None


@asynccontextmanager
async def adjusted(
    parameters: Parameters, values: Mapping[str, tuple[float, float]], *, say: Callable[[str], None]
) -> AsyncIterator[None]:
    """Set each parameter to the second of its values, and back to the first when the block ends.

    However it ends: what could not be set back is named, in the error that ends the flight where
    there is one, else by `say`.
    """
    changed: dict[str, tuple[float, float]] = {}
    try:
        for name, (before, during) in values.items():
            changed[name] = (before, during)
            await parameters.set(name, during)
        yield
    except AerofedError as error:
        if left := await _restored(parameters, changed):
            raise type(error)(f"{error}; {left}") from error
        raise
    except BaseException:
        if left := await _restored(parameters, changed):
            say(left)
        raise
    else:
        if left := await _restored(parameters, changed):
            raise FlightError(left)


async def _restored(parameters: Parameters, changed: Mapping[str, tuple[float, float]]) -> str:
    """Restore changed parameters; return a line for people on those that failed, empty if none."""
    left = dict(changed)
    try:
        async with asyncio.timeout(RESTORE_TIMEOUT_S):
            for name, (before, _) in changed.items():
                await parameters.set(name, before)
                del left[name]
    except (TimeoutError, AerofedError) as error:
        logger.info("parameters: %s", error)
    if not left:
        return ""
    values = ", ".join(f"{name} = {set_:g} (was {was:g})" for name, (was, set_) in left.items())
    return f"the vehicle keeps what was set for the flight: {values}"
