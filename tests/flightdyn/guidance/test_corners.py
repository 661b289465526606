"""How sharply corners may be cut: against the blend itself, followed in small steps."""

import math

import numpy as np
import pytest

from flightdyn.guidance.corners import _SPILL, _allowed_cut


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
@pytest.mark.parametrize("sine", [0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99])
def test_a_corner_is_cut_as_far_as_it_stays_near_its_legs(
    sine: float, radius: float, share: float
) -> None:
    cut = _allowed_cut(sine, radius, share=share)
    assert _off_the_leg(cut, sine, radius) <= _SPILL * radius * (1.0 + 1e-4)
    if cut < share * radius:
        assert _off_the_leg(cut / 0.95, sine, radius) > _SPILL * radius * (1.0 - 1e-4)


def test_some_corners_are_cut_less_than_their_share() -> None:
    cuts = [_allowed_cut(sine, 5.0, share=1.0) for sine in np.linspace(0.05, 0.99, 40).tolist()]
    assert min(cuts) < 5.0
    assert max(cuts) == 5.0
