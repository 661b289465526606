"""What goes wrong with a firmware."""

from native.errors import FlightError, LinkLostError


class FirmwareError(FlightError):
    """The firmware cannot be flown any further; the message says what it did or did not do."""


class FirmwareSilentError(FirmwareError, LinkLostError):
    """The firmware has died, cannot be started, or no longer asks for anything."""

    exit_code = LinkLostError.exit_code


class FirmwareRestartedError(FirmwareSilentError):
    """The firmware has ended or restarted, which ends the flight."""
