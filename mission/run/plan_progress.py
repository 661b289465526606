"""Progress of a plan file's flight, shown to people: item, height, battery, messages."""

import math
from collections.abc import Sequence

from mission.run.progress import Progress
from sitl.observer import VehicleEvent, VehicleSample

_NOTICE = 5  # MAV_SEVERITY; what is less severe is for logs
_EACH_NS = 1_000_000_000


class PlanProgress:
    """A vehicle observer that shows how far a plan is; `order`: its items in order of flight."""

    def __init__(self, progress: Progress, name: str, order: Sequence[int]) -> None:
        self._progress = progress
        self._name, self._order, self._passed = name, order, 0
        self._due_ns = 0
        self._now: VehicleSample | None = None
        self._item = "on the way to the first place"

    def sampled(self, sample: VehicleSample) -> None:
        """Show where the vehicle is, once a second of its time."""
        self._now = sample
        if sample.t_ns >= self._due_ns:
            self._due_ns = sample.t_ns + _EACH_NS
            self._progress.phase(f"flying {self._name}: {self._item}, {_state(sample)}")

    def happened(self, event: VehicleEvent) -> None:
        """Show that a place was reached, or what the vehicle says."""
        now = self._now
        if now is not None and event.t_ns < now.t_ns:
            return  # found out afterwards
        at = f"t {event.t_ns / 1e9:.1f} s"
        if event.seq in self._order[self._passed :]:  # a vehicle may leave out some
            before, self._passed = self._passed, self._order.index(event.seq, self._passed) + 1
            self._item = f"item {event.seq} ({self._passed} of {len(self._order)})"
            tenths = [10 * passed // len(self._order) for passed in (before, self._passed)]
            if now is not None and tenths[0] < tenths[1]:
                self._progress.notice(f"{at}: {self._item}, {_state(now)}")
        elif event.kind in ("status", "failsafe", "fault") and event.severity <= _NOTICE:
            self._progress.notice(f"{at}: {event.text}")


def _state(sample: VehicleSample) -> str:
    charge = 100 * sample.battery.remaining
    told = "unknown" if math.isnan(charge) else f"{charge:.0f} %"
    return f"{0.0 - round(sample.belief.pos_ned_m[2]):.0f} m high, battery {told}"
