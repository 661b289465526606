"""The autopilot as a whole: messages in, flight, telemetry out. Without I/O and without a clock."""

from functools import partial
from pathlib import Path

from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from sitl.autopilot.codec.instruments import Snapshot
from sitl.autopilot.codec.orders import (
    CommandOrder,
    Handlers,
    MissionItem,
    OrderObserver,
    Outbox,
    Peer,
    Place,
    command_name,
)
from sitl.autopilot.codec.telemetry import TELEMETRY
from sitl.autopilot.codec.wire import Wire
from sitl.autopilot.failsafe import Failsafes
from sitl.autopilot.fence import FenceError
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.flying.flight_commands import FlightCommands, Orbits
from sitl.autopilot.flying.modes import Mode
from sitl.autopilot.guard import Guard
from sitl.autopilot.injection import Injector
from sitl.autopilot.monitor import Monitor
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.pilots.follow import Follower
from sitl.autopilot.pilots.offboard import Offboard
from sitl.autopilot.pilots.sticks import Sticks
from sitl.autopilot.pilots.stream import Cockpit
from sitl.autopilot.protocol.commands import CommandServer, NoPayload, RefusedError, demand
from sitl.autopilot.protocol.ftp import FtpServer
from sitl.autopilot.protocol.log_server import LogServer
from sitl.autopilot.protocol.order_rules import absent, check_item
from sitl.autopilot.protocol.parameter_server import ParameterServer
from sitl.autopilot.protocol.streams import DEFAULT_RATES_HZ, SERVED_RATES_HZ, Streams
from sitl.autopilot.protocol.transfer import MissionTransfer
from sitl.autopilot.reporter import EventSink, Reporter
from sitl.logfolder import LogFolder

COMPONENT = mav.MAV_COMP_ID_AUTOPILOT1
_LISTS = {
    mav.MAV_MISSION_TYPE_MISSION: "Mission",
    mav.MAV_MISSION_TYPE_FENCE: "Fence",
    mav.MAV_MISSION_TYPE_RALLY: "Rally",
}


