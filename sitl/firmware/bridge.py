"""What both bridges are to those who step them."""

from typing import Protocol

from flightdyn.physics.sensor_suite import SensorSuite
from flightdyn.plant import Plant
from sitl.errors import SitlInputError
from sitl.firmware.native.rows import Rows

# Wall time that a firmware may take for a tick. On a busy machine it takes long for one now and
# then; one that takes longer than this is stuck.
STALL_S = 10.0


class Bridge(Protocol):
    """One firmware's way to be given sensors and to drive motors."""

    plant: Plant

    @property
    def rows(self) -> Rows:
        """The truth of the last while."""

    @property
    def connected(self) -> bool:
        """Whether a firmware has come."""

    def open(self) -> None:
        """Listen for the firmware.

        Raises:
            LinkError: the port cannot be had.
        """

    def run(self, ticks: int) -> int:
        """Step the plant so often at most, each time when the firmware asks for it.

        Returns:
            How often; 0 where the firmware asked for nothing for a moment.

        Raises:
            FirmwareError: the firmware speaks another protocol.
            FirmwareRestartedError: it has ended, or begun anew.
        """

    def rest(self) -> None:
        """Time stands still: take what arrives meanwhile; nothing is answered."""

    def close(self) -> None:
        """Stop; may be called twice."""


def sensors_of(plant: Plant) -> SensorSuite:
    """The sensors that a firmware is to fly on.

    Raises:
        SitlInputError: there are none.
    """
    if plant.sensors is None:
        raise SitlInputError(
            "aircraft.sensors.kind = 'perfect': a firmware flies on sensors of its own kind and "
            "takes readings without noise for broken ones; it must be 'realistic'"
        )
    return plant.sensors
