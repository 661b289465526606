"""The flight of a vehicle that only telemetry tells of, as samples and events for log and track.

MAVSDK's telemetry plugin drops the time stamps, so positions are taken from the messages
themselves: the clock is the vehicle's own, counted from the first position that can be believed.
"""

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.frames import frozen
from flightdyn.state import BatteryState, GeodeticPoint, Kinematics, Moment
from mission.base.area import Area
from mission.flight.pilot.control_rows import ATTITUDE, MOTION, ControlRows
from mission.flight.pilot.dialects import PX4
from mission.flight.pilot.mavsdk_calls import follow
from mission.flight.pilot.pilot import Pilot
from mission.flight.pilot.watch import Readiness
from mission.flight.track import TrackPoint
from sitl.autopilot.codec.orders import Fields
from sitl.observer import FAILING, EventKind, VehicleEvent, VehicleObserver, VehicleSample

# Message number and rate: what this package and MAVSDK's plugins live on. Nobody but the vehicle
# knows what it sends by itself; ArduPilot sends next to nothing.
STREAMS_HZ = {
    "SYS_STATUS": (1, 2.0),
    "GPS_RAW_INT": (24, 2.0),
    "ATTITUDE_QUATERNION": (31, 10.0),
    "GLOBAL_POSITION_INT": (33, 20.0),
    "MISSION_CURRENT": (42, 5.0),
    "BATTERY_STATUS": (147, 1.0),
    "HOME_POSITION": (242, 1.0),
    "EXTENDED_SYS_STATE": (245, 5.0),
}
ESTIMATOR_HZ = 2.0
_FENCE_STATUS, _FENCE_HZ = 162, 1.0  # with ArduPilot, whose breaches are no failsafes elsewhere
# ATTITUDE_QUATERNION and the setpoints ATTITUDE_TARGET and POSITION_TARGET_LOCAL_NED.
_CONTROL = 31, 83, 85
_UNKNOWN_PERCENT = -1
_ORDERED = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
_NS_PER_MS = 1_000_000
_REBOOT_MS = 5_000  # no message is that late
FLOWN_S = 120.0  # in which any battery loses more than a reading's 1 %
_WARNING, _INFO = 4, 6  # MAV_SEVERITY


Takers = dict[str, Callable[[Fields], None]]  # who takes the messages of a name


@dataclass(frozen=True)
class Known:
    """What our simulated world knows of a firmware's vehicle, whose clock is ours."""

    truth: Callable[[int], Moment]  # at an instant of our clock, ns
    faults: Sequence[tuple[int, str]]  # when (ns) one began or ended, and which; it grows
    # To be filled by the feed, and called with each message, however fast time goes, in the order
    # of their coming; None: messages are MAVSDK's.
    takers: Takers | None = None
    motors: Callable[[int], Sequence[float]] | None = None  # their duty cycles; None: no `/control`
    control_hz: float = 0.0  # of attitude and setpoints


