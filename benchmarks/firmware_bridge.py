"""What our side of a firmware's bridge costs, against bare JSBSim in the same run.

A stand-in process answers as the firmware would, at once: what is counted is the processor time
of the thread that steps the plant, system calls included. Sensors are the default ones. Hovering
duty cycles keep the rotors turning.

    python benchmarks/firmware_bridge.py [simulated seconds]
"""

import multiprocessing
import socket
import struct
import sys
import time

from fastcrc import crc16
from pymavlink.dialects.v20 import common as mav

from flightdyn.config import AircraftConfig
from flightdyn.plant import Plant
from flightdyn.random import RandomStreams
from flightdyn.state import GeodeticPoint
from sitl.firmware.ardupilot import RATE_HZ, ArduPilotBridge
from sitl.firmware.bridge import Bridge, read, sensors_of
from sitl.firmware.px4 import Px4Bridge

HOME = GeodeticPoint(47.397742, 8.545594, 488.0)
HOVER = 0.38  # duty cycle; it climbs slowly
_SENSOR_FRAME = 76  # bytes; the last of a tick
_EXTRA = mav.MAVLink_hil_actuator_controls_message.crc_extra


def plant(rate_hz: int) -> Plant:
    """The default aircraft on the ground."""
    return Plant(AircraftConfig(physics_hz=rate_hz), home=HOME, streams=RandomStreams(1))


def px4(port: int) -> None:
    """Answer each HIL_SENSOR with controls of its instant."""
    sock = socket.create_connection(("127.0.0.1", port))
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    out = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    frame = bytearray(mav.MAVLink_hil_actuator_controls_message(0, [HOVER] * 16, 129, 1).pack(out))
    while data := sock.recv(4096):
        frame[10:18] = data[-_SENSOR_FRAME + 10 : -_SENSOR_FRAME + 18]
        frame[-2:] = crc16.mcrf4xx(bytes(frame[1:-2]) + bytes((_EXTRA,))).to_bytes(2, "little")
        sock.sendall(frame)


def ardupilot(port: int) -> None:
    """Ask, wait for the answer, and ask for the next tick."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.connect(("127.0.0.1", port))
    pulses = [1000 + round(1000 * HOVER)] * 4 + [0] * 12
    count = 0
    while True:
        sock.send(struct.pack("<HHI16H", 18458, RATE_HZ, count, *pulses))
        try:
            sock.recv(4096)
        except ConnectionError:
            return
        count += 1


def bridged_s(bridge: Bridge, peer: object, seconds: float) -> float:
    """Processor seconds of this thread for a simulated second of the bridge."""
    bridge.open()
    process = multiprocessing.Process(target=peer, args=(bridge.port,), daemon=True)  # type: ignore[attr-defined,arg-type]
    process.start()
    clock = bridge.plant.clock
    while clock.t_ns < 0.5e9:
        bridge.tick()
    began, from_s = time.thread_time(), clock.t_ns / 1e9
    while clock.t_ns / 1e9 < from_s + seconds:
        bridge.tick()
    spent = time.thread_time() - began
    process.kill()
    bridge.close()
    return spent / seconds


def bare_s(rate_hz: int, seconds: float) -> float:
    """The same of JSBSim's step alone."""
    vehicle = plant(rate_hz).vehicle
    vehicle.drive((HOVER,) * 4)
    run = vehicle.run
    for _ in range(rate_hz // 2):
        run()
    began = time.thread_time()
    for _ in range(round(rate_hz * seconds)):
        run()
    return (time.thread_time() - began) / seconds


def sensed_s(rate_hz: int, seconds: float) -> float:
    """The same of the plant with its sensors, nothing sent."""
    aircraft = plant(rate_hz)
    sensors = sensors_of(aircraft)
    aircraft.vehicle.drive((HOVER,) * 4)
    began = time.thread_time()
    for _ in range(round(rate_hz * seconds)):
        aircraft.step()
        read(aircraft, sensors)
    return (time.thread_time() - began) / seconds


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    print(f"{seconds:g} simulated s each; ms of processor time a simulated second, best of 3")
    cases = (
        ("PX4", 250, px4, lambda: Px4Bridge(plant(250), port=0)),
        (
            f"ArduPilot, {RATE_HZ} Hz",
            RATE_HZ,
            ardupilot,
            lambda: ArduPilotBridge(plant(RATE_HZ), port=0),
        ),
    )
    for name, rate, peer, bridge in cases:
        rows = [
            (
                bare_s(rate, seconds),
                sensed_s(rate, seconds),
                bridged_s(bridge(), peer, seconds),
            )
            for _ in range(3)
        ]
        bare, sensed, bridged = (1e3 * min(column) for column in zip(*rows, strict=True))
        print(
            f"{name}, {rate} Hz: bare JSBSim {bare:.2f}, with plant and sensors {sensed:.2f} "
            f"({sensed / bare:.2f}x), bridge {bridged:.2f} ({bridged / bare:.2f}x), "
            f"{1e3 / bridged:.0f} simulated s a processor second"
        )


if __name__ == "__main__":
    main()
