"""The C interface of the bridges (`bridge.h`), and the structures that both languages share.

The loop over ticks is in C. It releases Python's lock while it waits for the firmware, and takes it
to step the aircraft.
"""

import ctypes

import numpy as np
from numpy.typing import NDArray

from flightdyn.native.ticks import FLIGHT, PYTHON_AT, Driven, Imu, addresses
from flightdyn.plant import Plant
from native.building import library
from native.headers import Structure as Structure
from native.loading import address, interface

_BRIDGE = interface(library("bridge"))
KEPT = 4096  # guidance intervals, 80 s
TRUTHS, MOTORS = _BRIDGE.TRUTHS, _BRIDGE.MOTORS  # of a row: by `Multirotor.all`, and ordered
# What came of a call. ORDERED: the motors are what the firmware wants for the next tick; GONE: it
# has hung up; FREE_RUNNING: its clock is not ours; RESTARTED: it has begun anew.
NOTHING, ORDERED, GONE = _BRIDGE.NOTHING, _BRIDGE.ORDERED, _BRIDGE.GONE
FREE_RUNNING, RESTARTED = _BRIDGE.FREE_RUNNING, _BRIDGE.RESTARTED
# A TCP connection to PX4, a UDP socket to ArduPilot.
Hil, Json = _BRIDGE.Hil, _BRIDGE.Json
# Each takes the address of its structure; `hil_send` a payload of HIL_GPS, too, or None.
hil_wait, hil_send = _BRIDGE.hil_wait, _BRIDGE.hil_send
json_wait, json_send = _BRIDGE.json_wait, _BRIDGE.json_send
# With what steps the aircraft, and keeps Python's lock but while it waits.
_STEPPING = interface(library("bridge"), keeps_lock=True)


class TruthRing:
    """A ring buffer: a row of numbers for each guidance interval of a plant, the newest `KEPT`."""

    def __init__(self, plant: Plant) -> None:
        """Its first row is the present state of the plant."""
        self._count, interval_ns = KEPT, plant.interval * plant.dt_ns
        shape = (KEPT, TRUTHS + MOTORS)
        self._rows, self._instants = np.zeros(shape), np.zeros(KEPT, dtype=np.int64)
        first = plant.t_ns // interval_ns
        self._memory = _BRIDGE.Ring(
            rows=address(self._rows, np.float64, shape, written=True),
            instants=address(self._instants, np.int64, (KEPT,), written=True),
            count=KEPT,
            interval_ns=interval_ns,
            newest=first,
        )
        self.address = ctypes.addressof(self._memory)
        self._rows[first % KEPT, :TRUTHS] = plant.vehicle.all.read()
        self._instants[first % KEPT] = plant.t_ns

    @property
    def newest(self) -> int:
        """The number of the newest interval."""
        number: int = self._memory.newest
        return number

    def row_of(self, interval: int) -> tuple[int, NDArray[np.float64]]:
        """The instant (ns) and the numbers at the end of an interval."""
        slot = interval % self._count
        return int(self._instants[slot]), self._rows[slot].copy()


class Stepped:
    """Steps a plant from C, by the orders in a firmware's structure, and keeps true states."""

    def __init__(self, plant: Plant, imu: Imu, link: Structure) -> None:
        """Fill in `link` for C; the motors stand still until there is an order."""
        self._plant, self._link = plant, link
        vehicle, self.truths = plant.vehicle, TruthRing(plant)
        vehicle.drive((0.0,) * 4)
        self._driven = Driven(imu, vehicle.set_motors, plant.run)
        python = ctypes.pythonapi
        drive, read, let_go, take = addresses(
            FLIGHT.drive, FLIGHT.read_gauges, python.PyEval_SaveThread, python.PyEval_RestoreThread
        )
        link.world = _BRIDGE.World(
            drive=drive, read_gauges=read, let_go=let_go, take=take, driven=self._driven.at,
            interpreter=PYTHON_AT, gauges=vehicle.all.at, ring=self.truths.address,
            t_ns=plant.t_ns, dt_ns=plant.dt_ns,
        )  # fmt: skip
        self.at = ctypes.addressof(link)

    def hil_run(self, ticks: int) -> int:
        """Take ticks as PX4 asks for them, and answer all but the last; return how many."""
        return self._count(_STEPPING.hil_run(self._ready(ticks), ticks))

    def hil_tick(self) -> int:
        """Take a tick for a PX4 that boots and does not ask yet; return 1 if taken, else 0."""
        return self._count(_STEPPING.hil_tick(self._ready(1)))

    def json_run(self, ticks: int) -> int:
        """Take ticks as ArduPilot asks for them, and answer all but the last; return how many."""
        return self._count(_STEPPING.json_run(self._ready(ticks), ticks))

    def _ready(self, ticks: int) -> int:
        self._driven.ready(self._plant.run, ticks)
        return self.at

    def _count(self, ticks: int) -> int:
        if ticks:
            self._plant.advance_clock(ticks)
        return ticks
