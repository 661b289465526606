"""What can go wrong between a firmware and our world."""

from sitl.errors import SitlError


class FirmwareError(SitlError):
    """The firmware cannot be flown any further; the message says what it did or did not do."""


class FirmwareSilentError(FirmwareError):
    """It has died, cannot be started, or asks for nothing any more."""


class FirmwareRestartedError(FirmwareSilentError):
    """It has ended or started anew: what it flew is over."""
