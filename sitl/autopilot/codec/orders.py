"""Commands and mission items as values: degrees and metres, whichever message carried them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.units import deg_e7, from_deg_e7, from_int32, int32

Fields: TypeAlias = dict[str, Any]  # of a message, by MAVLink's names
Place: TypeAlias = tuple[Any, Any] | None  # a link and who is on it; None: everywhere

ABSOLUTE_FRAMES = frozenset({mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT})
RELATIVE_FRAMES = frozenset(
    {mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
)
GLOBAL_FRAMES = ABSOLUTE_FRAMES | RELATIVE_FRAMES
_OF_DEGREES = {  # what they are called in messages with degrees, not degE7
    mav.MAV_FRAME_GLOBAL_INT: mav.MAV_FRAME_GLOBAL,
    mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
}


class Peer(NamedTuple):
    """A MAVLink component, the sender of a message or its target, and where it was heard.

    Stations are often alike: each script by MAVSDK is 245/190, unless it says otherwise.
    """

    system: int
    component: int
    at: Place = None

    @property
    def ids(self) -> tuple[int, int]:
        """What a message to it names as its target."""
        return self[:2]


class Outbox:
    """What waits to be sent: to everybody, or where it was asked for.

    An answer goes nowhere else, as with firmwares and MAVLink routers: MAVSDK takes whatever it
    hears of a mission for its own, whomever and whichever list it is for.
    """

    def __init__(self) -> None:
        self._waiting: list[tuple[Place, mav.MAVLink_message]] = []

    def append(self, message: mav.MAVLink_message, to: Peer | None = None) -> None:
        """Send a message to `to`, or to everybody."""
        self._waiting.append((None if to is None else to.at, message))

    def take(self) -> list[tuple[Place, mav.MAVLink_message]]:
        """What waits and where it goes, None for everywhere; nothing waits then."""
        waiting, self._waiting = self._waiting, []
        return waiting


# Who handles which message: from whom it came, the message and the wall time (s).
Handlers: TypeAlias = dict[type[mav.MAVLink_message], Callable[[Peer, Any, float], None]]


@dataclass(frozen=True, slots=True)
class CommandOrder:
    """A command that arrived as COMMAND_LONG or COMMAND_INT.

    `params` are the seven parameters; where the command carries a global position, the fifth
    and sixth are degrees whatever the message. `frame` is None for COMMAND_LONG.
    """

    command: int
    params: tuple[float, float, float, float, float, float, float]
    frame: int | None = None
    confirmation: int = 0


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
    mission_type: int = mav.MAV_MISSION_TYPE_MISSION
    autocontinue: bool = True
    current: bool = False  # the mission begins with it

    def message(self, to: Peer, *, old: bool = False) -> mav.MAVLink_message:
        """The MISSION_ITEM_INT that carries the item to a peer, or the `old` MISSION_ITEM."""
        frame = _OF_DEGREES.get(self.frame, self.frame) if old else self.frame
        head = (*to.ids, self.seq, frame, self.command, 0, int(self.autocontinue), *self.params)
        if old:
            place = (self.x, self.y, self.z)
            return mav.MAVLink_mission_item_message(*head, *place, self.mission_type)
        coordinate = deg_e7 if frame in GLOBAL_FRAMES else int32
        x, y = coordinate(self.x), coordinate(self.y)
        return mav.MAVLink_mission_item_int_message(*head, x, y, self.z, self.mission_type)


class OrderObserver(Protocol):
    """Observer of uploaded lists and of setpoints, with the simulated time (ns) of each."""

    def took(self, t_ns: int, kind: int, items: tuple[MissionItem, ...]) -> None:
        """Receive a list that the vehicle has accepted; `kind` is its MAV_MISSION_TYPE."""

    def heard(self, t_ns: int, setpoint: Any) -> None:
        """Receive a setpoint message (position or attitude), whether valid or not."""


def read_order(
    msg: mav.MAVLink_command_long_message | mav.MAVLink_command_int_message,
) -> CommandOrder:
    """The order that a COMMAND_LONG or COMMAND_INT carries."""
    first = (msg.param1, msg.param2, msg.param3, msg.param4)
    if isinstance(msg, mav.MAVLink_command_long_message):
        rest = (msg.param5, msg.param6, msg.param7)
        return CommandOrder(msg.command, (*first, *rest), confirmation=msg.confirmation)
    known = mav.enums["MAV_CMD"].get(msg.command)
    placed = known is not None and known.has_location and msg.frame in GLOBAL_FRAMES
    x, y = (from_deg_e7(part) if placed else from_int32(part) for part in (msg.x, msg.y))
    return CommandOrder(msg.command, (*first, x, y, msg.z), frame=msg.frame)


def read_item(
    msg: mav.MAVLink_mission_item_message | mav.MAVLink_mission_item_int_message,
) -> MissionItem:
    """The item that a MISSION_ITEM_INT or MISSION_ITEM carries."""
    x, y = float(msg.x), float(msg.y)
    if isinstance(msg, mav.MAVLink_mission_item_int_message):
        read = from_deg_e7 if msg.frame in GLOBAL_FRAMES else from_int32
        x, y = read(msg.x), read(msg.y)
    params = (msg.param1, msg.param2, msg.param3, msg.param4)
    return MissionItem(
        msg.seq,
        msg.command,
        msg.frame,
        params,
        x,
        y,
        msg.z,
        msg.mission_type,
        bool(msg.autocontinue),
        bool(msg.current),
    )


def bare_name(number: int) -> str:
    """The name of a MAV_CMD without its prefix: `DO_SET_SERVO` for 183."""
    entry = mav.enums["MAV_CMD"].get(number)
    return "unknown command" if entry is None else entry.name.removeprefix("MAV_CMD_")


def command_name(number: int) -> str:
    """`DO_SET_SERVO (183)` for 183; a number that MAVLink does not know stays a number."""
    return f"{bare_name(number)} ({number})"
