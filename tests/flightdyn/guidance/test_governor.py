"""The clock of the reference: it slows for an aircraft that lags along the path by more than 1.5 m,
and stands from 6 m on, whichever way the path leads."""

import numpy as np
import pytest
from gains import DT_S, GAINS

from flightdyn.config import LimitsConfig
from flightdyn.guidance.path import FlightPath, plan_path
from flightdyn.native.library import FINISHED, LIMITED, STALLED, TRACK, Guide, Strapdown
from flightdyn.native.ticks import Inner
from flightdyn.state import Vector

# Along the path, and across it level and upright: at right angles, each of length 1.
ALONG, LEVEL = np.array([[0.48, 0.6, -0.64], [0.6, -0.48, 0.0] / np.hypot(0.6, 0.48)])
UPRIGHT = np.cross(LEVEL, ALONG)
START = np.array([5.0, -7.0, -40.0])


class Tracker:
    """Guidance that has flown the first seconds of a long straight path at 4 m/s."""

    def __init__(self) -> None:
        path = FlightPath(np.array([START, START + 500.0 * ALONG]), np.array([4.0]), np.zeros(2))
        trajectory, _ = plan_path(path, LimitsConfig())

        def ignored(_: float) -> None:
            pass

        axes = [ignored] * 3
        self._guide = Guide(GAINS, Inner(axes, axes, axes, ignored, dt_s=DT_S))
        self._guide.track(trajectory.pieces)
        self.end_s = trajectory.end_s
        self.memory = memory = self._guide.memory
        memory.mode, memory.armed, memory.path, memory.effectiveness = TRACK, True, True, 1.0
        memory.t, memory.rate, memory.smooth_rate, memory.room = 10.0, 1.0, 1.0, 1.0
        self._carried = Strapdown((9.81, 5e-5, -5e-5), most=1)
        self.step(np.zeros(3))

    def step(self, off: Vector, speed_mps: float = 4.0) -> None:
        """A step of an aircraft that is so far off the reference, at a speed along the path."""
        p, v = np.array(self.memory.p[:]) + off, speed_mps * ALONG
        if not self.memory.pointed:
            p = START
        self.memory.saturated, self.memory.room = 0, 1.0
        self._carried.place(tuple(p.tolist()), tuple(v.tolist()), (1.0, 0.0, 0.0, 0.0))
        self._guide.step(self._carried)


@pytest.mark.parametrize(
    ("behind_m", "aside_m", "rate"),
    [
        (0.0, 0.0, 1.0),
        (1.4, 0.0, 1.0),
        (2.4, 0.0, 0.8),
        (2.4, 1.0, 0.8),  # across it does not count
        (3.75, -2.0, 0.5),
        (5.55, 0.0, 0.1),
        (6.0, 0.0, 0.0),
        (9.0, 0.0, 0.0),
        (0.0, 8.0, 1.0),
        (-8.0, 0.0, 1.0),  # ahead of it
    ],
)
def test_the_reference_waits_for_who_lags_along_the_path(
    behind_m: float, aside_m: float, rate: float
) -> None:
    tracker = Tracker()
    memory = tracker.memory
    np.testing.assert_allclose(memory.along[:], 4.0 * ALONG, atol=1e-9)
    off, begun = aside_m * (LEVEL + UPRIGHT) - behind_m * ALONG, memory.t
    tracker.step(off)
    # It slows by 1 a second, and the time it has taken is that of its rate.
    first = max(rate, 1.0 - DT_S)
    assert memory.rate == pytest.approx(first, abs=1e-9)
    assert memory.t - begun == pytest.approx(first * DT_S, abs=1e-9)
    assert memory.smooth_rate == pytest.approx(1.0 - DT_S / 1.5 * (1.0 - rate), abs=1e-9)
    for _ in range(60):
        tracker.step(off)
    assert memory.rate == pytest.approx(rate, abs=1e-9)
    np.testing.assert_allclose(memory.v[:], 4.0 * rate * ALONG, atol=1e-8)
    # And comes back to its pace half as fast.
    tracker.step(np.zeros(3))
    assert memory.rate == pytest.approx(min(1.0, rate + 0.5 * DT_S), abs=1e-9)


def test_a_clock_that_stands_for_half_a_minute_is_waited_for_in_vain() -> None:
    tracker, steps = Tracker(), 0
    while not tracker.memory.stalled:
        tracker.step(-9.0 * ALONG, 0.0)
        steps += 1
        assert steps < 2000
    # It has moved on by half a second meanwhile, as it slows by 1 a second; the first step was
    # the tracker's own.
    assert (steps + 1) * DT_S == pytest.approx(30.0, abs=1.5 * DT_S)
    assert tracker.memory.noted & STALLED
    assert tracker.memory.noted & LIMITED
    slow = Tracker()
    for _ in range(2500):  # at a tenth of its pace: a second every ten
        slow.step(-5.55 * ALONG)
    assert not slow.memory.stalled


@pytest.mark.parametrize(
    ("off_m", "speed_mps", "after_s"),
    [(0.4, 0.2, 0.0), (0.6, 0.2, 10.0), (0.4, -0.4, 10.0)],
)
def test_a_path_is_over_where_it_stands_or_ten_seconds_later(
    off_m: float, speed_mps: float, after_s: float
) -> None:
    tracker = Tracker()
    tracker.memory.t = tracker.end_s - 2.5 * DT_S
    waited = -2  # until the reference is there
    while not tracker.memory.finished:
        tracker.step(off_m * UPRIGHT, speed_mps)
        waited += 1
        assert waited < 1000
    assert (waited - 1) * DT_S == pytest.approx(after_s, abs=1.5 * DT_S)
    assert tracker.memory.noted & FINISHED
    assert tracker.memory.missed == pytest.approx(off_m, abs=1e-3)
