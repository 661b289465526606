"""What can go wrong in learning. Every exception carries the values that explain it."""

from dataclasses import dataclass, fields
from pathlib import Path


@dataclass(eq=False)
class LearningError(Exception):
    """Root of the exceptions of this package."""

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
        return f"{self.key} = {self.value!r}: {self.allowed}"


@dataclass(eq=False)
class DataMissingError(LearningInputError):
    """The files of a data set are not in the folder that was given."""

    dataset: str
    folder: Path | None
    wanted: str

    def __str__(self) -> str:
        if self.folder is None:
            return f"{self.dataset}: no data folder was given; it is to hold {self.wanted}"
        return f"{self.dataset}: not found in {self.folder}; looked for {self.wanted}"


@dataclass(eq=False)
class DataDamagedError(LearningInputError):
    """A data file that is there but is not what its format says."""

    path: Path | str
    reason: str

    def __str__(self) -> str:
        return f"{self.path}: damaged data file: {self.reason}"
