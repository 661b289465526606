"""The vehicle's samples and events as log messages."""

import itertools
from collections.abc import Callable, Sequence
from operator import attrgetter

import numpy as np

from flightdyn.state import Innovation, Kinematics
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.log import control, messages, topics
from mission.log.topics import Topic
from mission.log.values import NS_PER_S, XYZ, EventRecord, ModeRecord
from sitl.observer import VehicleEvent, VehicleSample

_SEVERITY = {"failsafe": 4, "fault": 4}
NOTICE = 6  # MAV_SEVERITY

# The flown path is written whole, so that it is there wherever somebody looks; a long one more
# rarely, or the log would grow with the square of the flight.
_PATH_POINTS = 5  # a point a second
_PATH_SHARE = 20  # or the twentieth part of it

Write = Callable[[Topic, int, bytes], None]


# How often each kind of message is written, in simulated hertz; poses at every sample.
RATES_HZ = {
    "tf": 2.0,  # viewers interpolate, and the true pose says the same at every sample
    "velocity": 2.0,
    "location": 1.0,
    "battery": 1.0,
    "wind": 1.0,
    "innovations": 1.0,  # what the filter refused is written in any case
    "path_point": 1.0,
}


class Every:
    """Rate limiter in simulated time, on a fixed grid so that rates do not drift."""

    __slots__ = ("_next_ns", "_period_ns")

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(NS_PER_S / rate_hz)
        self._next_ns = 0

    def due(self, t_ns: int) -> bool:
        """Whether a period has begun since it was true the last time."""
        if t_ns < self._next_ns:
            return False
        self._next_ns = (t_ns // self._period_ns + 1) * self._period_ns
        return True


class VehicleTopics:
    """Writes what the vehicle tells, each kind of message at its rate."""

    def __init__(self, area: Area, write: Write) -> None:
        self._area = area
        self._frame = area.frame
        self._write = write
        self._mode: ModeRecord | None = None
        self._every = {name: Every(rate_hz) for name, rate_hz in RATES_HZ.items()}
        self._samples: list[VehicleSample] = []  # since they were written last
        self._control: list[Floats] = []
        self.begin_path()

    def event(self, event: VehicleEvent) -> None:
        """Write one event: a line for people, a record for programs."""
        severity = event.severity if event.kind == "status" else _SEVERITY.get(event.kind, NOTICE)
        line = messages.log_line(event.t_ns, event.text, severity=severity, source=event.kind)
        self._write(topics.LOG, event.t_ns, line)
        record = EventRecord(
            t_ns=event.t_ns,
            kind=event.kind,
            text=event.text,
            seq=event.seq,
            severity=severity,
            true_m=messages.area_xyz(self._area, event.truth.pos_ned_m),
            est_m=messages.area_xyz(self._area, event.belief.pos_ned_m),
        )
        self._write(topics.EVENTS, event.t_ns, messages.record(record))

    def begin_path(self) -> None:
        """Start a new flown path: that of a round, or of the way home after it."""
        self._path_m: list[XYZ] = []
        self._path_due = 1  # points at which it is written next

    def write_path(self, t_ns: int) -> None:
        """Write the whole path flown since `begin_path`."""
        if self._path_m:
            path = messages.path(messages.timestamp(t_ns), self._path_m)
            self._write(topics.FLOWN_PATH, t_ns, path)

    def sample(self, sample: VehicleSample) -> None:
        """Queue one sample for `write_samples`."""
        self._samples.append(sample)

    def write_samples(self) -> None:
        """Write the queued samples: many at once, as one by one costs twice as much."""
        samples, self._samples = self._samples, []
        for sample in samples:
            self._write_sample(sample)
            if sample.control is not None:
                self._control.append(sample.control)

    def write_all(self) -> None:
        """Write the queued samples, then their control rows in one batch."""
        self.write_samples()
        rows, self._control = self._control, []
        for t_ns, data in control.messages(self._area, np.concatenate(rows)) if rows else ():
            self._write(topics.CONTROL, t_ns, data)

    def _write_sample(self, sample: VehicleSample) -> None:
        """Write those messages of a sample that are due by their rates."""
        write, t_ns, truth, belief = self._write, sample.t_ns, sample.truth, sample.belief
        stamp, where = messages.timestamp(t_ns), messages.area_pose(self._area, truth)
        if self._every["tf"].due(t_ns):
            write(topics.TF, t_ns, messages.transform(stamp, where))
        write(topics.TRUE_POSE, t_ns, messages.pose(stamp, where))
        believed = messages.area_pose(self._area, belief)
        write(topics.EST_POSE, t_ns, messages.pose(stamp, believed))
        if self._every["velocity"].due(t_ns):
            write(topics.TRUE_VELOCITY, t_ns, messages.velocity(truth.vel_ned_mps))
            write(topics.EST_VELOCITY, t_ns, messages.velocity(belief.vel_ned_mps))
        if sample.gnss is not None:
            write(topics.GNSS, t_ns, messages.gnss(self._frame, sample.gnss))
        if self._every["location"].due(t_ns):
            on_globe = self._frame.to_geodetic(truth.pos_ned_m)
            write(topics.TRUE_LOCATION, t_ns, messages.location(stamp, on_globe))
        if self._every["battery"].due(t_ns):
            write(topics.BATTERY, t_ns, messages.battery(sample.battery))
        if sample.wind_ned_mps is not None and self._every["wind"].due(t_ns):
            write(topics.TRUE_WIND, t_ns, messages.velocity(sample.wind_ned_mps))
        if sample.innovations:
            self._innovations(t_ns, sample.innovations)
        mode = ModeRecord(sample.mode, sample.armed)
        if mode != self._mode:
            self._mode = mode
            write(topics.MODE, t_ns, messages.record(mode))
        if self._every["path_point"].due(t_ns):
            self._extend_path(t_ns, truth)

    def _extend_path(self, t_ns: int, truth: Kinematics) -> None:
        self._path_m.append(messages.area_xyz(self._area, truth.pos_ned_m))
        if len(self._path_m) >= self._path_due:
            self._path_due = len(self._path_m) + max(_PATH_POINTS, len(self._path_m) // _PATH_SHARE)
            self.write_path(t_ns)

    def _innovations(self, t_ns: int, items: Sequence[Innovation]) -> None:
        for instant, group in itertools.groupby(items, key=attrgetter("t_ns")):
            at_once = tuple(group)
            due = self._every["innovations"].due(instant)
            if due or not all(item.accepted for item in at_once):
                self._write(topics.INNOVATIONS, t_ns, messages.innovations(at_once))