class TelemetryFeed:
    """Turns a vehicle's messages into samples and events.

    Belief is what it says; so is the truth, where nobody knows better.
    """

    def __init__(
        self,
        pilot: Pilot,
        *,
        area: Area,
        observers: Sequence[VehicleObserver],
        known: Known | None = None,
    ) -> None:
        self._pilot = pilot
        self._area = area
        self._observers = observers
        self._known = known
        self._clock = VehicleClock(None if known is None else 0)
        self._attitude = frozen([1.0, 0.0, 0.0, 0.0])
        self._rates = frozen([0.0, 0.0, 0.0])
        self._control = ControlRows()
        self._control_hz = known.control_hz if known and known.motors else 0.0
        self._origin = (math.nan,) * 3  # of the vehicle's local frame, NED about home
        self._battery = BatteryState(math.nan, math.nan, math.nan, math.nan)
        # The lowest heard of is the one that counts: 0, but PX4 calls a smart battery 255.
        self._battery_id = math.inf
        self._moment: tuple[Kinematics, Kinematics] | None = None  # the newest truth and belief
        self._mode: tuple[str, bool] | None = None
        self._failing: set[str] = set()
        self._told = 0  # of the faults
        self._estimator = ""
        self._early: list[tuple[EventKind, str, int]] = []  # before there was a position
        self.readiness = Readiness(pilot.dialect.estimator)
        self.battery = BatteryWatch()
        self.first: asyncio.Future[GeodeticPoint] = asyncio.get_running_loop().create_future()
        self.reached_ns: dict[int, list[int]] = {}  # by item: when the vehicle said so
        self._reported = -1  # item, most recently
        self.first_item = pilot.dialect.first_item  # of what is flown
        pilot.watch.listeners.append(self._take_text)

    @property
    def here(self) -> TrackPoint | None:
        """The newest position; None before the first."""
        if self._moment is None:
            return None
        truth, belief = self._moment
        return TrackPoint(belief.t_ns, truth.pos_ned_m, belief.pos_ned_m)

    @property
    def now_s(self) -> float:
        """The vehicle's time at the newest position; 0 before the first."""
        return 0.0 if self._moment is None else self._moment[1].t_ns / 1e9

    @property
    def battery_remaining(self) -> float:
        """Charge of the battery, 0..1; NaN where the vehicle does not know."""
        return self._battery.remaining

    async def ask(self) -> None:
        """Ask for the streams. A vehicle may refuse what it sends anyway."""
        messages = self._pilot.messages
        for number, rate_hz in STREAMS_HZ.values():
            await messages.stream(number, rate_hz)
        if self._pilot.dialect is not PX4:
            await messages.stream(_FENCE_STATUS, _FENCE_HZ)
        for number in _CONTROL if self._control_hz else ():
            await messages.stream(number, self._control_hz)
        self.readiness.estimator_promised = await messages.stream(
            self._pilot.dialect.estimator_number, ESTIMATOR_HZ
        )

    async def watch(self) -> None:
        """Follow the messages until cancelled."""
        takers: Takers = {
            "HEARTBEAT": self._hear_heartbeat,
            "FENCE_STATUS": self._hear_fence,
            "GLOBAL_POSITION_INT": self._hear_position,
            "ATTITUDE_QUATERNION": self._hear_attitude,
            "BATTERY_STATUS": self._hear_battery,
            "MISSION_ITEM_REACHED": self._hear_reached,
        }
        if self._control_hz:
            takers["ATTITUDE_TARGET"] = self._hear_attitude_setpoint
        if self._control_hz and self._pilot.dialect is PX4:
            # ArduPilot tells zeros for what is not ordered, and not where its origin is.
            takers["POSITION_TARGET_LOCAL_NED"] = self._hear_motion_setpoint
            takers["HOME_POSITION"] = self._hear_home
        messages = self._pilot.messages
        async with asyncio.TaskGroup() as group:
            group.create_task(self.readiness.watch(messages))
            if self._known and self._known.takers is not None:
                self._known.takers.update(takers)
            else:
                streams = [(messages.of(name), take) for name, take in takers.items()]
                group.create_task(follow(*streams))

    def note(self, text: str) -> None:
        """Report a line of text to the observers as a status event at the present position."""
        self._happened("status", text, _INFO)

    def passed(self, seq: int, passage: TrackPoint) -> None:
        """Tell the observers when an item was reached, which is known afterwards only."""
        if self._moment is None:
            return
        truth, belief = (
            Kinematics(passage.t_ns, place, now.vel_ned_mps, now.q_frd_to_ned, now.omega_frd_radps)
            for place, now in zip(
                (passage.true_ned_m, passage.est_ned_m), self._moment, strict=True
            )
        )
        self._tell(VehicleEvent(passage.t_ns, "reached", f"item {seq}", truth, belief, seq, _INFO))

    def _hear_position(self, fields: Fields) -> None:
        if self._moment is None and self.readiness.missing:
            return
        restarts = self._clock.restarts
        t_ns = self._clock.t_ns(fields["time_boot_ms"])
        if self._clock.restarts != restarts:
            self.readiness.forget()
        if self._moment is not None and t_ns <= self._moment[0].t_ns:
            return
        height_m = fields["relative_alt"] / 1e3
        seen = GeodeticPoint(
            fields["lat"] / 1e7, fields["lon"] / 1e7, self._area.home.alt_msl_m + height_m
        )
        position = self._area.frame.to_ned(seen.lat_deg, seen.lon_deg, seen.alt_msl_m)
        velocity = frozen([fields["vx"] / 1e2, fields["vy"] / 1e2, fields["vz"] / 1e2])
        belief = Kinematics(t_ns, position, velocity, self._attitude, self._rates)
        if self._known is None:
            self._sampled(Moment(belief, self._battery, None), belief)
        else:
            self._sampled(self._known.truth(t_ns), belief)
        if not self.first.done():
            self.first.set_result(seen)

    def _sampled(self, known: Moment, belief: Kinematics) -> None:
        """Give the observers a sample of one instant, and an event for each change of state."""
        truth = known.kinematics
        before, self._moment = self._moment, (truth, belief)
        mode, armed = self._pilot.mode, self._pilot.armed
        self.battery.read(belief.t_ns, self._battery.remaining, flying=self._pilot.flying)
        sample = VehicleSample(
            t_ns=belief.t_ns,
            truth=truth,
            belief=belief,
            gnss=None,
            battery=known.battery,
            mode=mode,
            armed=armed,
            wind_ned_mps=known.wind_ned_mps,
            control=None if before is None else self._control.take(before[1].t_ns),
        )
        for observer in self._observers:
            observer.sampled(sample)
        early, self._early = self._early, []
        for kind, text, severity in early:
            self._happened(kind, text, severity)
        was, self._mode = self._mode, (mode, armed)
        if was is None or was[0] != mode:
            self._happened("mode", mode, _INFO)
        if armed != (was is not None and was[1]):  # one that is heard late is armed from then on
            self._happened("armed", "armed" if armed else "disarmed", _INFO)
        faults = () if self._known is None else self._known.faults
        while self._told < len(faults) and faults[self._told][0] <= belief.t_ns:
            self._told += 1
            self._happened("fault", faults[self._told - 1][1], _WARNING)
        if self.readiness.estimator != self._estimator:
            self._estimator = self.readiness.estimator
            self._happened("status", self._estimator, _INFO)

    def _happened(
        self, kind: EventKind, text: str, severity: int, *, seq: int | None = None
    ) -> None:
        if self._moment is None:
            self._early.append((kind, text, severity))
            return
        truth, belief = self._moment
        self._tell(VehicleEvent(truth.t_ns, kind, text, truth, belief, seq, severity))

    def _tell(self, event: VehicleEvent) -> None:
        for observer in self._observers:
            observer.happened(event)

    def _take_text(self, severity: int, text: str) -> None:
        self._happened("status", text.strip(), severity)

    def _hear_heartbeat(self, fields: Fields) -> None:
        if fields["autopilot"] != mav.MAV_AUTOPILOT_INVALID:  # else of a part, a camera, say
            armed = fields["base_mode"] & mav.MAV_MODE_FLAG_SAFETY_ARMED
            self._fails("failsafe", on=bool(armed) and fields["system_status"] in FAILING)

    def _hear_fence(self, fields: Fields) -> None:
        self._fails("fence breached", on=self._pilot.armed and bool(fields["breach_status"]))

    def _fails(self, what: str, *, on: bool) -> None:
        if on and what not in self._failing:
            self._happened("failsafe", what, _WARNING)
        self._failing = self._failing | {what} if on else self._failing - {what}

    def _hear_attitude(self, fields: Fields) -> None:
        q = np.array([fields["q1"], fields["q2"], fields["q3"], fields["q4"]])
        self._attitude = frozen(q / np.linalg.norm(q))
        self._rates = frozen((fields["rollspeed"], fields["pitchspeed"], fields["yawspeed"]))
        if self._control_hz and self._known and self._known.motors and self._pilot.armed:
            t_ns = fields["time_boot_ms"] * _NS_PER_MS
            self._control.attitude(t_ns, self._attitude, self._rates, self._known.motors(t_ns))

    def _hear_attitude_setpoint(self, fields: Fields) -> None:
        rates = [fields[f"body_{axis}_rate"] for axis in ("roll", "pitch", "yaw")]
        if self._pilot.dialect is not PX4:  # ArduPilot's are how fast the setpoint itself turns
            rates = [math.nan] * 3
        t_ns, numbers = (
            fields["time_boot_ms"] * _NS_PER_MS,
            (*fields["q"], *rates, fields["thrust"]),
        )
        self._control.setpoint(ATTITUDE, t_ns, numbers)

    def _hear_motion_setpoint(self, fields: Fields) -> None:
        ordered = [float(fields[name]) for name in _ORDERED]
        ordered[:3] = np.add(ordered[:3], self._origin)
        self._control.setpoint(MOTION, fields["time_boot_ms"] * _NS_PER_MS, ordered)

    def _hear_home(self, fields: Fields) -> None:
        lat, lon = fields["latitude"] / 1e7, fields["longitude"] / 1e7
        place = self._area.frame.to_ned(lat, lon, self._area.home.alt_msl_m)
        self._origin = place[0] - fields["x"], place[1] - fields["y"], -fields["z"]

    def _hear_battery(self, fields: Fields) -> None:
        if fields["id"] > self._battery_id:
            return
        self._battery_id = fields["id"]
        percent, consumed = fields["battery_remaining"], fields["current_consumed"]
        cells = [cell for cell in fields["voltages"] if cell < 65535]
        current = fields["current_battery"]
        self._battery = BatteryState(
            sum(cells) / 1e3 if cells else math.nan,
            math.nan if current == -1 else current / 1e2,
            math.nan if consumed == -1 else float(consumed),
            math.nan if percent == _UNKNOWN_PERCENT else percent / 100,
        )

    def _hear_reached(self, fields: Fields) -> None:
        seq, before = fields["seq"] - self.first_item, self._reported
        self._reported = seq
        again = seq == before and seq in self.reached_ns  # as PX4 says once a second
        if self._moment is not None and not again:
            self.reached_ns.setdefault(seq, []).append(self._moment[0].t_ns)
            self._happened("status", f"item {seq}: reported", _INFO, seq=seq)


