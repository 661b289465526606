"""What can go wrong in the simulated vehicle; every exception of the package derives from one."""


class SitlError(Exception):
    """Root of the exceptions that this package raises."""


class SitlInputError(SitlError):
    """The user gave something unusable; the message names it and says what is allowed."""


class LinkError(SitlError):
    """A link cannot be opened or used; the message names its address."""


class FirmwareError(SitlError):
    """The firmware cannot be flown any further; the message says what it did or did not do."""


class FirmwareSilentError(FirmwareError):
    """It has died, cannot be started, or asks for nothing any more."""


class FirmwareRestartedError(FirmwareSilentError):
    """It has ended or started anew: what it flew is over."""
