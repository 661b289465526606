"""A ground station's desk without a network: pymavlink on one side, the vehicle on the other."""

from typing import Any

from pymavlink.dialects.v20 import common as mav
from sitl_mavsdk import HOME, Recorder
from sitl_point_mass import PointMass

from flightdyn.aircraft import Aircraft
from flightdyn.random import RandomStreams
from sitl.config import VehicleConfig
from sitl.logfolder import LogFolder
from sitl.vehicle import Vehicle


class Desk:
    """Talks to a vehicle on a point mass, in a wall time of its own that it sets itself."""

    def __init__(
        self,
        config: VehicleConfig | None = None,
        *,
        ready: bool = True,
        ready_after_s: float = 0.2,
        aircraft: Aircraft | None = None,
        logs: LogFolder | None = None,
        orders: Any = None,
    ) -> None:
        """`aircraft` flies instead of the point mass."""
        self.recorder = Recorder()
        self.mass = PointMass(HOME, ready_after_s=ready_after_s)
        self.vehicle = Vehicle(
            config or VehicleConfig(),
            home=HOME,
            streams=RandomStreams(1),
            observers=(self.recorder,),
            aircraft=aircraft or self.mass,  # type: ignore[arg-type]
            logs=logs,
            orders=orders,
        )
        self.now = 100.0
        self.heard: list[Any] = []
        self._out = mav.MAVLink(None, srcSystem=255, srcComponent=190)
        self._in = mav.MAVLink(None)
        if ready:
            self.fly()
            self.exchange()

    def send(self, *messages: Any) -> list[Any]:
        """Send messages and hand back what the vehicle says to them."""
        for message in messages:
            self.vehicle.receive(bytes(message.pack(self._out)), self.now)
        return self.exchange()

    def exchange(self) -> list[Any]:
        """What the vehicle says now."""
        heard: list[Any] = []
        for _, frame in self.vehicle.outgoing(self.now):
            heard += self._in.parse_buffer(frame) or []
        self.heard += heard
        return heard

    def pass_wall_time(self, seconds: float, *, step: float = 0.1) -> list[Any]:
        """Let wall time pass."""
        heard: list[Any] = []
        for _ in range(round(seconds / step)):
            self.now += step
            heard += self.exchange()
        return heard

    def fly(self, *, seconds: float | None = None) -> None:
        """Let simulated time pass: until nothing moves, or for so long."""
        limit_ns = self.vehicle.t_ns + round((600.0 if seconds is None else seconds) * 1e9)
        while self.vehicle.t_ns < limit_ns and (seconds is not None or self.vehicle.moving):
            self.vehicle.step()
        assert seconds is not None or not self.vehicle.moving, "never came to an end"

    def command(self, number: int, *params: float, confirmation: int = 0) -> int:
        """Send a COMMAND_LONG; the result of its acknowledgement."""
        seven = (*params, *[float("nan")] * (7 - len(params)))
        heard = self.send(mav.MAVLink_command_long_message(1, 1, number, confirmation, *seven))
        return the(heard, "COMMAND_ACK").result

    def command_int(
        self, number: int, frame: int, params: tuple[float, ...], x: int, y: int, z: float
    ) -> int:
        """Send a COMMAND_INT; the result of its acknowledgement."""
        p1, p2, p3, p4 = params
        heard = self.send(
            mav.MAVLink_command_int_message(1, 1, frame, number, 0, 0, p1, p2, p3, p4, x, y, z)
        )
        return the(heard, "COMMAND_ACK").result

    def take_off(self, height_m: float = 30.0) -> None:
        """To a hover above home."""
        assert self.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0) == mav.MAV_RESULT_ACCEPTED
        altitude = HOME.alt_msl_m + height_m
        nan = float("nan")
        result = self.command(mav.MAV_CMD_NAV_TAKEOFF, nan, nan, nan, nan, nan, nan, altitude)
        assert result == mav.MAV_RESULT_ACCEPTED
        self.fly()

    def upload(self, items: list[Any], mission_type: int = mav.MAV_MISSION_TYPE_MISSION) -> int:
        """Upload a list; the result."""
        heard = self.send(mav.MAVLink_mission_count_message(1, 1, len(items), mission_type))
        while not (acks := of(heard, "MISSION_ACK")):
            heard = self.send(items[the(heard, "MISSION_REQUEST_INT").seq])
        return acks[0].type

    def texts(self) -> list[str]:
        """All status texts heard so far."""
        return [message.text for message in of(self.heard, "STATUSTEXT")]


def of(messages: list[Any], kind: str) -> list[Any]:
    """The messages of one kind."""
    return [message for message in messages if message.get_type() == kind]


def the(messages: list[Any], kind: str) -> Any:
    """The only message of one kind."""
    (message,) = of(messages, kind)
    return message


def item(
    seq: int,
    command: int,
    *,
    north: float = 0.0,
    east: float = 0.0,
    height: float = 30.0,
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, float("nan")),
    frame: int = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    mission_type: int = mav.MAV_MISSION_TYPE_MISSION,
) -> Any:
    """A mission item at a place about HOME; positions to 1e-7 degrees."""
    import numpy as np

    from flightdyn.frames import LocalFrame

    known = mav.enums["MAV_CMD"].get(command)
    place = LocalFrame(HOME).to_geodetic(np.array([north, east, 0.0]))
    where = round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), height
    if mission_type == mav.MAV_MISSION_TYPE_FENCE:
        where = (*where[:2], 0.0)
    elif known is not None and not known.has_location:
        where = (0, 0, 0.0)
    return mav.MAVLink_mission_item_int_message(
        1, 1, seq, frame, command, 0, 1, *params, *where, mission_type
    )


def speed_item(seq: int, speed_mps: float) -> Any:
    """A DO_CHANGE_SPEED item."""
    return mav.MAVLink_mission_item_int_message(
        1, 1, seq, mav.MAV_FRAME_MISSION, mav.MAV_CMD_DO_CHANGE_SPEED, 0, 1,
        1.0, speed_mps, -1.0, 0.0, 0, 0, 0.0, 0,
    )  # fmt: skip
