"""Exceptions of learning, each with the values that explain it, and helpers for their messages."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any

_ESCAPES = {  # of what XML may not hold, nor a terminal see
    code: chr(code).encode("unicode_escape").decode()
    for code in (*range(32), *range(127, 160), 0xFFFE, 0xFFFF)
    if chr(code) not in "\n\t"
}


def told(value: object, how: Callable[[Any], str] = str, *, most: int = 500) -> str:
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
    """As `told`, on one line."""
    return " ".join(told(value).split())


def first_line(error: BaseException) -> str:
    """Kind and message of an exception, on one line."""
    return f"{type(error).__name__}: {(told(error).splitlines() or [''])[0]}"


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


@dataclass(eq=False)
class LearningError(Exception):
    """Base class of the exceptions of `fl`."""

    def __post_init__(self) -> None:
        # Exceptions are pickled by their args: without them none would cross a process border.
        super().__init__(*(getattr(self, field.name) for field in fields(self)))


@dataclass(eq=False)
class LearningInputError(LearningError):
    """Something the user gave (a setting, a file, a network) cannot be used as it stands."""


@dataclass(eq=False)
class SettingError(LearningInputError):
    """A setting whose value is refused."""

    key: str
    value: object
    allowed: str

    def __str__(self) -> str:
        return f"{self.key} = {told(self.value, repr)}: {self.allowed}"


FETCHED = ("mnist", "fashion-mnist", "cifar10")  # tasks whose files are published


@dataclass(eq=False)
class DataMissingError(LearningInputError):
    """The files of a data set are not in the folder that was given."""

    dataset: str
    folder: Path | None
    wanted: str

    def __str__(self) -> str:
        folder = self.folder or "FOLDER"
        fetched = self.dataset in FETCHED
        get = f"; get it by: aerofed data fetch {folder} --task {self.dataset}" if fetched else ""
        if self.folder is None:
            return (
                f"{self.dataset}: needs files: give their folder (--data-dir FOLDER, in Python "
                f"data_dir); needed: {self.wanted}{get}"
            )
        return f"{self.dataset}: not found in {self.folder}; looked for {self.wanted}{get}"


@dataclass(eq=False)
class DataDamagedError(LearningInputError):
    """A data file that is there but cannot be read or is not what its format says."""

    path: Path | str
    reason: str

    def __str__(self) -> str:
        return f"{self.path}: damaged or unreadable: {self.reason}"


@dataclass(eq=False)
class DataLayoutError(DataDamagedError):
    """A data file that can be read, but is not laid out as Aerofed wants it."""

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}"


@dataclass(eq=False)
class CheckpointError(LearningInputError):
    """Learning state that is damaged or belongs to another federation."""

    reason: str

    def __str__(self) -> str:
        return f"checkpoint of the learning: {self.reason}"


@dataclass(eq=False)
class DivergedError(LearningError):
    """Local training that left the finite numbers: no retry helps, another setting may."""

    round: int
    community: str
    device: int
    loss: float

    def __str__(self) -> str:
        return (
            f"round {self.round}, community {self.community}, device {self.device}:"
            f" training left the finite numbers (mean loss {self.loss:.3g});"
            " a smaller learning rate may help"
        )


@dataclass(eq=False)
class FetchError(LearningError):
    """A file that could not be downloaded; trying again may help."""

    url: str
    reason: str

    def __str__(self) -> str:
        return one_line(f"{self.url}: not fetched: {self.reason}")
