"""MAVLink messages as values: what the protocol cores read and write, in SI units and degrees.

The codec turns them into bytes and back. Telemetry is not here: it is encoded from a
`Snapshot` of the vehicle as a whole (see `snapshot.py`).
"""

from dataclasses import dataclass
from typing import TypeAlias

from sitl.autopilot.values.enums import (
    MissionResult,
    MissionState,
    MissionType,
    ParamError,
    ParamType,
    Result,
    Severity,
)
from sitl.autopilot.values.files import FileAnswer, FileRequest
from sitl.autopilot.values.parts import PartAnswer, PartRequest
from sitl.autopilot.values.setpoints import Streamed


@dataclass(frozen=True, slots=True)
class Peer:
    """Who speaks, or is spoken to."""

    system: int
    component: int


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Somebody is there; `ground_station` tells whether it is one."""

    ground_station: bool


@dataclass(frozen=True, slots=True)
class CommandOrder:
    """COMMAND_LONG or COMMAND_INT.

    `params` are the seven parameters; where the command carries a global position, the fifth
    and sixth are degrees whatever the message. `frame` is None for COMMAND_LONG.
    """

    command: int
    params: tuple[float, float, float, float, float, float, float]
    frame: int | None = None
    confirmation: int = 0


@dataclass(frozen=True, slots=True)
class CommandAck:
    """The answer to a command."""

    command: int
    result: Result


@dataclass(frozen=True, slots=True)
class SetMode:
    """SET_MODE, the predecessor of the command of the same purpose."""

    custom_mode: int


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item of the mission, the fence or the rally points.

    `x`, `y` are latitude and longitude in degrees where the frame is global, else plain
    parameters five and six; `z` is the altitude in metres, or parameter seven.
    """

    seq: int
    command: int
    frame: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    mission_type: MissionType = MissionType.MISSION
    autocontinue: bool = True


@dataclass(frozen=True, slots=True)
class MissionCount:
    """The sender is about to send this many items."""

    count: int
    mission_type: MissionType


@dataclass(frozen=True, slots=True)
class MissionRequest:
    """One item is asked for; `old`: by the message of that name, not by the one for integers."""

    seq: int
    mission_type: MissionType
    old: bool = False


@dataclass(frozen=True, slots=True)
class MissionRequestList:
    """The whole list is asked for."""

    mission_type: MissionType


@dataclass(frozen=True, slots=True)
class MissionPartialList:
    """Part of a list is to be written or read, which this vehicle refuses."""

    mission_type: MissionType


@dataclass(frozen=True, slots=True)
class MissionAck:
    """A transfer has ended."""

    result: MissionResult
    mission_type: MissionType


@dataclass(frozen=True, slots=True)
class MissionClearAll:
    """A list, or all of them, shall be emptied."""

    mission_type: MissionType


@dataclass(frozen=True, slots=True)
class MissionSetCurrent:
    """The mission shall go on, or start, with this item."""

    seq: int


@dataclass(frozen=True, slots=True)
class MissionCurrent:
    """Where the mission is."""

    seq: int
    total: int
    state: MissionState
    in_mission_mode: bool


@dataclass(frozen=True, slots=True)
class MissionItemReached:
    """An item has been reached or carried out."""

    seq: int


@dataclass(frozen=True, slots=True)
class ParamRequestList:
    """All parameters are asked for."""


@dataclass(frozen=True, slots=True)
class ParamRequestRead:
    """One parameter is asked for, by index or (index -1) by name."""

    name: str
    index: int


@dataclass(frozen=True, slots=True)
class ParamSet:
    """A parameter shall take a value; `kind` is MAV_PARAM_TYPE as sent."""

    name: str
    value: float
    kind: int


@dataclass(frozen=True, slots=True)
class ParamValue:
    """A parameter as it stands; index 65535 where nobody asked by index."""

    name: str
    value: float
    kind: ParamType
    count: int
    index: int


@dataclass(frozen=True, slots=True)
class ParamRefused:
    """A parameter cannot be read or written, and why."""

    name: str
    index: int
    error: ParamError


@dataclass(frozen=True, slots=True)
class Ping:
    """A request to answer, where `target_system` is 0; else an answer."""

    time_us: int
    seq: int
    target_system: int


@dataclass(frozen=True, slots=True)
class Pong:
    """The answer to a ping."""

    time_us: int
    seq: int


@dataclass(frozen=True, slots=True)
class TimeSync:
    """Clock comparison: `remote_ns` is 0 in a request."""

    remote_ns: int
    sender_ns: int


@dataclass(frozen=True, slots=True)
class MessageInterval:
    """How often a message is sent: -1 never, 0 not available."""

    message_id: int
    interval_s: float


@dataclass(frozen=True, slots=True)
class StatusText:
    """A line for the pilot; the codec splits what does not fit into one message."""

    severity: Severity
    text: str


Incoming: TypeAlias = (
    Streamed
    | FileRequest
    | PartRequest
    | Heartbeat
    | CommandOrder
    | SetMode
    | MissionItem
    | MissionCount
    | MissionRequest
    | MissionRequestList
    | MissionPartialList
    | MissionAck
    | MissionClearAll
    | MissionSetCurrent
    | ParamRequestList
    | ParamRequestRead
    | ParamSet
    | Ping
    | TimeSync
)
Outgoing: TypeAlias = (
    FileAnswer
    | PartAnswer
    | CommandAck
    | MissionRequest
    | MissionAck
    | MissionCount
    | MissionItem
    | MissionCurrent
    | MissionItemReached
    | ParamValue
    | ParamRefused
    | Pong
    | TimeSync
    | MessageInterval
    | StatusText
)


@dataclass(frozen=True, slots=True)
class Envelope:
    """A message on its way out; `to` is None for everybody."""

    body: Outgoing
    to: Peer | None = None


Outbox: TypeAlias = list[Envelope]
