"""How sharply corners may be cut: against the blend itself, followed in small steps."""

import math

import numpy as np
import pytest

from flightdyn.config import LimitsConfig
from flightdyn.guidance.path import FlightPath, plan_path

SPILL = 0.2  # of the acceptance radius: how far off the legs a blend may be outside of it


def cut_of(sine: float, radius: float, share: float) -> float:
    """By how much a corner between long legs is missed, in metres."""
    limits = LimitsConfig(acceleration_mps2=0.5, speed_mps=30.0, corner_cut=share, smoothing_s=0.0)
    turn = 2.0 * math.asin(sine)
    legs = 3e3 * np.array([[1.0, 0.0, 0.0], [math.cos(turn), math.sin(turn), 0.0]])
    points = np.vstack((np.zeros(3), np.cumsum(legs, axis=0)))
    trajectory, corners = plan_path(
        FlightPath(points, np.full(2, 30.0), np.full(3, radius)), limits
    )
    return math.dist(trajectory.at(corners[1].t).p, corners[1].p)


def _off_the_leg(cut: float, sine: float, radius: float) -> float:
    """How far off the leg a blend is where it enters the circle about its corner."""
    cosine = math.sqrt(1.0 - sine * sine)
    v = math.sqrt(2 * cut) / sine
    t = np.linspace(0.0, v * sine, 200_001)
    off = cosine * t * t / 2
    inside = np.hypot(v * v * sine - v * t + sine * t * t / 2, off) <= radius
    return float(off[inside.argmax()]) if inside.any() else 0.0


@pytest.mark.parametrize("radius", [0.5, 5.0, 30.0])
@pytest.mark.parametrize("share", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("sine", [0.2, 0.3, 0.5, 0.7, 0.9, 0.99])
def test_a_corner_is_cut_as_far_as_it_stays_near_its_legs(
    sine: float, radius: float, share: float
) -> None:
    cut = cut_of(sine, radius, share)
    assert _off_the_leg(cut, sine, radius) <= SPILL * radius * (1.0 + 1e-4)
    if cut < share * radius * (1.0 - 1e-4):
        assert _off_the_leg(cut / 0.95, sine, radius) > SPILL * radius * (1.0 - 1e-4)


def test_some_corners_are_cut_less_than_their_share() -> None:
    cuts = [cut_of(sine, 5.0, 1.0) for sine in np.linspace(0.1, 0.99, 40).tolist()]
    assert min(cuts) < 4.9
    assert max(cuts) == pytest.approx(5.0, abs=1e-4)
