"""Frames drawn from a seed, delivered by tick, and what must hold whatever they are.

The vehicle is deterministic: the seed that a failure prints replays it to the tick.
"""

import logging
import math
import random
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as wide  # more kinds than the vehicle knows
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, of

from sitl.autopilot.flying.modes import Mode

KINDS = sorted(wide.mavlink_map)
SENDERS = ((255, 190), (254, 190), (1, 1))  # two stations, and somebody who says to be the vehicle
SPOKEN = [  # what the vehicle has ears for comes more often
    mav.MAVLINK_MSG_ID_COMMAND_LONG, mav.MAVLINK_MSG_ID_COMMAND_INT, mav.MAVLINK_MSG_ID_SET_MODE,
    mav.MAVLINK_MSG_ID_MISSION_COUNT, mav.MAVLINK_MSG_ID_MISSION_ITEM_INT,
    mav.MAVLINK_MSG_ID_MISSION_ITEM, mav.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
    mav.MAVLINK_MSG_ID_MISSION_REQUEST_LIST, mav.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
    mav.MAVLINK_MSG_ID_MISSION_SET_CURRENT, mav.MAVLINK_MSG_ID_MISSION_ACK,
    mav.MAVLINK_MSG_ID_PARAM_SET, mav.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
    mav.MAVLINK_MSG_ID_PARAM_REQUEST_LIST, mav.MAVLINK_MSG_ID_PING, mav.MAVLINK_MSG_ID_TIMESYNC,
    mav.MAVLINK_MSG_ID_HEARTBEAT,
]  # fmt: skip
FLOATS = [
    0.0, -0.0, 1.0, -1.0, -2.0, 2.0, 0.5, 1e-40, -1e-40, 0.05, 30.0, 100.0, 1e6, -1e6, 3.4028234e38,
    -3.4028234e38, math.inf, -math.inf, math.nan, 47.3977418, 8.5455939, 255.0, 65535.0, 21196.0,
]  # fmt: skip
LIMITS = {
    "uint8_t": (0, 2**8 - 1), "int8_t": (-(2**7), 2**7 - 1), "uint16_t": (0, 2**16 - 1),
    "int16_t": (-(2**15), 2**15 - 1), "uint32_t": (0, 2**32 - 1), "int32_t": (-(2**31), 2**31 - 1),
    "uint64_t": (0, 2**64 - 1), "int64_t": (-(2**63), 2**63 - 1),
}  # fmt: skip
PARAMETERS = ["MPC_XY_CRUISE", "NAV_ACC_RAD", "GF_ACTION", "COM_POSLOSS_ACT", "", "X" * 16, "\xff"]


