"""Messages to parts that a vehicle may have, as values: payload, shell, speaker."""

from dataclasses import dataclass
from enum import Enum, auto


class Part(Enum):
    """Parts whose messages MAVLink has no answer to."""

    GIMBAL = auto()
    CORRECTIONS = auto()
    TUNE = auto()


@dataclass(frozen=True, slots=True)
class ForPart:
    """A message for a part that this vehicle does not have, and that MAVLink has no answer to."""

    part: Part


@dataclass(frozen=True, slots=True)
class ShellInput:
    """SERIAL_CONTROL: somebody types into a shell; `device` is where he believes it to be."""

    device: int
    answer_wanted: bool


@dataclass(frozen=True, slots=True)
class ShellOutput:
    """SERIAL_CONTROL: what a shell prints."""

    device: int
    text: str


@dataclass(frozen=True, slots=True)
class ExtendedParamSet:
    """PARAM_EXT_SET: a parameter of a camera or gimbal."""

    name: str


@dataclass(frozen=True, slots=True)
class ExtendedParamRefused:
    """PARAM_EXT_ACK: that cannot be."""

    name: str


PartRequest = ForPart | ShellInput | ExtendedParamSet
PartAnswer = ShellOutput | ExtendedParamRefused
