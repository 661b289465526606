"""The vehicle: aircraft and autopilot, step by step. It owns simulated time."""

import math
import time
from collections.abc import Sequence
from functools import partial

from flightdyn.aircraft import Aircraft
from flightdyn.faults import LinkOff
from flightdyn.obstacles import Obstacles
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint, GnssFix
from native.errors import InputError
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.codec.orders import OrderObserver, Place
from sitl.autopilot.codec.traffic import TRAFFIC, Transponder
from sitl.autopilot.parameters import Parameters, parameters_of
from sitl.config import VehicleConfig
from sitl.logfolder import LogFolder
from sitl.observer import EventKind, VehicleEvent, VehicleObserver, VehicleSample

_WATCH_HZ = 10.0  # how often the autopilot looks at its health, simulated time


class Vehicle:
    """An aircraft under its autopilot.

    `step` lets simulated time pass. `receive` and `outgoing` are MAVLink, in wall time;
    nothing that comes in moves simulated time.
    """

    waited_for = False

    def __init__(
        self,
        config: VehicleConfig,
        *,
        home: GeodeticPoint,
        streams: RandomStreams,
        obstacles: Obstacles | None = None,
        observers: Sequence[VehicleObserver] = (),
        aircraft: Aircraft | None = None,
        logs: LogFolder | None = None,
        orders: OrderObserver | None = None,
        standalone: bool = False,
        in_step: bool = False,
    ) -> None:
        """Build the configured aircraft, or take `aircraft` as it is.

        A `standalone` vehicle, part of no run, may be rebooted, and streams the telemetry that PX4
        streams. One that is `in_step` measures silence of pilots and ground stations in simulated,
        not in wall time. `logs` are served to ground stations; `orders` hears of uploaded lists
        and setpoints.

        Raises:
            InputError: a parameter or a rate is not acceptable, or a firmware is asked for;
                says which and why.
        """
        if config.autopilot != "built-in":
            raise InputError(
                f"vehicle.autopilot = {config.autopilot!r}: here the built-in autopilot flies; "
                "aerofed run and fly take a firmware, and aerofed world serves the aircraft to one"
            )
        self._config = config
        self._at_home = partial(
            Aircraft, config.aircraft, home=home, streams=streams, obstacles=obstacles
        )
        self._switched_on = partial(
            Autopilot,
            system=config.system_id,
            sink=self._happened,
            parameter_file=config.parameter_file,
            logs=logs,
            orders=orders,
            standalone=standalone,
            in_step=in_step,
        )
        self._observers = list(observers)
        self.near_m, self.traffic = config.near_m, config.traffic
        self._boot(aircraft or self._new_aircraft(), parameters_of(config))

    def _new_aircraft(self) -> Aircraft:
        config, aircraft = self._config, self._at_home()
        if control_hz := config.control_rate_hz:
            step_ns = aircraft.interval * aircraft.dt_ns
            every = _steps(control_hz, "control_rate_hz", step_ns, "guidance")
            aircraft.record(every=every, room=math.ceil(control_hz / config.sample_rate_hz) + 1)
        return aircraft

    def _boot(self, aircraft: Aircraft, parameters: Parameters) -> None:
        self.aircraft = aircraft
        booted_ns = time.time_ns() - aircraft.t_ns
        self.autopilot = self._switched_on(aircraft, parameters, booted_ns=booted_ns)
        self._tick = 0
        self._watch_every = _steps(_WATCH_HZ, "watch rate", aircraft.dt_ns, "physics")
        sample_hz = self._config.sample_rate_hz
        self._sample_every = _steps(sample_hz, "sample_rate_hz", aircraft.dt_ns, "physics")
        self._next_look = min(self._watch_every, self._sample_every)
        self._sampled_gnss: GnssFix | None = None
        self._sampled_innovation_ns = self.aircraft.t_ns

    @property
    def t_ns(self) -> int:
        """Simulated time."""
        return self.aircraft.t_ns

    @property
    def moving(self) -> bool:
        """Whether a manoeuvre is under way, for which simulated time should run."""
        return self.autopilot.flight.moving

    @property
    def denied(self) -> str:
        """Why it cannot be armed, for as long as its time stands still; empty where it can, or a
        manoeuvre is under way."""
        return "" if self.moving else self.autopilot.flight.not_ready()

    def add_observer(self, observer: VehicleObserver) -> None:
        """Send samples and events to `observer` from now on."""
        self._observers.append(observer)

    def step(self) -> bool:
        """Run up to the next guidance step, or a single tick where each of them matters; returns
        whether a manoeuvre is under way after it.
        """
        return self._advance(self.aircraft.to_guidance_step)

    def stride(self, until_ns: float = math.inf) -> bool:
        """As `step`, over all guidance steps up to the next check, sample or event; no tick
        begins at `until_ns` or later.
        """
        most = self._next_look - self._tick
        if not self.autopilot.flight.patient:
            most = min(most, self.aircraft.to_guidance_step)
        if until_ns < math.inf:
            most = min(most, math.ceil((until_ns - self.t_ns) / self.aircraft.dt_ns))
        return self._advance(most)

    def _advance(self, most: int) -> bool:
        tick = self._tick
        self._tick = tick = tick + self.aircraft.advance(min(most, self._next_look - tick))
        moving = self.autopilot.tick()
        if tick == self._next_look:
            if tick % self._watch_every == 0:
                self.autopilot.watch()
                moving = self.moving  # a failsafe may have begun another one
            if tick % self._sample_every == 0:
                self._sample()
            watch, sample = self._watch_every, self._sample_every
            self._next_look = tick + min(watch - tick % watch, sample - tick % sample)
        return moving

    def exchange_battery(self) -> None:
        """Put in a fresh battery, on the ground with the motors off.

        The autopilot sees it at once: on the ground time stands still, and its next look is due in
        simulated time.
        """
        self.aircraft.exchange_battery()
        self.autopilot.watch()

    def receive(self, datagram: bytes, now: float, at: Place = None) -> None:
        """Take a datagram of MAVLink at the wall time `now` (s); `at`: where its answers go."""
        if not self._cut_off:
            self.autopilot.receive(datagram, now, at)

    @property
    def _cut_off(self) -> bool:
        """Whether its links have failed."""
        return any(isinstance(fault, LinkOff) for fault in self.aircraft.faults.active)

    def greet(self) -> None:
        """Somebody has joined a link: send a heartbeat at once, not within a second."""
        self.autopilot.greet()

    def outgoing(self, now: float) -> list[tuple[Place, bytes]]:
        """MAVLink frames to send at the wall time `now`, each whole, and where: None is
        everywhere, else where what is answered came from.
        """
        frames = self.autopilot.poll(now)
        if self._cut_off:
            return []
        if self.autopilot.reboot_ordered:
            self._reboot()  # the answer to the order is among the frames
        return frames

    def _reboot(self) -> None:
        """Restart at home and at time zero; parameters and uploaded lists are kept."""
        old = self.autopilot
        self._boot(self._new_aircraft(), old.parameters)
        self.autopilot.transfer.restore(old.transfer.lists)
        self.autopilot.greet()

    def told(self, text: str, severity: int) -> None:
        """Say something to ground stations and observers."""
        self.autopilot.say(text, severity)

    def transponder(self, name: str) -> Transponder:
        """What it tells others of itself, by its own belief, under that name."""
        aircraft, belief = self.aircraft, self.aircraft.belief
        return Transponder(
            name, self._config.system_id, self.autopilot.time_us,
            aircraft.frame.to_geodetic(belief.pos_ned_m), -float(belief.pos_ned_m[2]),
            belief.vel_ned_mps, not aircraft.on_ground,
        )  # fmt: skip

    def overhear(self, said: Transponder) -> None:
        """Pass on to ground stations what another's transponder says, if that is asked for."""
        if self.traffic != "off":
            self.autopilot.pass_on(TRAFFIC[self.traffic](said))

    def due(self) -> float:
        """The wall time at which `outgoing` has something to say at the latest."""
        return self.autopilot.due()

    def _sample(self) -> None:
        aircraft = self.aircraft
        fix = aircraft.gnss
        fresh = fix if fix is not self._sampled_gnss else None
        self._sampled_gnss = fix
        innovations = aircraft.innovations_after(self._sampled_innovation_ns)
        if innovations:
            self._sampled_innovation_ns = innovations[-1].t_ns
        sample = VehicleSample(
            t_ns=aircraft.t_ns,
            truth=aircraft.truth,
            belief=aircraft.belief,
            gnss=fresh,
            battery=aircraft.battery,
            mode=self.autopilot.mode.name,
            armed=aircraft.armed,
            wind_ned_mps=aircraft.wind_ned_mps,
            innovations=innovations,
            control=None if aircraft.trace is None else aircraft.trace.take(),
        )
        for observer in self._observers:
            observer.sampled(sample)

    def _happened(self, kind: EventKind, text: str, seq: int | None, severity: int) -> None:
        aircraft = self.aircraft
        event = VehicleEvent(
            t_ns=aircraft.t_ns,
            kind=kind,
            text=text,
            truth=aircraft.truth,
            belief=aircraft.belief,
            seq=seq,
            severity=severity,
        )
        for observer in self._observers:
            observer.happened(event)


def _steps(rate_hz: float, name: str, step_ns: int, of: str) -> int:
    """Return the steps in a period of `rate_hz`; InputError if that is no whole number."""
    every = 1e9 / rate_hz / step_ns
    if abs(every - round(every)) > 1e-6 or every < 0.5:
        raise InputError(f"{name} = {rate_hz:g}: the {of} rate {1e9 / step_ns:g} is no multiple")
    return round(every)
