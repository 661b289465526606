"""The vehicle's samples and events as log messages."""

import itertools
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter

import numpy as np

from flightdyn.state import Innovation
from mission.base.area import Area
from mission.log import messages, topics
from mission.log.flown_path import FlownPath
from mission.log.rates import Every, LogRates
from mission.log.topics import Topic
from sitl.observer import VehicleEvent, VehicleSample

_SEVERITY = {"failsafe": 4, "fault": 4}
NOTICE = 6  # MAV_SEVERITY

_INSTANT = attrgetter("t_ns")
_ACCEPTED = attrgetter("accepted")

Write = Callable[[Topic, int, bytes], None]


class VehicleTopics:
    """Takes samples as they come and writes them some at a time.

    Between two samples a run touches so much else that the second would find code and tables
    gone from the processor's caches: ten written together cost half of ten written one by one.
    """

    def __init__(self, area: Area, rates: LogRates, write: Write) -> None:
        self._area = area
        self._frame = area.frame
        self._write = write
        self._taken: list[VehicleSample] = []
        self._events: deque[tuple[int, VehicleEvent]] = deque()  # and the samples before each
        self._flown = FlownPath()
        self._mode: tuple[str, bool] | None = None
        self._tf_due = Every.of(rates.tf_hz)
        self._velocity_due = Every.of(rates.velocity_hz)
        self._command_due = Every.of(rates.command_hz)
        self._location_due = Every.of(rates.location_hz)
        self._battery_due = Every.of(rates.battery_hz)
        self._wind_due = Every.of(rates.wind_hz)
        self._innovations_due = Every.of(rates.innovations_hz)

    def take(self, sample: VehicleSample) -> None:
        """Keep a sample for the next `write_taken`."""
        self._taken.append(sample)

    def take_event(self, event: VehicleEvent) -> None:
        """Keep an event for the next `write_taken`."""
        self._events.append((len(self._taken), event))

    def write_taken(self) -> None:
        """Write what was taken, in order."""
        taken, self._taken = self._taken, []
        if taken:
            self._write_samples(taken)
        self._write_events(len(taken))

    def _write_samples(self, taken: Sequence[VehicleSample]) -> None:
        count = len(taken)
        t_ns = np.array([sample.t_ns for sample in taken] * 2)
        states = [sample.truth for sample in taken] + [sample.belief for sample in taken]
        places = messages.places(self._area, states)
        poses = messages.POSE.fill(t_ns, places)
        transforms = messages.TRANSFORM.fill(t_ns[:count], places[:count])
        fixes = [sample.gnss for sample in taken if sample.gnss is not None]
        gnss = iter(messages.gnss(self._frame, fixes) if fixes else ())
        for i, sample in enumerate(taken):
            self._write_events(i)
            self._write_poses(sample.t_ns, transforms[i], poses[i], poses[count + i])
            self._write_sample(sample, gnss)

    def _write_events(self, samples: int) -> None:
        """Write those that came before there were more than so many samples."""
        while self._events and self._events[0][0] <= samples:
            self._write_event(self._events.popleft()[1])

    def _write_event(self, event: VehicleEvent) -> None:
        """Write one event: a line for people, a record for programs."""
        severity = event.severity if event.kind == "status" else _SEVERITY.get(event.kind, NOTICE)
        line = messages.log_line(event.t_ns, event.text, severity=severity, source=event.kind)
        self._write(topics.LOG, event.t_ns, line)
        values = {
            "kind": event.kind,
            "text": event.text,
            "seq": event.seq,
            "severity": severity,
            "true_m": messages.area_xyz(self._area, event.truth.pos_ned_m),
            "est_m": messages.area_xyz(self._area, event.belief.pos_ned_m),
        }
        self._write(topics.EVENTS, event.t_ns, messages.record(values))

    def write_flown_path(self, t_ns: int) -> None:
        """Write the path flown since `begin_path`, as far as it is known."""
        path = self._flown.message(t_ns)
        if path is not None:
            self._write(topics.FLOWN_PATH, t_ns, path)

    def begin_path(self) -> None:
        """A path begins: a round's, or the way home after it."""
        self._flown.forget()

    def _write_poses(self, t_ns: int, transform: bytes, true_pose: bytes, est_pose: bytes) -> None:
        if self._tf_due.now(t_ns):
            self._write(topics.TF, t_ns, transform)
        self._write(topics.TRUE_POSE, t_ns, true_pose)
        self._write(topics.EST_POSE, t_ns, est_pose)

    def _write_sample(self, sample: VehicleSample, gnss: Iterator[bytes]) -> None:
        write = self._write
        t_ns, truth, belief = sample.t_ns, sample.truth, sample.belief
        if self._velocity_due.now(t_ns):
            write(topics.TRUE_VELOCITY, t_ns, messages.velocity(truth.vel_ned_mps))
            write(topics.EST_VELOCITY, t_ns, messages.velocity(belief.vel_ned_mps))
        if sample.cmd_pos_ned_m is not None and self._command_due.now(t_ns):
            command_m = messages.area_xyz(self._area, sample.cmd_pos_ned_m)
            write(topics.COMMAND, t_ns, messages.point(messages.timestamp(t_ns), command_m))
        if sample.gnss is not None:
            write(topics.GNSS, t_ns, next(gnss))
        if self._location_due.now(t_ns):
            where = self._frame.to_geodetic(truth.pos_ned_m)
            write(topics.TRUE_LOCATION, t_ns, messages.location(messages.timestamp(t_ns), where))
        if self._battery_due.now(t_ns):
            write(topics.BATTERY, t_ns, messages.battery(sample.battery))
        if sample.wind_ned_mps is not None and self._wind_due.now(t_ns):
            write(topics.TRUE_WIND, t_ns, messages.velocity(sample.wind_ned_mps))
        if sample.innovations:
            self._write_innovations(t_ns, sample.innovations)
        self._note_mode(t_ns, sample.mode, sample.armed)
        if self._flown.extend(t_ns, self._area, truth):
            self.write_flown_path(t_ns)

    def _write_innovations(self, t_ns: int, items: Sequence[Innovation]) -> None:
        for instant, group in itertools.groupby(items, key=_INSTANT):
            at_once = tuple(group)
            due = self._innovations_due.now(instant)
            if due or not all(map(_ACCEPTED, at_once)):
                self._write(topics.INNOVATIONS, t_ns, messages.innovations(at_once))

    def _note_mode(self, t_ns: int, mode: str, armed: bool) -> None:
        if (mode, armed) != self._mode:
            self._mode = (mode, armed)
            self._write(topics.MODE, t_ns, messages.record({"mode": mode, "armed": armed}))
