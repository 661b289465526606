"""What of ArduCopter's protocol differs from PX4's, over UDP; its flight is a moving point.

A stand-in for tests, not a simulator: home as item 0, no NaN, acceptance radius not kept, hardly
any telemetry that was not asked for, ArduPilot's mode numbers, AUTO kept after a mission's end.
"""

import math
import threading
import time
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

STABILIZE, AUTO, GUIDED, LOITER, RTL = 0, 3, 4, 5, 6
_STEP_S = 0.05  # simulated
M_PER_DEG = 111_195.0


class ArduPilotDouble(threading.Thread):
    """A copter at (lat, lon), `speed` times faster than real time.

    Until `located_s` after its start its estimator has no origin: it streams 0, 0, has no home, and
    refuses GUIDED; in STABILIZE it lets itself be armed all the same. `drain` is the charge (0..1)
    that a simulated second costs with motors on; whoever stands disarmed gets a full battery.
    """

    def __init__(
        self,
        port: int,
        *,
        lat: float,
        lon: float,
        speed: float = 10.0,
        located_s: float = 0.0,
        drain: float = 0.0,
    ) -> None:
        super().__init__(daemon=True)
        self.refusals: list[str] = []
        self.uploads = 0
        self.mode = STABILIZE
        self.armed = False
        self.armed_in: list[int] = []  # modes
        # All that are asked for: as ArduCopter, it says nothing of those that it lacks, and MAVSDK
        # asks for such a one again and again, for some seconds.
        self.parameters = {
            "WPNAV_SPEED": 500.0,
            "WPNAV_ACCEL": 250.0,
            "WPNAV_RADIUS": 1000.0,
            "ANGLE_MAX": 3000.0,
            "FENCE_ENABLE": 0.0,
            "FENCE_TYPE": 7.0,
            "FENCE_RADIUS": 300.0,
            "FENCE_ALT_MAX": 100.0,
        }
        self.set_to: list[tuple[str, float]] = []
        self.flown = False
        self._home = (lat, lon)
        self._at = [0.0, 0.0, 0.0]  # north, east, up
        self._velocity = (0.0, 0.0, 0.0)
        self._speed = speed
        self._t = 0.0  # simulated seconds since boot
        self._located_s = located_s
        self._drain, self._charge = drain, 0.8
        self._cruise = 5.0
        self._goal_up: float | None = None
        self._items: list[mav.MAVLink_mission_item_int_message] = []
        self._incoming: list[mav.MAVLink_mission_item_int_message] = []
        self._count = 0
        self._current = 0
        self._running = self._complete = False
        self._interval_s: dict[int, float] = {}
        self._due: dict[int, float] = {}
        self._end = threading.Event()
        self._link = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=1, source_component=1,
            dialect="ardupilotmega",
        )  # fmt: skip

    def stop(self) -> None:
        self._end.set()
        self.join()
        self._link.close()

    def run(self) -> None:
        last, beat = time.monotonic(), 0.0
        while not self._end.is_set():
            now = time.monotonic()
            # A busy machine makes it slower, and its positions no coarser.
            self._move(min((now - last) * self._speed, _STEP_S))
            last = now
            if 33 in self._interval_s:
                self._tell(33)
            if now - beat > 0.5:
                beat = now
                self._heartbeat()
            for number, interval_s in self._interval_s.items():
                if number != 33 and self._t >= self._due.get(number, 0.0):
                    self._due[number] = self._t + interval_s
                    self._tell(number)
            while (message := self._link.recv_match()) is not None:
                self._take(message)
            time.sleep(0.005)

    # --- flight -------------------------------------------------------------------------------

    def _move(self, dt: float) -> None:
        self._t += dt
        if self._drain:
            self._charge = max(self._charge - self._drain * dt, 0.0) if self.armed else 1.0
        self._velocity = (0.0, 0.0, 0.0)
        if self.mode == GUIDED and self._goal_up is not None:
            self._towards((self._at[0], self._at[1], self._goal_up), 3.0, dt)
        elif self.mode == AUTO and self._running:
            self._mission(dt)
        elif self.mode == RTL and self.armed:
            away = math.hypot(self._at[0], self._at[1])
            self._towards((0.0, 0.0, self._at[2] if away > 1.0 else 0.0), 10.0, dt)
            self.armed = self._at[2] > 0.0

    def _towards(self, goal: tuple[float, float, float], speed: float, dt: float) -> bool:
        """Whether it is there."""
        left = math.dist(goal, self._at)
        if left <= speed * dt:
            self._at = list(goal)
            return True
        north, east, down = (speed * (g - a) / left for g, a in zip(goal, self._at, strict=True))
        self._velocity = north, east, down
        self._at = [a + v * dt for a, v in zip(self._at, self._velocity, strict=True)]
        return False

    def _mission(self, dt: float) -> None:
        item = self._items[self._current]
        if item.command == mav.MAV_CMD_DO_CHANGE_SPEED:
            self._cruise = item.param2
        else:
            north = (item.x / 1e7 - self._home[0]) * M_PER_DEG
            east = (item.y / 1e7 - self._home[1]) * M_PER_DEG
            east *= math.cos(math.radians(self._home[0]))
            if not self._towards((north, east, item.z), self._cruise, dt):
                return
        self._link.mav.mission_item_reached_send(self._current)
        if self._current + 1 < len(self._items):
            self._current += 1
        else:
            self._running, self._complete, self.flown = False, True, True
        self._tell(42)

    # --- protocol -----------------------------------------------------------------------------

    def _heartbeat(self) -> None:
        base = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= mav.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        self._link.mav.heartbeat_send(
            mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_ARDUPILOTMEGA, base, self.mode, 4
        )

    @property
    def _located(self) -> bool:
        return self._t >= self._located_s

    def _place(self) -> tuple[int, int]:
        if not self._located:
            return 0, 0
        lat = self._home[0] + self._at[0] / M_PER_DEG
        lon = self._home[1] + self._at[1] / M_PER_DEG / math.cos(math.radians(self._home[0]))
        return round(lat * 1e7), round(lon * 1e7)

    def _tell(self, number: int) -> None:
        send, ms = self._link.mav, int(self._t * 1e3)
        lat, lon = self._place()
        up, percent = round(self._at[2] * 1e3), round(self._charge * 100)
        home = (round(self._home[0] * 1e7), round(self._home[1] * 1e7), 130_000)
        sensors = (1 << 0) | (1 << 1) | (1 << 2) | (1 << 5) | (1 << 28)
        if number == 1:
            send.sys_status_send(sensors, sensors, sensors, 100, 12_000, 500, 80, *(0,) * 6)
        elif number == 24:
            send.gps_raw_int_send(
                ms * 1000, 3 if self._located else 1, lat, lon, 130_000 + up, 80, 80, 0, 0, 12
            )
        elif number == 31:
            send.attitude_quaternion_send(ms, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        elif number == 33:
            north, east, climb = (round(v * 100) for v in self._velocity)
            send.global_position_int_send(
                ms, lat, lon, 130_000 + up, up, north, east, -climb, 65535
            )
        elif number == 42:
            state = 5 if self._complete else 3 if self._running else 2
            send.mission_current_send(self._current, max(len(self._items) - 1, 0), state)
        elif number == 147:
            send.battery_status_send(0, 0, 0, 32767, [12_000] + [65535] * 9, 500, 300, -1, percent)
        elif number == 148:
            send.autopilot_version_send(0xFFFF, 0, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 1)
        elif number == 193:
            flags = 831 if self._located else 1024 + 128  # 831: as ArduCopter's on the ground
            send.ekf_status_report_send(flags, 0.1, 0.1, 0.1, 0.1, 0.0)
        elif number == 242 and self._located:
            send.home_position_send(*home, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0)
        elif number == 245:
            ground = mav.MAV_LANDED_STATE_ON_GROUND
            send.extended_sys_state_send(0, ground if self._at[2] < 0.1 else 2)

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            self._link.mav.command_ack_send(message.command, self._command(message))
        elif kind == "MISSION_COUNT" and message.mission_type == 0:
            self._incoming, self._count = [], message.count
            self._link.mav.mission_request_int_send(245, 190, 0)
        elif kind == "PARAM_REQUEST_READ":
            self._parameter(message.param_id)
        elif kind == "PARAM_SET":
            self.parameters[message.param_id] = message.param_value
            self.set_to.append((message.param_id, message.param_value))
            self._parameter(message.param_id)
        elif kind == "MISSION_ITEM_INT":
            self._item(message)
        elif kind == "MISSION_REQUEST_LIST":
            self._link.mav.mission_count_send(245, 190, len(self._items))
        elif kind == "MISSION_REQUEST_INT":
            item = self._items[message.seq]
            item.target_system, item.target_component = 245, 190
            self._link.mav.send(item)
        elif kind == "MISSION_SET_CURRENT":
            self._current, self._complete = max(message.seq, 1), False
            self._tell(42)

    def _parameter(self, name: str) -> None:
        if name in self.parameters:
            self._link.mav.param_value_send(
                name.encode(), self.parameters[name], mav.MAV_PARAM_TYPE_REAL32,
                len(self.parameters), list(self.parameters).index(name),
            )  # fmt: skip

    def _item(self, item: mav.MAVLink_mission_item_int_message) -> None:
        params = (item.param1, item.param2, item.param3, item.param4)
        if not all(map(math.isfinite, params)):
            self.refusals.append(f"item {item.seq}: {params}")
            self._link.mav.mission_ack_send(245, 190, mav.MAV_MISSION_INVALID_PARAM1)
            return
        item.param2 = 0.0 if item.command == mav.MAV_CMD_NAV_WAYPOINT else item.param2
        self._incoming.append(item)
        if len(self._incoming) < self._count:
            self._link.mav.mission_request_int_send(245, 190, len(self._incoming))
            return
        home = self._incoming[0]  # whatever came there: it has its own
        home.frame, home.z = 0, 130.0
        home.x, home.y = round(self._home[0] * 1e7), round(self._home[1] * 1e7)
        self._items, self.uploads = self._incoming, self.uploads + 1
        self._running, self._complete = False, False
        self._link.mav.mission_ack_send(245, 190, mav.MAV_MISSION_ACCEPTED)

    def _command(self, order: mav.MAVLink_command_long_message) -> int:
        accepted, denied = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_FAILED
        match order.command:
            case mav.MAV_CMD_SET_MESSAGE_INTERVAL:
                self._interval_s[int(order.param1)] = order.param2 / 1e6
            case mav.MAV_CMD_REQUEST_MESSAGE:
                self._tell(int(order.param1))
            case mav.MAV_CMD_COMPONENT_ARM_DISARM:
                self.armed = order.param1 == 1.0
                self.armed_in += [self.mode] if self.armed else []
            case mav.MAV_CMD_DO_SET_MODE:
                if int(order.param2) != STABILIZE and not self._located:
                    return denied
                self.mode = int(order.param2)
            case mav.MAV_CMD_NAV_TAKEOFF:
                if self.mode != GUIDED or not self.armed:
                    return denied
                self._goal_up = order.param7
            case mav.MAV_CMD_MISSION_START:
                if self.mode != AUTO or len(self._items) < 2:
                    return denied
                self._current = max(self._current, 1)
                self._running, self._complete = True, False
                self._link.mav.statustext_send(mav.MAV_SEVERITY_INFO, b"Mission: 1 WP")
            case mav.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self.mode = RTL
            case _:
                return mav.MAV_RESULT_UNSUPPORTED
        self._heartbeat()
        return accepted
