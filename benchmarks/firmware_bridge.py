"""What our side of a firmware's bridge costs, against bare JSBSim and the kernel in the same run.

A stand-in process answers as the firmware would, at once, from what was made beforehand. Counted
is the processor time of the thread that steps the plant, system calls included. The parts take
turns, second by simulated second, on one processor, which the stand-in shares:

    physics     JSBSim's step alone, of the same aircraft, climbing alike, at the same rate
    exchange    one message of the same size each way, by the kernel's sockets
    both        physics and exchange in turns in the shortest loop: less a bridge cannot cost
    bridge      ours: clock, exchange, reading and writing of messages, plant, sensors

    python benchmarks/firmware_bridge.py [simulated seconds]
"""

import math
import multiprocessing
import os
import socket
import struct
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mav

from flightdyn.config import AircraftConfig
from flightdyn.plant import Plant
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from sitl.firmware.ardupilot import RATE_HZ, ArduPilotBridge
from sitl.firmware.bridge import LOOPBACK, Bridge
from sitl.firmware.clock import FirmwareClock
from sitl.firmware.px4 import Px4Bridge

HOME = GeodeticPoint(47.397742, 8.545594, 488.0)
CLIMB = 0.5  # duty cycle
WARM_UP_S = 3.0  # simulated, up to where the ground is not looked for
_SENSOR_FRAME = 76  # bytes; the last of a tick
_STATE = 340  # bytes of ArduPilot's


@dataclass(frozen=True)
class Protocol:
    """A firmware as the benchmark needs it: a tick's messages, by the number of the tick."""

    name: str
    rate_hz: int
    kind: socket.SocketKind
    bridge: Callable[[Plant], Bridge]
    from_firmware: Callable[[int], bytes]
    to_firmware: Callable[[int], bytes]
    tick_of: Callable[[bytes], int]  # of what the firmware is sent

    def connect(self, port: int) -> socket.socket:
        """As the firmware does."""
        sock = socket.socket(socket.AF_INET, self.kind)
        sock.connect((LOOPBACK, port))
        if self.kind is socket.SOCK_STREAM:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return sock

    def peer(self, port: int, ticks: int) -> None:
        """The stand-in's process: an answer to each tick."""
        answers = [self.from_firmware(tick) for tick in range(ticks)]
        sock, tick_of = self.connect(port), self.tick_of
        sock.send(answers[0])
        with suppress(ConnectionError):
            while data := sock.recv(4096):
                sock.send(answers[tick_of(data)])


def _controls(tick: int) -> bytes:
    """HIL_ACTUATOR_CONTROLS, motors a little different at every tick."""
    out = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    motors = [CLIMB + 1e-3 * (tick % 7)] * 16
    return bytes(mav.MAVLink_hil_actuator_controls_message(4000 * tick, motors, 129, 1).pack(out))


def _sensors(tick: int) -> bytes:
    return bytes(10) + struct.pack("<Q", 4000 * tick) + bytes(_SENSOR_FRAME - 18)


def _request(tick: int) -> bytes:
    pulses = [1000 + round(1000 * (CLIMB + 1e-3 * (tick % 7)))] * 4 + [0] * 12
    return struct.pack("<HHI16H", 18458, RATE_HZ, tick, *pulses)


def _state(tick: int) -> bytes:
    return f'\n{{"timestamp":{tick / RATE_HZ:.6f},'.encode().ljust(_STATE, b"0")


PX4 = Protocol(
    "PX4 (HIL, TCP)", 250, socket.SOCK_STREAM, lambda plant: Px4Bridge(plant, port=0),
    _controls, _sensors,
    lambda data: int.from_bytes(data[-66:-58], "little") // 4000,
)  # fmt: skip
ARDUPILOT = Protocol(
    "ArduPilot (JSON, UDP)", RATE_HZ, socket.SOCK_DGRAM,
    lambda plant: ArduPilotBridge(plant, port=0), _request, _state,
    lambda data: round(float(data[14 : data.index(b",")]) * RATE_HZ),
)  # fmt: skip


def plant(rate_hz: int) -> Plant:
    """The default aircraft on the ground."""
    return Plant(AircraftConfig(physics_hz=rate_hz), home=HOME, streams=RandomStreams(1))


class Part(ABC):
    """What is measured; `go` takes its processor and wall time."""

    def __init__(self) -> None:
        self.cpu_us: list[float] = []  # a tick, block by block
        self.wall_us: list[float] = []

    @abstractmethod
    def run(self, ticks: int) -> float:
        """Take so many ticks; the processor time (s) that they took."""

    def go(self, ticks: int, *, counted: bool = True) -> None:
        began = time.perf_counter()
        spent = self.run(ticks)
        if counted:
            self.cpu_us.append(1e6 * spent / ticks)
            self.wall_us.append(1e6 * (time.perf_counter() - began) / ticks)

    @abstractmethod
    def close(self) -> None:
        """Stop."""


