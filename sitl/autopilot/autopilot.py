"""The autopilot as a whole: messages in, flight, telemetry out. Without I/O and without a clock."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from flightdyn.aircraft import Aircraft
from sitl.autopilot.codec.names import command_name
from sitl.autopilot.codec.telemetry import TELEMETRY
from sitl.autopilot.codec.wire import Wire
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.flying.flight_commands import FlightCommands
from sitl.autopilot.flying.route import check_mission
from sitl.autopilot.modes import Mode
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.pilots.pilots import Pilots
from sitl.autopilot.pilots.stream import Cockpit
from sitl.autopilot.protocol.absent import Absent
from sitl.autopilot.protocol.commands import CommandServer, Refusal
from sitl.autopilot.protocol.ftp import FtpServer
from sitl.autopilot.protocol.item_rules import check_item, why_refused
from sitl.autopilot.protocol.log_server import LogServer
from sitl.autopilot.protocol.message_requests import MessageCommands
from sitl.autopilot.protocol.parameter_server import ParameterServer
from sitl.autopilot.protocol.streams import DEFAULT_RATES_HZ, SERVED_RATES_HZ, Streams
from sitl.autopilot.protocol.transfer import MissionTransfer
from sitl.autopilot.reporter import EventSink, Reporter
from sitl.autopilot.safety.clearance import Clearance
from sitl.autopilot.safety.failsafe import Failsafes
from sitl.autopilot.safety.guard import Guard
from sitl.autopilot.safety.injection import Injector
from sitl.autopilot.safety.monitor import Monitor
from sitl.autopilot.values import messages as m
from sitl.autopilot.values.enums import (
    Command,
    Message,
    MissionResult,
    MissionType,
    Result,
    Severity,
)
from sitl.autopilot.values.files import LogFolder, NoLogs
from sitl.autopilot.values.snapshot import Dials
from sitl.errors import SitlInputError

COMPONENT = 1  # MAV_COMP_ID_AUTOPILOT1


@dataclass(frozen=True, slots=True)
class Storage:
    """Where parameters survive; both raise SitlInputError where that fails."""

    load: Callable[[], Mapping[str, float]]
    save: Callable[[Mapping[str, float]], None]


class Autopilot:
    """Serves MAVLink and flies the aircraft.

    `tick` belongs to simulated time, once a physics tick; `watch` a few times a simulated second.
    `receive`, `poll` and `due` belong to wall time, whose `now` the caller brings.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        parameters: Parameters,
        *,
        system: int,
        sink: EventSink,
        storage: Storage | None = None,
        logs: LogFolder | None = None,
        standalone: bool = False,
    ) -> None:
        self.parameters = parameters
        self._outbox: m.Outbox = []
        self._report = report = Reporter(self._outbox, sink)
        self._wire = Wire(system, COMPONENT)
        self._streams = Streams(SERVED_RATES_HZ if standalone else DEFAULT_RATES_HZ)
        self._storage = storage
        self._standalone = standalone
        self.reboot_ordered = False  # whoever owns the autopilot makes a new one

        self._clearance = clearance = Clearance(aircraft, parameters)
        self.flight = Flight(
            aircraft,
            parameters,
            home=aircraft.frame.origin,
            permissions=clearance,
            reporter=report,
        )
        self._pilots = Pilots(Cockpit(aircraft, self.flight, parameters), report)
        self.monitor = Monitor(aircraft, self.flight, clearance=clearance, reporter=report)
        self.failsafes = Failsafes(
            self.flight, parameters, by_sticks=self._pilots.give_to_sticks, reporter=report
        )
        self.guard = Guard(
            aircraft, self.flight, parameters, clearance=clearance, failsafes=self.failsafes
        )

        self._transfer = MissionTransfer(self._outbox, check=self._check_item, store=self._store)
        files = logs or NoLogs()
        self._servers = (
            self._transfer,
            ParameterServer(self._outbox, parameters),
            LogServer(self._outbox, files, reporter=report, armed=lambda: aircraft.armed),
            FtpServer(self._outbox, files, parameters),
            self._pilots,
            Absent(self._outbox, report),
        )
        self._flight_commands = FlightCommands(aircraft, self.flight, pilots=self._pilots.modes())
        self._message_commands = MessageCommands(self._outbox, self._streams)
        injector = Injector(aircraft, parameters, monitor=self.monitor)
        self.commands = CommandServer(
            self._outbox,
            report,
            {
                **self._flight_commands.handlers(),
                **self._message_commands.handlers(),
                **self._pilots.handlers(),
                Command.PREFLIGHT_STORAGE: self._store_parameters,
                Command.DO_FENCE_ENABLE: self._enable_fence,
                Command.PREFLIGHT_REBOOT_SHUTDOWN: self._order_reboot,
                Command.INJECT_FAILURE: injector.command,
            },
        )

        # Made once, as they are entered many times a second.
        self._health_contained = report.contain("the state of health")
        self._telemetry_contained = report.contain("telemetry")
        self._failsafes_contained = report.contain("the failsafes")
        self._silence_contained = report.contain("the watch for silent streams")
        self._polled = [(server, report.contain(type(server).__name__)) for server in self._servers]

    def tick(self) -> bool:
        """Look after the manoeuvre, after every physics tick; whether there still is one."""
        return self.flight.tick()

    def watch(self) -> None:
        """Look after everything but the manoeuvre."""
        with self._health_contained:
            self.monitor.watch()
        with self._failsafes_contained:
            self.guard.watch()

    @property
    def lists(self) -> Mapping[MissionType, tuple[m.MissionItem, ...]]:
        """Mission, fence and rally points as they were uploaded."""
        return self._transfer.lists

    def restore(self, lists: Mapping[MissionType, tuple[m.MissionItem, ...]]) -> None:
        """Take the lists of an autopilot before this one."""
        self._transfer.restore(lists)

    @property
    def mode(self) -> Mode:
        """The flight mode."""
        return self.flight.mode

    def receive(self, data: bytes, now: float, stream: Hashable = None) -> None:
        """Take bytes that arrived: a datagram, or more of a `stream`."""
        self._pilots.note_time(now)
        received: list[tuple[m.Peer, m.Incoming]] = []
        with self._report.contain("bytes that arrived"):
            received = self._wire.read(data, stream)
        for peer, body in received:
            failed = partial(self._not_handled, peer, body)
            with self._report.contain(type(body).__name__, failed):
                self._handle(peer, body, now)

    def _not_handled(self, peer: m.Peer, body: m.Incoming) -> None:
        """Answer what was asked by a message whose handling failed."""
        if isinstance(body, m.CommandOrder):
            answer: m.Outgoing = m.CommandAck(body.command, Result.FAILED)
            self._outbox.append(m.Envelope(answer, peer))
        else:
            self._transfer.give_up(peer, body)

    def greet(self) -> None:
        """Let a newcomer know that the vehicle is here."""
        self._report.nudged.add(Message.HEARTBEAT)

    def poll(self, now: float) -> list[bytes]:
        """Frames to send now: answers, news, and telemetry that is due."""
        report = self._report
        for server, contained in self._polled:
            with contained:
                server.poll(now)
        with self._silence_contained:
            self._pilots.watch(self.failsafes)
        with self._failsafes_contained:
            self.guard.poll(now)
        nudged = report.nudged
        kinds = self._streams.take_due(now, (*nudged, *self._message_commands.asked))
        nudged.clear()
        self._message_commands.asked.clear()
        frames: list[bytes] = []
        # State first: whoever reads an answer already knows the state that it led to.
        with self._telemetry_contained:
            frames += self._telemetry(kinds)
        answers, self._outbox[:] = list(self._outbox), ()
        for envelope in answers:
            with report.contain(type(envelope.body).__name__):
                frames += self._wire.frames(envelope)
        return frames

    def _telemetry(self, kinds: Sequence[Message]) -> Iterator[bytes]:
        if not kinds:
            return
        snapshot = self.monitor.snapshot(self.failsafes)
        dials: Dials | None = None
        for kind in kinds:
            if kind is Message.MISSION_CURRENT:
                in_mission = self.flight.mode is Mode.MISSION
                body = self.flight.mission.message(in_mission_mode=in_mission)
                yield from self._wire.frames(m.Envelope(body))
            elif kind in TELEMETRY:
                yield self._wire.telemetry(kind, snapshot)
            elif kind is not Message.ORBIT_EXECUTION_STATUS or self._pilots.orbit:
                dials = dials or self.monitor.dials(self._pilots.orbit)
                yield self._wire.instruments(kind, snapshot, dials)

    def due(self) -> float:
        """When `poll` has something to do at the latest."""
        timers = (self._streams.due(), *(server.due() for server in self._servers))
        return min(timer for timer in timers if timer is not None)

    def _handle(self, peer: m.Peer, body: m.Incoming, now: float) -> None:
        if any(server.receive(peer, body, now) for server in self._servers):
            return
        match body:
            case m.CommandOrder():
                self.commands.receive(peer, body, now)
            case m.MissionSetCurrent(seq):
                reason = self.flight.rewind_mission(seq)
                if reason is not None:
                    self._report.say(Severity.WARNING, f"Set current item refused: {reason}")
                self._report.mission_changed()
            case m.SetMode(custom_mode):
                refusal = self._flight_commands.set_mode(custom_mode)
                if refusal is not None:
                    self._report.say(Severity.WARNING, f"Set mode refused: {refusal.reason}")
            case m.Ping(time_us, seq):
                self._outbox.append(m.Envelope(m.Pong(time_us, seq), peer))
            case m.TimeSync(0, sender_ns):
                own_ns = int(now * 1e9)
                self._outbox.append(m.Envelope(m.TimeSync(own_ns, sender_ns), peer))
            case m.Heartbeat(ground_station=True):
                self.guard.heard_ground_station(now)

    def _store_parameters(self, order: m.CommandOrder, _now: float) -> Refusal | None:
        what = order.params[0]
        if what == 2.0:
            self.parameters.reset()
            return None
        if what not in (0.0, 1.0):
            return Refusal(Result.UNSUPPORTED)
        if self._storage is None:
            return Refusal(Result.FAILED, "no parameter file is configured")
        try:
            if what == 0.0:
                self.parameters.apply(self._storage.load(), "parameter file")
            else:
                self._storage.save(self.parameters.as_dict())
        except SitlInputError as error:
            return Refusal(Result.FAILED, str(error))
        return None

    def _order_reboot(self, order: m.CommandOrder, _now: float) -> Refusal | None:
        if order.params[0] != 1.0:
            return Refusal(Result.UNSUPPORTED, f"parameter 1 = {order.params[0]:g}: 1 reboots")
        if not self._standalone:
            return Refusal(Result.DENIED, "the vehicle is part of a run")
        reason = self.flight.not_at_rest()
        if reason:
            return Refusal(Result.TEMPORARILY_REJECTED, reason)
        self.reboot_ordered = True
        return None

    def _enable_fence(self, order: m.CommandOrder, _now: float) -> Refusal | None:
        if order.params[0] not in (0.0, 1.0):
            return Refusal(Result.DENIED, f"parameter 1 = {order.params[0]:g}: 0 or 1")
        self._clearance.fence.enabled = order.params[0] == 1.0
        return None

    def _check_item(self, item: m.MissionItem) -> MissionResult:
        verdict = check_item(item)
        if verdict is not MissionResult.ACCEPTED:
            kind, name = item.mission_type.name.capitalize(), command_name(item.command)
            wrong = f"{kind} refused: item {item.seq} {name}: {why_refused(item, verdict)}"
            self._report.say(Severity.WARNING, wrong)
        return verdict

    def _store(self, kind: MissionType, items: tuple[m.MissionItem, ...]) -> MissionResult:
        """Take a list that was uploaded whole, or say what is wrong with it."""
        if kind is MissionType.FENCE:
            try:
                self._clearance.fence.draw(items)
            except SitlInputError as error:
                self._report.say(Severity.WARNING, str(error))
                return MissionResult.INVALID_PARAM1
        if kind is MissionType.RALLY:
            self.flight.rally = items
        if kind is not MissionType.MISSION:
            return MissionResult.ACCEPTED
        reason = check_mission(
            items,
            frame=self.flight.frame,
            home=self.flight.home,
            farthest_m=self.parameters["MIS_DIST_1WP"],
        )
        if reason:
            self._report.say(Severity.WARNING, f"Mission refused: {reason}")
            return MissionResult.INVALID
        being_flown = self.flight.replace_mission(items)
        if being_flown is not None:
            self._report.say(Severity.WARNING, being_flown)
            return MissionResult.DENIED
        return MissionResult.ACCEPTED