class Autopilot:
    """The whole autopilot: serves MAVLink and flies the aircraft.

    Call `tick` after every step of the aircraft, and `watch` a few times a simulated second.
    `receive`, `poll` and `due` run in wall time, which the caller passes as `now` (s). Silence of
    pilots and ground stations is measured in wall time or, if `in_step`, in simulated time.
    `booted_ns` is the date of simulated time zero, since 1970.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        parameters: Parameters,
        *,
        system: int,
        booted_ns: int,
        sink: EventSink,
        parameter_file: Path | None = None,
        logs: LogFolder | None = None,
        orders: OrderObserver | None = None,
        standalone: bool = False,
        in_step: bool = False,
    ) -> None:
        self._in_step = in_step
        self._aircraft, self._orders, self._booted_ns = aircraft, orders, booted_ns
        self.parameters = parameters
        self._outbox = Outbox()
        self._report = report = Reporter(self._outbox, sink)
        self._wire = Wire(system, COMPONENT)
        rates_hz = SERVED_RATES_HZ if standalone else DEFAULT_RATES_HZ
        self._streams = Streams(self._outbox, rates_hz, silent=self._silent)
        self._standalone = standalone
        self.reboot_ordered = False  # whoever owns the autopilot makes a new one

        self._guard = guard = Guard(aircraft, parameters)
        self.flight = flight = Flight(aircraft, parameters, guard=guard, reporter=report)
        self._cockpit = Cockpit(aircraft, flight, parameters, report)
        self._offboard, self._sticks = Offboard(self._cockpit), Sticks(self._cockpit)
        follower, self._orbits = Follower(self._cockpit), Orbits(aircraft, flight)
        self.monitor = Monitor(aircraft, flight, guard=guard, reporter=report)
        by_sticks = self._sticks.enter
        self.failsafes = Failsafes(aircraft, flight, parameters, guard, by_sticks, report)

        self.transfer = MissionTransfer(
            self._outbox, report, check=self._check_item, store=self._take
        )
        files = logs or LogFolder(None)
        parameter_server = ParameterServer(self._outbox, parameters, parameter_file)
        log_server = LogServer(self._outbox, files, reporter=report, armed=lambda: aircraft.armed)
        ftp_server = FtpServer(self._outbox, files, parameters)
        flown = {
            Mode.OFFBOARD: self._offboard.enter,
            Mode.FOLLOW: follower.enter,
            **self._sticks.modes(),
        }
        self._flight_commands = FlightCommands(aircraft, flight, pilots=flown)
        self.commands = CommandServer(
            self._outbox,
            report,
            {
                **self._flight_commands.commands,
                **self._streams.commands,
                **self._orbits.commands,
                **Injector(aircraft, parameters, monitor=self.monitor).commands,
                **parameter_server.commands,
                mav.MAV_CMD_DO_FENCE_ENABLE: self._enable_fence,
                mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: self._order_reboot,
            },
        )
        self._handlers: Handlers = {
            **NoPayload(self._outbox, report).handlers,  # of what none of the others takes
            **self.commands.handlers,
            **self.transfer.handlers,
            **parameter_server.handlers,
            **log_server.handlers,
            **ftp_server.handlers,
            **self._offboard.handlers,
            **self._sticks.handlers,
            **follower.handlers,
            mav.MAVLink_mission_set_current_message: self._set_current,
            mav.MAVLink_set_mode_message: self._set_mode,
            mav.MAVLink_ping_message: self._pong,
            mav.MAVLink_timesync_message: self._time_sync,
            mav.MAVLink_heartbeat_message: self._heartbeat,
        }
        servers = (self.transfer, parameter_server.burst, log_server.burst, ftp_server.burst)
        timers = (self._streams, *servers, self._offboard, self._sticks)
        self._timers = timers[:-2] if in_step else timers

        # Made once, as they are entered many times a second.
        self._health_contained = report.contain("the state of health")
        self._telemetry_contained = report.contain("telemetry")
        self._failsafes_contained = report.contain("the failsafes")
        self._silence_contained = report.contain("the watch for silent streams")
        self._polled = [(server, report.contain(type(server).__name__)) for server in servers]

    def tick(self) -> bool:
        """Advance the manoeuvre after a step of the aircraft; return whether one is under way."""
        return self.flight.tick()

    def watch(self) -> None:
        """Check health and failsafes, a few times a simulated second."""
        with self._health_contained:
            self.monitor.watch()
        with self._failsafes_contained:
            self.failsafes.watch()
        if self._in_step:
            self._listen(self._aircraft.t_ns * 1e-9)

    def _listen(self, now: float) -> None:
        """Check pilots and ground station for silence at `now` (s), simulated if `in_step`."""
        self._cockpit.now = now
        with self._silence_contained:
            self._offboard.watch(self.failsafes)
            self._sticks.watch(self.failsafes)
        with self._failsafes_contained:
            self.failsafes.poll(now)

    @property
    def mode(self) -> Mode:
        """The flight mode."""
        return self.flight.mode

    @property
    def time_us(self) -> int:
        """The date, since 1970."""
        return (self._booted_ns + self._aircraft.t_ns) // 1000

    def say(self, text: str, severity: int) -> None:
        """Send a status text, and tell observers."""
        self._report.say(text, severity)

    def pass_on(self, message: mav.MAVLink_message) -> None:
        """Send a message of somebody else's with the next `poll`."""
        self._outbox.append(message)

    def receive(self, datagram: bytes, now: float, at: Place = None) -> None:
        """Handle the messages of a datagram that arrived at the wall time `now` (s), from `at`."""
        self._cockpit.now = self._aircraft.t_ns * 1e-9 if self._in_step else now
        received: list[mav.MAVLink_message] = []
        with self._report.contain("bytes that arrived"):
            received = self._wire.read(datagram)
        for message in received:
            handler = self._handlers.get(type(message))
            if handler is not None:
                peer = Peer(message.get_srcSystem(), message.get_srcComponent(), at)
                failed = partial(self._not_handled, peer, message)
                with self._report.contain(message.get_type(), failed):
                    handler(peer, message, now)
                    if self._orders is not None and type(message) in self._offboard.handlers:
                        self._orders.heard(self._aircraft.t_ns, message)

    def _not_handled(self, peer: Peer, message: mav.MAVLink_message) -> None:
        """Answer what was asked by a message whose handling failed."""
        if type(message) in self.transfer.handlers:
            self.transfer.give_up(peer, message)
        elif type(message) in self.commands.handlers:
            self.commands.give_up(peer, message)

    def greet(self) -> None:
        """Somebody has joined a link: send a heartbeat with the next `poll`."""
        self._report.nudge(mav.MAVLINK_MSG_ID_HEARTBEAT)

    def poll(self, now: float) -> list[tuple[Place, bytes]]:
        """Return the frames to send at `now` (s): due telemetry, answers and status texts; each
        with where it goes, None for everywhere.
        """
        report = self._report
        for server, contained in self._polled:
            with contained:
                server.poll(now)
        if not self._in_step:
            self._listen(now)
        kinds = self._streams.take_due(now, report.nudged)
        report.nudged.clear()
        # Items reached first: the state may say that they were the last. Answers last: whoever
        # reads one already knows the state that it led to.
        frames = self._packed(report.items_reached)
        if kinds:
            with self._telemetry_contained:
                snapshot = self._snapshot()
                for kind in kinds:
                    message = TELEMETRY[kind](snapshot)
                    if message is not None:
                        frames.append((None, self._wire.pack(message)))
        return frames + self._packed(self._outbox)

    def _snapshot(self) -> Snapshot:
        return self.monitor.snapshot(self.failsafes, self._orbits.current, self._booted_ns)

    def _silent(self, kind: int) -> bool:
        return TELEMETRY[kind](self._snapshot()) is None

    def _packed(self, outbox: Outbox) -> list[tuple[Place, bytes]]:
        """The frames of the messages that wait in an outbox, which is empty then."""
        frames: list[tuple[Place, bytes]] = []
        for place, message in outbox.take():
            with self._report.contain(message.get_type()):
                frames.append((place, self._wire.pack(message)))
        return frames

    def due(self) -> float:
        """The wall time (s) by which `poll` has to be called again."""
        return min(timer.due() for timer in self._timers)

    def _set_current(
        self, _peer: Peer, msg: mav.MAVLink_mission_set_current_message, _now: float
    ) -> None:
        reason = self.flight.rewind_mission(msg.seq, reset=False)
        if reason is not None:
            self._report.say(f"Set current item refused: {reason}")
        self._report.nudge(mav.MAVLINK_MSG_ID_MISSION_CURRENT)

    def _set_mode(self, _peer: Peer, msg: mav.MAVLink_set_mode_message, _now: float) -> None:
        try:
            self._flight_commands.set_mode(msg.base_mode, msg.custom_mode)
        except RefusedError as refused:
            self._report.say(f"Set mode refused: {refused}")

    def _pong(self, peer: Peer, msg: mav.MAVLink_ping_message, _now: float) -> None:
        self._outbox.append(mav.MAVLink_ping_message(msg.time_usec, msg.seq, *peer.ids), peer)

    def _time_sync(self, _peer: Peer, msg: mav.MAVLink_timesync_message, _now: float) -> None:
        if msg.tc1 == 0:  # else an answer, and nothing here asks
            t_ns = max(1, self._aircraft.t_ns)  # by the clock of telemetry's stamps; 0 asks
            self._outbox.append(mav.MAVLink_timesync_message(t_ns, msg.ts1))

    def _heartbeat(self, _peer: Peer, msg: mav.MAVLink_heartbeat_message, _now: float) -> None:
        if msg.type == mav.MAV_TYPE_GCS:
            self.failsafes.ground_station_heard_s = self._cockpit.now

    def _order_reboot(self, _order: CommandOrder) -> None:
        if not self._standalone:
            raise RefusedError("the vehicle is part of a run")
        demand(self.flight.not_at_rest())
        self.reboot_ordered = True

    def _enable_fence(self, order: CommandOrder) -> None:
        self._guard.fence_enabled = order.params[0] == 1.0

    def _check_item(self, item: MissionItem) -> int:
        verdict, why = check_item(item)
        if verdict != mav.MAV_MISSION_ACCEPTED:
            kind, name = _LISTS[item.mission_type], command_name(item.command)
            self._report.say(f"{kind} refused: item {item.seq} {name}: {why}")
        return verdict

    def _take(self, kind: int, items: tuple[MissionItem, ...]) -> int:
        verdict = self._store(kind, items)
        if self._orders is not None and verdict == mav.MAV_MISSION_ACCEPTED:
            self._orders.took(self._aircraft.t_ns, kind, items)
        return verdict

    def _store(self, kind: int, items: tuple[MissionItem, ...]) -> int:
        """Take a complete list, or report what is wrong; return its MAV_MISSION_RESULT."""
        if kind == mav.MAV_MISSION_TYPE_FENCE:
            try:
                self._guard.draw_fence(items)
            except FenceError as error:
                self._report.say(str(error))
                return error.result
            return mav.MAV_MISSION_ACCEPTED
        if trouble := self.flight.navigator.trouble(items):
            self._report.say(f"{_LISTS[kind]} refused: {trouble}")
            return mav.MAV_MISSION_INVALID
        if kind == mav.MAV_MISSION_TYPE_RALLY:
            self.flight.rally = items
            return mav.MAV_MISSION_ACCEPTED
        being_flown = self.flight.replace_mission(items)
        if being_flown is not None:
            self._report.say(being_flown)
            return mav.MAV_MISSION_DENIED
        if parts := absent(items):
            self._report.say(f"Skipped, as not on board: {parts}", mav.MAV_SEVERITY_NOTICE)
        return mav.MAV_MISSION_ACCEPTED
