"""Exceptions of the simulated vehicle; they all derive from `SitlError`."""


class SitlError(Exception):
    """Root of the exceptions that this package raises."""


class SitlInputError(SitlError):
    """The user gave something unusable; the message names it and says what is allowed."""


class LinkError(SitlError):
    """A link cannot be opened or used; the message names its address."""


class FirmwareError(SitlError):
    """The firmware cannot be flown any further; the message says what it did or did not do."""


class FirmwareSilentError(FirmwareError):
    """The firmware has died, cannot be started, or no longer asks for anything."""


class FirmwareRestartedError(FirmwareSilentError):
    """The firmware has ended or restarted, which ends the flight."""