class Loop(Part):
    """Physics, or the exchange with a stand-in, or both."""

    def __init__(self, protocol: Protocol, *, ticks: int, physics: bool, exchange: bool) -> None:
        super().__init__()
        self._next = 1
        self._messages = [protocol.to_firmware(tick) for tick in range(ticks)]
        self._sock = _met(protocol, ticks) if exchange else None
        self._step: Callable[[], object] = _nothing
        if physics:
            aircraft = plant(protocol.rate_hz)
            aircraft.vehicle.drive((CLIMB,) * 4)
            for _ in range(round(WARM_UP_S * protocol.rate_hz)):
                aircraft.step()
            self._step = aircraft.vehicle.run

    def run(self, ticks: int) -> float:
        sock, step = self._sock, self._step
        began = time.thread_time()
        if sock is None:
            for _ in range(ticks):
                step()
        else:
            recv, send = sock.recv, sock.send
            for message in self._messages[self._next : self._next + ticks]:
                step()
                send(message)
                recv(4096)
            self._next += ticks
        return time.thread_time() - began

    def close(self) -> None:
        if self._sock is not None:
            self._sock.close()


class Bridged(Part):
    """Ours: the clock that runs a bridge, in this thread instead of its own."""

    def __init__(self, protocol: Protocol, *, ticks: int) -> None:
        super().__init__()
        aircraft = plant(protocol.rate_hz)
        bridge = protocol.bridge(aircraft)
        bridge.open()
        self._ticks, self._until, self._run = aircraft.clock, 0, bridge.run
        bridge.run = self._run_in_turn  # type: ignore[method-assign]
        self._clock = FirmwareClock(bridge, speed=math.inf)
        _started(protocol, bridge.port, ticks)

    def _run_in_turn(self, ticks: int) -> int:
        done = self._run(min(ticks, self._until - self._ticks.tick))
        self._clock._stopped = self._ticks.tick == self._until
        return done

    def run(self, ticks: int) -> float:
        self._until = self._ticks.tick + ticks
        self._clock._stopped = False
        self._clock.run()
        began = time.thread_time()
        self._clock._run_until_stopped()
        return time.thread_time() - began

    def close(self) -> None:
        self._clock.stop()


def _nothing() -> None:
    return None


def _started(protocol: Protocol, port: int, ticks: int) -> None:
    multiprocessing.Process(target=protocol.peer, args=(port, ticks), daemon=True).start()


def _met(protocol: Protocol, ticks: int) -> socket.socket:
    """A socket that the stand-in has come to."""
    with socket.socket(socket.AF_INET, protocol.kind) as listener:
        listener.bind((LOOPBACK, 0))
        port = listener.getsockname()[1]
        if protocol.kind is socket.SOCK_STREAM:
            listener.listen(1)
            _started(protocol, port, ticks)
            sock, _peer = listener.accept()
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        else:
            _started(protocol, port, ticks)
            sock = listener.dup()
            sock.connect(sock.recvfrom(0, socket.MSG_PEEK)[1])
    sock.recv(4096)
    return sock


def measured(protocol: Protocol, seconds: int) -> Sequence[Part]:
    """Physics, exchange, both, bridge."""
    rate = protocol.rate_hz
    ticks = round(rate * (WARM_UP_S + seconds)) + 100  # and some while PX4 boots
    parts = (
        Loop(protocol, ticks=ticks, physics=True, exchange=False),
        Loop(protocol, ticks=ticks, physics=False, exchange=True),
        Loop(protocol, ticks=ticks, physics=True, exchange=True),
        Bridged(protocol, ticks=ticks),
    )
    parts[-1].go(round(WARM_UP_S * rate), counted=False)
    for _ in range(seconds):
        for part in parts:
            part.go(rate)
    for part in parts:
        part.close()
    return parts


def main() -> None:
    seconds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    processor = min(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {processor})
    load = os.getloadavg()[0]
    print(f"us a tick, processor time (wall time), best of {seconds} turns; load {load:.1f}")
    for protocol in (PX4, ARDUPILOT):
        parts = measured(protocol, seconds)
        cpu = [min(part.cpu_us) for part in parts]
        wall = [min(part.wall_us) for part in parts]
        names = ("physics", "exchange", "both", "bridge")
        said = (f"{n} {c:.2f} ({w:.2f})" for n, c, w in zip(names, cpu, wall, strict=True))
        physics, _, both, bridge = cpu
        print(
            f"{protocol.name}, {protocol.rate_hz} Hz: {', '.join(said)}\n"
            f"  bridge / physics {bridge / physics:.2f}x; without the physics in it "
            f"{bridge / physics - 1:.2f}x; least possible {both / physics:.2f}x; "
            f"bridge / least possible {bridge / both:.2f}x; "
            f"{1e6 / bridge / protocol.rate_hz:.0f} simulated s a processor second"
        )


if __name__ == "__main__":
    main()