class VehicleClock:
    """Vehicle time by the stamps of its messages: nanoseconds since `zero_ms`, or the first stamp.
    A restart of the vehicle does not set it back."""

    def __init__(self, zero_ms: int | None = None) -> None:
        self._zero_ms = zero_ms
        self._last_ms = zero_ms or 0
        self.restarts = 0

    def t_ns(self, boot_ms: int) -> int:
        """The instant of a stamp in milliseconds since the vehicle's start."""
        if self._zero_ms is None:
            self._zero_ms = self._last_ms = boot_ms
        if boot_ms < self._last_ms - _REBOOT_MS:
            self._zero_ms -= self._last_ms - boot_ms
            self._last_ms = boot_ms
            self.restarts += 1
        self._last_ms = max(boot_ms, self._last_ms)
        return (boot_ms - self._zero_ms) * 1_000_000


class BatteryWatch:
    """Notices readings that are missing, or that no flight changes."""

    def __init__(self) -> None:
        self._remaining = math.nan
        self._since_ns: int | None = None  # in the air, with this reading
        self._unchanged_s = 0.0

    def read(self, t_ns: int, remaining: float, *, flying: bool) -> None:
        """Take a reading of the charge (0..1; NaN: none) at the vehicle's time `t_ns`."""
        if not flying:
            self._since_ns = None
        elif self._since_ns is None or remaining != self._remaining:
            self._since_ns, self._unchanged_s = t_ns, 0.0
        else:
            self._unchanged_s = (t_ns - self._since_ns) / 1e9
        self._remaining = remaining

    @property
    def doubt(self) -> str:
        """Why the readings say nothing, for people; empty where they do."""
        if math.isnan(self._remaining):
            return "the vehicle does not say how full its battery is"
        if self._unchanged_s >= FLOWN_S:
            return (
                f"the vehicle's battery has read {100 * self._remaining:.0f} % through "
                f"{self._unchanged_s:.0f} s of flight"
            )
        return ""
