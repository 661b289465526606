"""Which faults are in force, and what they do to the aircraft's parts together."""

from collections.abc import Iterable

from flightdyn.clock import SimClock
from flightdyn.faults import Fault, GnssJump, GnssOff, ImuBias, MotorLoss, WindBurst
from flightdyn.frames import Triple
from flightdyn.native.ticks import Imu
from flightdyn.physics.multirotor import Multirotor
from flightdyn.physics.sensors import Gnss
from native.errors import FaultError


class FaultState:
    """Begins and ends faults. Overlapping ones add up; of a motor's, the least share counts."""

    def __init__(
        self,
        scheduled: Iterable[Fault],
        vehicle: Multirotor,
        clock: SimClock,
        *,
        receiver: Gnss | None,
        imu: Imu | None,
    ) -> None:
        """`receiver` and `imu` are None where the aircraft is handed the truth."""
        self._vehicle, self._clock = vehicle, clock
        self._receiver = receiver
        self._imu = imu
        self._waiting: list[tuple[int, Fault]] = []  # when each begins, ns; the first one last
        self._held = list(scheduled)  # until that happens which they come after
        for fault in self._held:
            self._check(fault)
        self.happened(None)
        self._active: list[tuple[Fault, int | None]] = []
        self._broken: set[int] = set()
        self.news: list[tuple[int, str]] = []  # when (ns) and what began or ended
        self.burst_ned_mps: Triple = (0.0, 0.0, 0.0)

    @property
    def active(self) -> tuple[Fault, ...]:
        """The faults in force."""
        return tuple(fault for fault, _ in self._active) if self._active else ()

    def happened(self, what: str | int | None) -> None:
        """Schedule the faults that come after `what`: "arming", "take-off" or the number of a
        mission item, when that has happened for the first time."""
        due = [fault for fault in self._held if fault.after == what]
        if due:
            self._held = [fault for fault in self._held if fault.after != what]
            now_ns = self._clock.t_ns if what is not None else 0
            self._waiting += [(now_ns + round(fault.at_s * 1e9), fault) for fault in due]
            self._waiting.sort(key=lambda each: -each[0])

    def begin(self, fault: Fault) -> None:
        """Put `fault` in force from now on, whatever its `at_s`."""
        self._check(fault)
        lasts_s = fault.duration_s
        end = None if lasts_s is None else self._clock.t_ns + round(lasts_s * 1e9)
        self._now([*self._active, (fault, end)])

    def end(self, fault: Fault) -> None:
        """End `fault`, however often it was begun; the others go on until their own ends."""
        self._now([(other, end) for other, end in self._active if other != fault])

    def update(self) -> None:
        """Begin what is scheduled and end what is over."""
        t_ns = self._clock.t_ns
        while self._waiting and self._waiting[-1][0] <= t_ns:
            self.begin(self._waiting.pop()[1])
        if self._active and any(end is not None and end <= t_ns for _, end in self._active):
            self._now([(f, end) for f, end in self._active if end is None or end > t_ns])

    def _now(self, active: list[tuple[Fault, int | None]]) -> None:
        """Put exactly these in force, and note which of them are new and which are no more."""
        before, self._active = self.active, active
        begun = [f"Fault begins: {f.kind}" for f in self.active if f not in before]
        ended = [f"Fault ends: {f.kind}" for f in before if f not in self.active]
        self.news += [(self._clock.t_ns, text) for text in begun + ended]
        self._apply()

    def _check(self, fault: Fault) -> None:
        if self._receiver is None and isinstance(fault, GnssOff | GnssJump | ImuBias):
            raise FaultError(
                f"fault {fault.kind!r} needs sensors.kind = 'realistic': there is no sensor to fail"
            )

    def _apply(self) -> None:
        active = self.active
        jump, burst, bias = [0.0] * 3, [0.0] * 3, [0.0] * 6
        shares: dict[int, float] = {}
        for fault in active:
            match fault:
                case GnssJump():
                    _add(jump, (fault.north_m, fault.east_m, fault.down_m))
                case WindBurst():
                    _add(burst, (fault.north_mps, fault.east_mps, fault.down_mps))
                case ImuBias():
                    _add(bias, (*fault.gyro_radps, *fault.accel_mps2))
                case MotorLoss():
                    shares[fault.motor] = min(shares.get(fault.motor, 1.0), fault.share)
        if self._receiver is not None:
            self._receiver.on = not any(isinstance(fault, GnssOff) for fault in active)
            self._receiver.jump_ned_m = (jump[0], jump[1], jump[2])
        if self._imu is not None:
            self._imu.fail(bias)
        self.burst_ned_mps = (burst[0], burst[1], burst[2])
        for motor in self._broken | set(shares):
            self._vehicle.set_motor_health(motor, shares.get(motor, 1.0))
        self._broken = set(shares)


def _add(total: list[float], values: tuple[float, ...]) -> None:
    for i, value in enumerate(values):
        total[i] += value
