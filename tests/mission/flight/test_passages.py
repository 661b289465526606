"""When a vehicle of which only telemetry tells has passed its stops."""

import numpy as np
import pytest

from mission.flight.passages import passages
from mission.flight.track import Flight, Passage

S = 1_000_000_000


def flight(points: list[tuple[float, float]], *, every_s: float = 1.0) -> Flight:
    ned = np.array([(x, y, -60.0) for x, y in points])
    t_ns = (np.arange(len(points)) * every_s * S).astype(np.int64)
    return Flight(t_ns, ned, ned, 1.0)


def stops(*points: tuple[float, float]) -> np.ndarray:
    return np.array([(x, y, -60.0) for x, y in points])


def seconds(found: tuple[Passage, ...]) -> list[float]:
    return [round(passage.t_ns / S, 6) for passage in found]


def test_closest_approach_lies_between_the_samples() -> None:
    # 10 m/s to the north, sampled once a second; the second stop lies 3 m beside the track.
    found = passages(
        flight([(10.0 * n, 0.0) for n in range(11)]),
        stops((0, 0), (44, 3), (100, 0)),
        reported_ns=[0, 4 * S, 10 * S], hovers=[False] * 3,
    )  # fmt: skip
    assert seconds(found) == [0.0, 4.4, 10.0]
    assert found[1].true_ned_m == pytest.approx([44, 0, -60])


def test_a_track_that_comes_back_is_taken_in_order() -> None:
    # Two metres aside on the way out, right over the stop on the way back.
    there = [(10.0 * n, 2.0) for n in range(6)]
    back = [(10.0 * n, 0.0) for n in range(4, -1, -1)]
    found = passages(
        flight([*there, *back]),
        stops((0, 2), (21, 0), (50, 2), (21, 0), (0, 0)),
        reported_ns=[0, 2 * S, 5 * S, 8 * S, 10 * S], hovers=[False] * 5,
    )  # fmt: skip
    assert seconds(found) == [0.0, 2.1, 5.0, 7.9, 10.0]


def test_a_lost_report_does_not_lose_the_stop() -> None:
    found = passages(
        flight([(10.0 * n, 0.0) for n in range(11)]),
        stops((0, 0), (30, 0), (60, 0), (100, 0)),
        reported_ns=[0, None, 6 * S, None], hovers=[False] * 4,
    )  # fmt: skip
    assert seconds(found) == [0.0, 3.0, 6.0, 10.0]


def test_a_hover_is_reached_when_it_begins() -> None:
    arriving = [(10.0 * n, 0.0) for n in range(4)]
    hovering = [(30.0 + 0.2 * np.sin(n), 0.1 * np.cos(n)) for n in range(8)]
    found = passages(
        flight([*arriving, *hovering]),
        stops((0, 0), (30, 0)),
        reported_ns=[0, 11 * S], hovers=[False, True],
    )  # fmt: skip
    assert 2.8 < found[1].t_ns / S < 4.0
