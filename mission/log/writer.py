"""Records a run: vehicle samples and events, plans, rounds, uplinks and learning."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

import numpy as np

from fl.radio.per_grid import PerGrid
from mission.base import polyline
from mission.base.area import Area
from mission.log import messages, scene, topics
from mission.log.records import LATE, RoundRecord, UplinkRecord
from mission.log.sink import McapSink, Sink
from mission.log.topics import Topic
from mission.log.values import (
    NS_PER_S,
    Devices,
    FenceRecord,
    LearningRecord,
    MissionRecord,
    PlanRecord,
    SetpointRecord,
    Zone,
    area_to_text,
)
from mission.log.vehicle import NOTICE, VehicleTopics
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from sitl.observer import VehicleEvent, VehicleSample

_BLOCK_NS = NS_PER_S  # simulated time that is one chunk of the file
# Samples wait for each other so long, in simulated and in wall time: alone, each finds the caches
# of the processor without what writes it, which then takes twice as long.
_WAIT_NS = 9 * NS_PER_S
_WAIT_S = 1.0


class FlightLog:
    """The log of one run. A `VehicleObserver`; use it as a context manager.

    A killed run loses at most the last ten seconds of simulated time, and where that runs slowly
    the last second of both; leaving the context, also by an exception, completes the file. The
    same run gives the same bytes.
    """

    def __init__(
        self,
        path: Path,
        *,
        area: Area,
        devices: Devices,
        fence: Sequence[Zone] = (),
        mirrors: Sequence[Sink] = (),
        start_ns: int = 0,
    ) -> None:
        """Start the file at `path`, replacing one that is there; `mirrors` see the same messages.

        `start_ns`: when the log begins.

        Raises:
            InputError: the file cannot be made.
        """
        self._area = area
        self._devices = devices
        self._fence = tuple(fence)
        self._mcap = McapSink(path)
        self.file = self._mcap.file
        self._sinks: tuple[Sink, ...] = (self._mcap, *mirrors)
        self._watched = bool(mirrors)  # and nobody watches a second late
        self._vehicle = VehicleTopics(area, self._send)
        self._now_ns = self._flushed_ns = start_ns
        self._waiting: list[VehicleSample] = []
        self._since_s = 0.0  # wall time of the first of them
        self._believed: PerGrid | None = None  # of the radio, by the last plan
        self._planned = 0  # the round, or the mission, of the last plan
        self._mcap.metadata("aerofed", {"format": topics.FORMAT_VERSION, **area_to_text(area)})
        self._write_world(start_ns)
        if area.buildings:
            self._write(topics.SCENE_BUILDINGS, start_ns, scene.buildings(start_ns, area))
        self.attach(scene.LAYOUT, "application/json", scene.layout(area, devices.communities))

    def sampled(self, sample: VehicleSample) -> None:
        """Write one sample of the vehicle."""
        self._now_ns = sample.t_ns
        if not self._waiting:
            self._since_s = time.monotonic()
        self._waiting.append(sample)
        waited_ns = sample.t_ns - self._waiting[0].t_ns
        if self._watched or waited_ns >= _WAIT_NS or time.monotonic() - self._since_s >= _WAIT_S:
            self._catch_up()

    def _catch_up(self) -> None:
        """Write the samples that wait, and what is whole to the file."""
        waiting, self._waiting = self._waiting, []
        for sample in waiting:
            self._vehicle.sample(sample)
            if sample.t_ns - self._flushed_ns >= _BLOCK_NS:
                self._end_chunk(sample.t_ns)
        self._vehicle.write_samples()

    def happened(self, event: VehicleEvent) -> None:
        """Write one event: a line for people, a record for programs."""
        self._now_ns = event.t_ns
        self._catch_up()
        self._vehicle.event(event)

    def plan(
        self,
        t_ns: int,
        round_number: int,
        problem: RoundProblem,
        plan: RoundPlan,
        *,
        speed_mps: float,
        slot_s: Sequence[float] | None = None,
        duration_s: float | None = None,
    ) -> None:
        """Write a round's plan at the instant at which the round starts, or is planned anew.

        `slot_s` (N,) says when each step will be passed, in seconds after the start, and
        `duration_s` when the flight is over; by default those of an aircraft that is always at
        `speed_mps`, and ends at the last step.
        """
        if slot_s is None:
            slot_s = (polyline.along(plan.route_m)[plan.stops_at] / speed_mps).tolist()
        grid = problem.per_grid
        if grid is not None and grid is not self._believed and round_number != self._planned:
            self._believed = grid
            self._write(topics.RADIO_BELIEVED, t_ns, messages.success_grid(t_ns, grid))
        altitude_m = problem.channel.altitude_m
        self.plan_record(
            PlanRecord(
                round=round_number,
                t_ns=t_ns,
                waypoints_m=plan.waypoints_m,
                schedule=plan.schedule[0],
                importance=problem.importance,
                value=plan.value,
                upper_bound=plan.upper_bound,
                path_budget_m=problem.path_budget_m,
                speed_mps=speed_mps,
                altitude_m=altitude_m,
                height_m=np.full(len(plan.waypoints_m), altitude_m),
                slot_s=np.asarray(slot_s, dtype=np.float64),
                duration_s=slot_s[-1] if duration_s is None else duration_s,
                route_m=plan.route_m,
                stops_at=plan.stops_at,
            )
        )

    def radio_true(self, grid: PerGrid) -> None:
        """Write the true packet success by place, with which the believed one is compared."""
        self._write(topics.RADIO_TRUE, self._now_ns, messages.success_grid(self._now_ns, grid))

    def plan_record(self, written: PlanRecord) -> None:
        """Write a plan at the instant at which its flight starts, or switches to it."""
        t_ns = self._now_ns = written.t_ns
        self._write(topics.PLAN, t_ns, messages.record(written))
        stamp = messages.timestamp(t_ns)
        path = messages.path(stamp, written.route_3d_m.tolist())
        self._write(topics.PLAN_PATH, t_ns, path)
        on_map = scene.plan_map(self._area, self._devices, self._fence, written)
        self._write(topics.PLAN_MAP, t_ns, on_map)
        seen = scene.devices(t_ns, self._devices, written.importance)
        self._write(topics.SCENE_DEVICES, t_ns, seen)
        self._write_world(t_ns)
        if written.round != self._planned:
            self._vehicle.begin_path()
        self._planned = written.round
        self._flush()

    def uplinks(self, records: Sequence[UplinkRecord]) -> None:
        """Write a round's uplinks, each at the instant of its transmission."""
        for item in records:
            reached = np.isfinite(item.slot_t_s)
            t_ns = round(item.slot_t_s * NS_PER_S) if reached else self._now_ns
            self._write(topics.UPLINKS, t_ns, messages.record(item))
            if reached and item.outcome != LATE:
                self._write(topics.SCENE_LINKS, t_ns, scene.link(t_ns, item, self._devices))

    def round(self, record: RoundRecord) -> None:
        """Write a finished round, and hand the file to the disk."""
        t_ns = self._now_ns
        self._write(topics.ROUNDS, t_ns, messages.record(record))
        self._vehicle.write_path(t_ns)
        self._vehicle.begin_path()
        self._flush()
        self._mcap.sync()

    def learning(
        self,
        round_number: int,
        *,
        accuracy: Mapping[str, float],
        cov: Mapping[str, float],
        loss: Mapping[str, float],
    ) -> None:
        """Write what each community had learnt after a round; same keys in all three."""
        for community, value in accuracy.items():
            t_ns = self._now_ns
            learnt = LearningRecord(
                round_number, t_ns, community, value, cov[community], loss[community]
            )
            self._write(topics.LEARNING, t_ns, messages.record(learnt))

    def mission(self, record: MissionRecord) -> None:
        """Write a mission, fence or rally list that the vehicle accepted."""
        self._write(topics.MISSION, record.t_ns, messages.record(record))

    def setpoint(self, record: SetpointRecord) -> None:
        """Write a setpoint that the vehicle was sent."""
        self._write(topics.SETPOINT, record.t_ns, messages.record(record))

    def note(self, text: str, *, severity: int = NOTICE) -> None:
        """Write a line of our own, at the present simulated time."""
        line = messages.log_line(self._now_ns, text, severity=severity, source="mission")
        self._write(topics.LOG, self._now_ns, line)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Add a file to the log, as an attachment."""
        self._flush()
        self._mcap.attach(self._now_ns, name, media_type, data)
        self._mcap.flush()

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a named set of strings to the log; none may depend on the wall clock."""
        self._flush()
        self._mcap.metadata(name, values)
        self._mcap.flush()

    def close(self) -> None:
        """Complete the file. Closing twice is fine."""
        with ExitStack() as each:  # the last first
            for sink in reversed(self._sinks):
                each.callback(sink.close)
            each.callback(self._vehicle.write_all)
            each.callback(self._catch_up)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, topic: Topic, t_ns: int, data: bytes) -> None:
        """Write a message after the queued samples, which come before it."""
        self._catch_up()
        self._send(topic, t_ns, data)

    def _send(self, topic: Topic, t_ns: int, data: bytes) -> None:
        for sink in self._sinks:
            sink.write(topic, t_ns, data)

    def _flush(self) -> None:
        """Hand everything to the operating system."""
        self._catch_up()
        self._end_chunk(self._now_ns)

    def _end_chunk(self, t_ns: int) -> None:
        self._flushed_ns = t_ns
        self._vehicle.write_all()
        for sink in self._sinks:
            sink.flush()

    def _write_world(self, t_ns: int) -> None:
        """Write ground, devices and fence, at the start and again with every plan.

        So no damage loses them, and viewers that drop the very first messages have them.
        """
        self._write(topics.SCENE_GROUND, t_ns, scene.ground(t_ns, self._area, self._fence))
        self._write(topics.DEVICES, t_ns, messages.record(self._devices))
        if self._fence:
            keep_in, keep_out = (
                [zone.outline_m.tolist() for zone in self._fence if zone.keep_in is kept]
                for kept in (True, False)
            )
            self._write(topics.FENCE, t_ns, messages.record(FenceRecord(keep_in, keep_out)))