class Frames:
    """Frames without end, the same for the same seed."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._senders = [wide.MAVLink(None, *sender) for sender in SENDERS]
        for sender in self._senders:
            sender.signing.secret_key = bytes(32)
        self._commands = sorted(mav.enums["MAV_CMD"])

    def __iter__(self) -> Iterator[bytes]:
        while True:
            yield self.draw()

    def draw(self) -> bytes:
        """One frame: any kind of the dialect, v1, v2 or signed, whole or damaged."""
        r = self._random
        number = r.choice(SPOKEN) if r.random() < 0.8 else r.choice(KINDS)
        sender = r.choices(self._senders, (6, 3, 1))[0]
        sender.signing.sign_outgoing = r.random() < 0.1
        sender.signing.timestamp = r.getrandbits(40)
        sender.seq = r.getrandbits(8)
        old = number < 256 and r.random() < 0.15
        frame = bytes(self._message(number).pack(sender, force_mavlink1=old))
        if r.random() < 0.03:
            frame = self._damage(frame)
        return frame

    def _damage(self, frame: bytes) -> bytes:
        r = self._random
        altered = bytearray(frame)
        altered[r.randrange(len(altered))] = r.getrandbits(8)
        return bytes(altered[: r.randrange(1, len(altered) + 1)])

    def _message(self, number: int) -> Any:  # of pymavlink's classes
        kind = wide.mavlink_map[number]
        values: list[Any] = []
        for name, type_, length in zip(
            kind.fieldnames, kind.fieldtypes, self._lengths(kind), strict=True
        ):
            if type_ == "char":
                values.append(self._text(length))
            elif length:
                values.append([self._number(name, type_) for _ in range(length)])
            else:
                values.append(self._number(name, type_))
        return kind(*values)

    @staticmethod
    def _lengths(kind: Any) -> list[int]:
        by_name = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
        return [by_name[name] for name in kind.fieldnames]

    def _text(self, length: int) -> bytes:
        r = self._random
        if r.random() < 0.7:
            return r.choice(PARAMETERS).encode("latin-1")[: max(length, 1)]
        return r.randbytes(max(length, 1))

    def _number(self, name: str, type_: str) -> float | int:
        r = self._random
        if type_ in ("float", "double"):
            if r.random() < 0.7:
                value = r.choice(FLOATS)
            elif r.random() < 0.5:
                value = r.uniform(-200.0, 200.0)
            else:
                (value,) = struct.unpack("<f", r.randbytes(4))
            return float(value)
        low, high = LIMITS[type_]
        if r.random() < 0.85:
            usual = self._usual(name)
            if usual is not None and low <= usual <= high:
                return usual
        return r.choice((low, high, 0, 1, r.randint(low, high), r.randint(max(low, -9), 9)))

    def _usual(self, name: str) -> int | None:
        r = self._random
        match name:
            case "target_system" | "target_component":
                return r.choice((0, 1))
            case "command":
                return r.choice(self._commands) if r.random() < 0.3 else r.choice(KNOWN)
            case "frame":
                return r.choice((0, 2, 3, 5, 6))
            case "mission_type":
                return r.choices((0, 1, 2, 255), (6, 2, 2, 1))[0]
            case "seq":
                return r.randrange(6)
            case "count":
                return r.randrange(6)
            case "x" | "y" | "param5" | "param6":
                return r.choice((473977418, 85455939, 473980000, 85460000, 0, 2**31 - 1))
            case "param_type":
                return r.choice((6, 9))
            case _:
                return None


KNOWN = [
    *sorted(Desk(ready=False).vehicle.autopilot.commands.known),
    16, 17, 19, 20, 21, 22, 93, 112, 115, 177, 178, 5000, 5001, 5002, 5003, 5004, 5100,
]  # fmt: skip


class BrokenError(AssertionError):
    """What must hold does not."""


@dataclass
class Attack:
    """One vehicle under frames drawn from one seed."""

    seed: int
    desk: Desk = field(default_factory=Desk)
    sent: int = 0

    def __post_init__(self) -> None:
        self._frames = Frames(self.seed)
        self._log = _Errors()

    def run(self, count: int) -> None:
        """Send `count` frames.

        Raises:
            BrokenError: an oracle is broken; says the seed and the frame.
        """
        logging.getLogger("sitl").addHandler(self._log)
        try:
            for _ in range(count):
                self.step()
                if self.desk.vehicle.autopilot.mode is Mode.TERMINATED:  # for good
                    self.desk = Desk()
            self.fly_a_mission()
        except Exception as error:
            raise BrokenError(f"seed {self.seed}, frame {self.sent}: {error!r}") from error
        finally:
            logging.getLogger("sitl").removeHandler(self._log)

    def step(self) -> None:
        """One frame, a little time, and a look at everything."""
        desk, frame = self.desk, self._frames.draw()
        desk.heard.clear()
        self.sent += 1
        desk.vehicle.receive(frame, desk.now)
        asked = self._asks(frame)
        answers = desk.exchange()
        if asked is not None:
            acks = [ack.command for ack in of(answers, "COMMAND_ACK")]
            if asked not in acks:
                raise BrokenError(f"command {asked} is not answered")
        if self.sent % 7 == 0:
            desk.now += 0.05
            for _ in range(10):
                unarmed, down_m = not desk.mass.armed, float(desk.mass.pos_ned_m[2])
                desk.vehicle.step()
                if unarmed and desk.mass.pos_ned_m[2] < down_m - 1e-9:
                    raise BrokenError("it climbs unarmed")
            desk.exchange()
        self.check()

    def _asks(self, frame: bytes) -> int | None:
        """The command that an undamaged frame to the vehicle orders."""
        ears = mav.MAVLink(None)
        ears.robust_parsing = True
        for message in ears.parse_buffer(frame) or ():
            orders = (mav.MAVLink_command_long_message, mav.MAVLink_command_int_message)
            if not isinstance(message, orders):
                continue
            to_us = message.target_system in (0, 1) and message.target_component in (0, 1)
            if to_us and (message.get_srcSystem(), message.get_srcComponent()) != (1, 1):
                return int(message.command)
        return None

    def check(self) -> None:
        """What holds at any time."""
        if self._log.records:
            raise BrokenError(f"internal error: {self._log.records[0].getMessage()}")
        vehicle, mass = self.desk.vehicle, self.desk.mass
        flight = vehicle.autopilot.flight
        if not all(map(math.isfinite, (*mass.pos_ned_m, *mass.vel_ned_mps, mass.yaw_rad))):
            raise BrokenError("the vehicle's state is not finite")
        home = flight.guard.home
        if not (abs(home.lat_deg) <= 90 and abs(home.lon_deg) <= 180):
            raise BrokenError(f"home is {home}")
        if not -1000 <= home.alt_msl_m <= 20_000:
            raise BrokenError(f"home is {home}")
        for name, value in vehicle.autopilot.parameters.as_dict().items():
            if not math.isfinite(value):
                raise BrokenError(f"{name} = {value}")

    def fly_a_mission(self) -> None:
        """Whatever was done to it, a vehicle whose flight was not ended flies and lands."""
        desk = self.desk
        flight = desk.vehicle.autopilot.flight
        desk.pass_wall_time(15.0, step=0.25)  # a transfer that was begun is given up
        desk.vehicle.autopilot.parameters.reset()
        desk.send(mav.MAVLink_mission_clear_all_message(1, 1, 255))
        self._order(mav.MAV_CMD_NAV_LAND)
        for _ in range(200_000):
            if not desk.mass.armed and desk.mass.on_ground:
                break
            desk.vehicle.step()
            if not flight.moving and desk.mass.armed and desk.mass.on_ground:
                self._order(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0)
        self._order(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0)
        self._order(mav.MAV_CMD_DO_SET_MODE, 1, 4, 3)  # another may have been chosen on the ground
        desk.exchange()
        self._order(mav.MAV_CMD_DO_FENCE_ENABLE, 0)
        home = desk.vehicle.aircraft.frame.origin
        assert desk.command_int(
            mav.MAV_CMD_DO_SET_HOME, 0, (0, 0, 0, 0), round(home.lat_deg * 1e7),
            round(home.lon_deg * 1e7), home.alt_msl_m,
        ) == mav.MAV_RESULT_ACCEPTED  # fmt: skip
        north, east = map(float, desk.mass.pos_ned_m[:2])
        if desk.upload([item(0, mav.MAV_CMD_NAV_WAYPOINT, north=north + 30.0, east=east)]):
            raise BrokenError("a good mission is refused: " + "".join(desk.texts()))
        self._must(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0)
        self._must(mav.MAV_CMD_MISSION_START)
        desk.fly()
        if not flight.mission.complete:
            raise BrokenError("the mission is not flown to its end")
        self._must(mav.MAV_CMD_NAV_LAND)
        desk.fly()
        desk.exchange()
        self.check()
        if desk.mass.armed or not desk.mass.on_ground:
            raise BrokenError("it does not land")

    def _order(self, command: int, *params: float) -> int:
        return self.desk.command(command, *params)

    def _must(self, command: int, *params: float) -> None:
        if self._order(command, *params) != mav.MAV_RESULT_ACCEPTED:
            raise BrokenError(f"command {command}: " + "".join(self.desk.texts()[-4:]))


class _Errors(logging.Handler):
    """Keeps what was logged as an error."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.records: list[logging.LogRecord] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.records.append(record)
