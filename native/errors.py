"""What can go wrong, in one vocabulary for all packages, and how values stand in its messages.

Each kind has the exit code that a command ends with. Packages have kinds of these of their own, so
that nobody translates an error that passes through; who knows more (a file, the time of a flight)
puts it before the words by `in_words`.
"""

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from typing import Any, Self

_ESCAPES = {  # of what XML may not hold, nor a terminal see
    code: chr(code).encode("unicode_escape").decode()
    for code in (*range(32), *range(127, 160), 0xFFFE, 0xFFFF)
    if chr(code) not in "\n\t"
}


class AerofedError(Exception):
    """Root of all errors of ours; the message is one clear line for the user."""

    exit_code = 1

    def in_words(self, text: str) -> Self:
        """The same error with another message, to be raised `from` its `__cause__`.

        It keeps the traceback.
        """
        other: Self = _made(type(self), (text,), vars(self))
        return other.with_traceback(self.__traceback__)

    def __reduce__(self) -> tuple[object, ...]:
        return _made, (type(self), self.args, vars(self))


def _made(kind: Any, args: tuple[object, ...], values: Mapping[str, object]) -> Any:
    """Make an error as it was, whatever its kind is made from."""
    error = kind.__new__(kind, *args)
    vars(error).update(values)
    return error


class InputError(AerofedError):
    """The user's input is wrong: configuration, data, files, folders."""

    exit_code = 2


class NoFlightError(InputError):
    """A flight log, or a folder for logs, that is sound and holds no flight."""


class SettingError(InputError):
    """A setting whose value is refused; who knows where it was set names that, too."""

    def __init__(self, key: str, value: object, allowed: str) -> None:
        super().__init__(f"{key} = {printable(value, repr)}: {allowed}")
        self.key, self.value, self.allowed = key, value, allowed


class UsersCodeError(AerofedError):
    """A researcher's own code raised something, which is the `__cause__`, or broke a rule."""

    exit_code = 2


class FlightError(AerofedError):
    """The vehicle refused an order or did not finish it."""

    exit_code = 4


class UnansweredError(FlightError):
    """The vehicle did not answer an order in time; it may have carried it out."""


class TrainingError(AerofedError):
    """Training failed, for example diverged; a retry does not help, another setting may."""

    exit_code = 4


class LinkLostError(AerofedError):
    """The link could not be opened, or the vehicle fell silent."""

    exit_code = 5


class FirmwareError(FlightError):
    """The firmware cannot be flown any further; the message says what it did or did not do."""


class FirmwareSilentError(FirmwareError, LinkLostError):
    """The firmware has died, cannot be started, or no longer asks for anything."""

    exit_code = LinkLostError.exit_code


class FirmwareRestartedError(FirmwareSilentError):
    """The firmware has ended or restarted, which ends the flight."""


class FaultError(InputError):
    """A fault that this aircraft cannot be given."""


class ModelDivergedError(FlightError):
    """The physics left the finite numbers: a fault of the model, not of its user."""


def printable(value: object, how: Callable[[Any], str] = str, *, most: int = 500) -> str:
    """Return `how(value)` (`str`, `repr`), cut to `most` characters, or a note that it raised.

    Lone surrogates and control characters but line feeds and tabs become escapes, so that the text
    can be printed, and written as XML.
    """
    try:
        text = how(value)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        text = f"({kind_of(value)}, which fails to say what it is: {type(error).__name__})"
    text = text if len(text) <= most else f"{text[: most - 3]}..."
    return text.encode("utf-8", "backslashreplace").decode().translate(_ESCAPES)


def one_line(value: object) -> str:
    """As `printable`, on one line."""
    return " ".join(printable(value).split())


def first_line(error: BaseException) -> str:
    """Kind and message of an exception, on one line."""
    return f"{type(error).__name__}: {(printable(error).splitlines() or [''])[0]}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return '; did you mean NAME?' with the closest known name, or '' where none is close."""
    whole = {one: one for one in known}
    stems = {one.rpartition("_")[0]: one for one in whole}  # without the unit
    close = [names[one] for names in (whole, stems) for one in get_close_matches(name, names, n=1)]
    return f"; did you mean {close[0]}?" if close else ""


def kind_of(value: object) -> str:
    """The type of a value with its article: 'an int', 'a Strategy'."""
    name = type(value).__name__
    return f"{'an' if name[:1].lower() in 'aeio' else 'a'} {name}"
