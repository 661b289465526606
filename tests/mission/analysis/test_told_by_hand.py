"""What a vehicle was told and what it did, of signals made by hand.

Each error by its definition; stretches, steps and delays up to their bounds.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pymap3d
import pytest
from bare_flight import bare_flight
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from mission.analysis.told import (
    FlightErrors,
    delay,
    flown_against,
    heights,
    hidden_s,
    missing,
    modes_at,
    pair,
)
from mission.log.signals import Signal
from mission.log.values import HEIGHTS, LOCAL, FlightData, MissionRecord, Modes

T_S = np.arange(0.0, 60.5, 0.5)
ZERO = 0 * T_S
HOLD = Modes(np.zeros(1, dtype=np.int64), ("HOLD",))


def over(*axes: ArrayLike, t_s: np.ndarray = T_S) -> Signal:
    return Signal(t_s, np.column_stack([np.broadcast_to(axis, t_s.shape) for axis in axes]))


def flight(signals: Mapping[str, Signal], **more: Any) -> FlightData:
    return replace(bare_flight(T_S, np.zeros((len(T_S), 3))), signals=signals, **more)


def judged(
    data: FlightData,
    modes: Modes = HOLD,
    air_s: list[tuple[float, float]] = [(0.0, 60.0)],  # noqa: B006
    passes_s: list[tuple[float, float]] = [],  # noqa: B006
) -> FlightErrors:
    return flown_against(data, modes, air_s, passes_s, {})


def error(name: str, data: FlightData, modes: Modes = HOLD) -> np.ndarray:
    return judged(data, modes).series[name].values


def test_off_a_moving_setpoint_is_ahead_and_to_the_right() -> None:
    """It moves to 3 north and 4 east in a second: ahead is (0.6, 0.8), to the right (-0.8, 0.6)."""
    told = over(3 * T_S, 4 * T_S, -10.0)
    was = over(3 * T_S + 2 * 0.6 - 0.8, 4 * T_S + 2 * 0.8 + 0.6, -12.5)
    data = flight({"wanted_position_m": told, "position_m": was})
    assert error("tracking_m", data) == pytest.approx(math.sqrt(5.0))
    assert error("along_m", data) == pytest.approx(2.0)
    assert error("across_m", data) == pytest.approx(1.0)
    assert error("height_off_m", data) == pytest.approx(2.5)


@pytest.mark.parametrize(("pace_mps", "leads"), [(0.5, False), (0.5625, True)])
def test_a_setpoint_of_half_a_metre_a_second_leads_nowhere(pace_mps: float, leads: bool) -> None:
    told = over(pace_mps * T_S, 0.0, 0.0)
    data = flight({"wanted_position_m": told, "position_m": over(pace_mps * T_S + 1.0, 2.0, 0.0)})
    for name, value in (("along_m", 1.0), ("across_m", 2.0)):
        expected = value if leads else math.nan
        assert error(name, data) == pytest.approx(expected, nan_ok=True), name
    assert error("tracking_m", data) == pytest.approx(math.sqrt(5.0))


def test_speeds_and_rates_are_off_by_their_sizes() -> None:
    told, was = over(6.0, 8.0, 99.0), over(-3.0, 4.0, 0.0)
    assert error(
        "speed_off_mps", flight({"wanted_velocity_mps": told, "velocity_mps": was})
    ) == pytest.approx(-5.0)
    told, was = over(1.0, 2.0, 3.0), over(3.0, -1.0, 9.0)
    assert error(
        "rates_off_degps", flight({"wanted_rates_degps": told, "rates_degps": was})
    ) == pytest.approx(7.0)


def test_tilt_is_the_angle_between_both_downs_and_yaw_goes_the_short_way_round() -> None:
    rng = np.random.default_rng(2)
    told, was = (rng.uniform((-60, -60, -170), (60, 60, 170), (len(T_S), 3)) for _ in range(2))
    # Whole turns between samples would be unwrapped: yaws of what was go up steadily.
    was[:, 2] = np.linspace(-170.0, 170.0, len(T_S))
    signals = {"wanted_attitude_deg": Signal(T_S, told), "attitude_deg": Signal(T_S, was)}

    def angles(wanted: np.ndarray) -> np.ndarray:
        downs = [
            Rotation.from_euler("ZYX", each[:, ::-1], degrees=True).apply([0.0, 0.0, 1.0])
            for each in (wanted, was)
        ]
        return np.degrees(np.arccos((downs[0] * downs[1]).sum(axis=1)))

    data = flight(signals)
    assert error("tilt_off_deg", data) == pytest.approx(angles(told), abs=1e-6)
    turn = Rotation.from_euler("Z", (was - told)[:, 2:], degrees=True).as_euler("ZYX", degrees=True)
    assert error("yaw_off_deg", data) == pytest.approx(turn[:, 0], abs=1e-9)
    plane = judged(replace(data, vehicle="plane")).series
    assert "yaw_off_deg" not in plane  # no yaw is ordered
    own = np.column_stack((told[:, :2], was[:, 2]))
    assert plane["tilt_off_deg"].values == pytest.approx(angles(own), abs=1e-6)
    told_height = {"wanted_height_m": over(3.0), "height_m": over(4.0)}
    rover = judged(flight(signals | told_height, vehicle="rover")).series
    assert not {"tilt_off_deg", "yaw_off_deg", "height_off_m"} & set(rover)


def test_heights_are_those_of_the_best_source() -> None:
    place = {"wanted_position_m": over(0, 0, -20.0), "position_m": over(0, 0, -23.0)}
    assert heights(place) is not None
    known = [
        ({"wanted_height_m": over(7.0), "height_error_m": over(2.0), "height_m": over(5.0)}, 7, 5),
        ({"height_error_m": over(2.0), "height_m": over(5.5)}, 7.5, 5.5),
        ({"height_error_m": over(2.0)}, 20, 23),
    ]
    for signals, told_m, was_m in known:
        found = heights(place | signals)
        assert found is not None
        t_s, told, was = found
        assert (t_s == T_S).all()
        assert told == pytest.approx(told_m)
        assert was == pytest.approx(was_m)
    flat = {name: Signal(T_S, of.values[:, :2]) for name, of in place.items()}
    assert heights(flat) is None
    assert heights({}) is None


def test_in_modes_of_sticks_no_height_is_ordered() -> None:
    data = flight({"wanted_height_m": over(7.0), "height_m": over(5.0)})
    modes = Modes(10**9 * np.array([10, 20, 30]), ("ACRO", "HOLD", "STABILIZE"))
    off = error("height_off_m", data, modes)
    ordered = (T_S < 10.0) | ((T_S >= 20.0) & (T_S < 30.0))
    assert off[ordered] == pytest.approx(-2.0)
    assert np.isnan(off[~ordered]).all()
    assert modes_at(modes, np.array([9.9, 10.0, 29.9, 30.0])) == [
        "mode unknown", "ACRO", "HOLD", "STABILIZE"
    ]  # fmt: skip


def test_off_the_straight_way_to_a_goal_from_where_it_was_when_that_was_told() -> None:
    """East from 10 s on, with a jump of 4 m to the north; from 40 s on north, 2 m to the west, past
    its goal by 5 m; between it is told nothing that is known."""
    east_m = np.select([T_S < 10.0, T_S <= 30.0, T_S <= 40.0], [0.0, T_S - 10.0, 20.0], 18.0)
    north_m = np.select([T_S <= 10.0, T_S <= 40.0], [0.0, 4.0], T_S - 36.0)
    places = np.column_stack((east_m, north_m, ZERO + 10.0))
    home = bare_flight(T_S, places).area.home
    goals = [
        pymap3d.ned2geodetic(north, east, 0.0, home.lat_deg, home.lon_deg, home.alt_msl_m)[:2]
        for east, north in ((100.0, 0.0), (math.nan, 0.0), (20.0, 19.0))
    ]
    told_s = np.array([10.0, 29.5, 30.0, 39.5, 40.0, 60.0])
    goal = Signal(told_s, np.repeat(goals, 2, axis=0))
    data = replace(bare_flight(T_S, places), signals={"goal_deg": goal})
    off = error("target_m", data)
    expected = np.select(
        [T_S < 10.0, T_S == 10.0, T_S < 30.0, T_S < 40.0, T_S == 40.0, T_S <= 55.0],
        [math.nan, 0.0, 4.0, math.nan, 0.0, 2.0], np.hypot(2.0, T_S - 55.0),
    )  # fmt: skip
    assert off == pytest.approx(expected, abs=1e-3, nan_ok=True)
    assert judged(data).series["target_m"].hidden_s == 0.0


def test_an_error_is_known_where_what_was_is() -> None:
    """Of a signal of its own; not where only positions are."""
    few = T_S[(T_S < 20.0) | (T_S > 30.0)]
    data = flight({"wanted_velocity_mps": over(1.0, 1.0), "velocity_mps": over(1, 1, t_s=few)})
    assert judged(data).series["speed_off_mps"].hidden_s == pytest.approx(11.0)
    both = {"wanted_height_m": over(1.0), "height_error_m": over(1.0)}
    told = flight(both | {"height_m": over(2.0, t_s=few)})
    assert judged(told).series["height_off_m"].hidden_s == pytest.approx(11.0)


def test_what_is_not_known_for_how_long_in_the_air() -> None:
    every = np.arange(0.0, 100.0, 0.5)
    t_s = every[~(((every > 20) & (every < 24)) | ((every > 60) & (every < 70)))]
    for air_s, longest_s in (
        ([(0.0, 99.5)], 10.0),
        ([(0.0, 50.0)], 4.0),
        ([(0.0, 23.0)], 3.0),
        ([(21.0, 50.0)], 3.0),
        ([(0.0, 21.0), (23.5, 65.0)], 5.0),
        ([(25.0, 50.0)], 0.0),
        ([(0.0, 10.0), (90.0, 106.0)], 6.5),  # it ends before the flight does
    ):
        assert hidden_s(t_s, air_s) == pytest.approx(longest_s), air_s
    # Five usual intervals are none yet, nor is a second.
    for step_s, most_s in ((0.1, 1.0), (0.5, 2.5), (1.0, 5.0)):
        for gap_s, found_s in ((most_s, 0.0), (most_s + step_s, most_s + step_s)):
            first = step_s * np.arange(101)
            times = np.concatenate((first, first + first[-1] + gap_s))
            found = hidden_s(times, [(0.0, float(times[-1]))])
            assert found == pytest.approx(found_s), (step_s, gap_s)


def test_a_setpoint_without_what_was_is_none() -> None:
    assert pair({"wanted_position_m": over(1.0, 2.0)}, "position_m") is None
    assert pair({"position_m": over(1.0, 2.0)}, "position_m") is None
    both = {"wanted_position_m": over(1.0, 2.0, 3.0), "position_m": over(4.0, 5.0)}
    found = pair(both, "position_m")
    assert found is not None
    assert [of.shape for of in found] == [(121,), (121, 2), (121, 2)]
    for name, axes in (("height_m", 1), ("position_m", 2), ("attitude_deg", 3), ("rates_degps", 3)):
        for width in (axes - 1, axes):
            of = over(*range(width)) if width else Signal(T_S, np.zeros((len(T_S), 0)))
            found = pair({f"wanted_{name}": of, name: of}, name)
            assert (found is not None) == (width == axes), (name, width)
    # Between samples of a yaw that passes north, the short way.
    yaw = Signal(np.array([0.0, 1.0, 2.0]), np.array([[0, 0, 350], [np.nan] * 3, [0, 0, 10.0]]))
    told = Signal(np.array([1.0]), np.zeros((1, 3)))
    found = pair({"wanted_attitude_deg": told, "attitude_deg": yaw}, "attitude_deg")
    assert found is not None
    assert found[2][0] == pytest.approx([0.0, 0.0, 360.0])


def test_stretches_are_cut_by_modes_and_references() -> None:
    """Samples at each half second. What lasts for less than a second is part of the one before."""
    known = np.where((T_S >= 20.0) & (T_S < 30.0), 1.0, math.nan)
    velocity = np.where((T_S >= 25.0) & (T_S < 40.0), 1.0, math.nan)
    signals = {
        "wanted_position_m": over(known, known, known),
        "wanted_velocity_mps": over(velocity, velocity, velocity),
        "wanted_attitude_deg": over(0.0, 0.0, 0.0),
        "position_m": over(0.0, 0.0, 0.0),
    }
    modes = Modes(10**8 * np.array([0, 100, 110, 520, 535]), ("HOLD", *("ACRO", "LOITER") * 2))
    found = judged(flight(signals), modes, [(0.0, 55.0)], [(42.0, 50.0)])
    rows = [(s.number, s.start_s, s.end_s, s.mode, s.reference) for s in found.stretches]
    assert rows == [
        (1, 0.0, 10.5, "HOLD", "attitude"),
        (2, 10.5, 19.5, "LOITER", "attitude"),
        (3, 19.5, 29.5, "LOITER", "position"),
        (4, 29.5, 39.5, "LOITER", "velocity"),
        (5, 39.5, 41.5, "LOITER", "attitude"),
        (6, 41.5, 50.0, "LOITER", "mission"),
        (7, 50.0, 51.5, "LOITER", "attitude"),
        (8, 51.5, 53.0, "ACRO", "attitude"),
        (9, 53.0, 55.0, "LOITER", "attitude"),
    ]
    with_positions = ["tracking_m" in s.series for s in found.stretches]
    assert with_positions == [False, False, True, False, False, True, False, False, False]
    assert (found.start_s, found.end_s) == (0.0, 55.0)
    first = judged(flight({}), Modes(10**8 * np.array([0, 5]), ("ACRO", "HOLD"))).stretches
    assert [(s.start_s, s.end_s, s.mode, s.reference) for s in first] == [
        (0.0, 0.0, "ACRO", "nothing"), (0.0, 60.0, "HOLD", "nothing")
    ]  # fmt: skip


def wave(t_s: np.ndarray) -> np.ndarray:
    return np.sin(t_s) + np.sin(2.3 * t_s + 1.0)


FINE_S = np.arange(0.0, 60.0, 0.02)


@pytest.mark.parametrize("late_s", [0.0, 0.3, 0.31, 1.234, 2.9])
@pytest.mark.parametrize("name", ["position_m", "attitude_deg"])
def test_a_delay_is_found_between_two_samples_and_on_the_way(late_s: float, name: str) -> None:
    """Also while all moves on, which is as like to itself at any delay."""
    told = over(wave(FINE_S) + 9.0 * FINE_S, 0.0, 0.0, t_s=FINE_S)
    was_s = FINE_S - late_s
    was = over(2.0 + wave(was_s) + 9.0 * was_s, 0.0, 0.0, t_s=FINE_S)
    signals = {f"wanted_{name}": told, name: was}
    assert delay(signals, [(0.0, 60.0)]) == pytest.approx(late_s, abs=0.003)
    assert delay(signals, [(0.0, 8.0), (20.0, 60.0)]) == pytest.approx(late_s, abs=0.003)


def test_what_is_not_alike_has_no_delay() -> None:
    rng, told = np.random.default_rng(1), wave(FINE_S)
    unlike = rng.normal(size=len(FINE_S))
    for share, known in ((0.55, True), (0.45, False)):
        # The correlation of a sum with one of its parts.
        other = told.std() * math.sqrt(1.0 / share**2 - 1.0) * unlike
        signals = {
            "wanted_position_m": over(told, told, t_s=FINE_S),
            "position_m": over(told + other, told + other, t_s=FINE_S),
        }
        assert math.isnan(delay(signals, [(0.0, 60.0)])) != known
    still = over(0.0, 0.0, t_s=FINE_S)
    assert math.isnan(delay({"wanted_position_m": still, "position_m": still}, [(0.0, 60.0)]))
    moved = over(told, told, t_s=FINE_S)
    both = {"wanted_position_m": moved, "position_m": moved}
    assert math.isnan(delay(both, [(0.0, 5.9), (30.0, 36.0)]))  # two delays long each
    assert delay(both, [(0.0, 6.1)]) == 0.0
    assert math.isnan(delay({"position_m": moved}, [(0.0, 60.0)]))
    # Where positions tell nothing, the attitude does.
    later = {
        "wanted_attitude_deg": over(told, told, t_s=FINE_S),
        "attitude_deg": over(*[wave(FINE_S - 0.5)] * 2, t_s=FINE_S),
    }
    held = {"wanted_position_m": still, "position_m": still}
    assert delay(held | later, [(0.0, 60.0)]) == pytest.approx(0.5, abs=0.003)


def stepped(
    what: str, size: float, *, lasts_s: float = 30.0, answer: ArrayLike = (0, 0, 1, 1),
    at_s: ArrayLike = (0, 20, 24, 90), told_every_s: float = 0.25,
) -> list[tuple[float, ...]]:  # fmt: skip
    """When, how far, in which time and how much beyond, of a step at 20 s to the last axis."""
    t_s = np.arange(0.0, 60.0, told_every_s)
    told = np.where((t_s >= 20.0) & (t_s < 20.0 + lasts_s), size, 0.0)
    fine_s = np.arange(0.0, 60.0, 0.125)
    was = size * np.interp(fine_s, np.array(at_s, dtype=float), np.array(answer, dtype=float))
    name, axes = (
        ("attitude_deg", 2) if what == "yaw_deg" else (what, 0 if what == "height_m" else 2)
    )
    none = [0.0] * axes
    signals = {
        f"wanted_{name}": over(*none, told, t_s=t_s), name: over(*none, was, t_s=fine_s),
    }  # fmt: skip
    found = judged(flight(signals)).steps
    return [(s.t_s, s.size, s.rise_s, s.overshoot) for s in found if s.what == what and s.t_s < 21]


@pytest.mark.parametrize(
    ("what", "least"),
    [("position_m", 1.0), ("velocity_mps", 1.0), ("height_m", 1.0), ("yaw_deg", 20.0)],
)
def test_a_step_is_from_its_least_size_on_and_rises_from_10_to_90_percent(
    what: str, least: float
) -> None:
    assert stepped(what, 0.99 * least) == []
    for size in (least, 1.1 * least, -1.1 * least):
        (found,) = stepped(what, size)
        assert found == pytest.approx((20.0, abs(size), 3.2, 0.0))
    (beyond,) = stepped(what, 3 * least, answer=(0, 0, 1.25, 1), at_s=(0, 20, 25, 30))
    assert beyond == pytest.approx((20.0, 3 * least, 3.2, 0.25))


def test_a_step_is_sudden_is_held_and_is_answered_before_the_next_one() -> None:
    assert stepped("position_m", 4.0, told_every_s=0.5)
    assert not stepped("position_m", 4.0, told_every_s=0.625)
    # The last sample before the next one is a quarter of a second earlier.
    assert not stepped("position_m", 4.0, lasts_s=2.0)
    (unanswered,) = stepped("position_m", 4.0, lasts_s=2.25)
    assert unanswered == pytest.approx((20.0, 4.0, math.nan, math.nan), nan_ok=True)
    (in_time,) = stepped("position_m", 4.0, at_s=(0, 20, 41.5, 90))  # 90 % at 39.35 s
    assert in_time[2] == pytest.approx(0.8 * 21.5)
    (late,) = stepped("position_m", 4.0, at_s=(0, 20, 43.0, 90))  # at 40.7 s
    assert math.isnan(late[2])
    # What moves on by a tenth is the same step, by more another.
    t_s, fine_s = np.arange(0.0, 60.0, 0.25), np.arange(0.0, 60.0, 0.125)
    for more, ends in ((0.39, False), (0.41, True)):
        told = np.select([t_s < 20.0, t_s < 23.0], [0.0, 4.0], 4.0 + more)
        was = 4.0 * np.interp(fine_s, (20.0, 24.0), (0.0, 1.0))
        signals = {
            "wanted_height_m": over(told, t_s=t_s), "height_m": over(was, t_s=fine_s),
        }  # fmt: skip
        (step,) = judged(flight(signals)).steps
        assert math.isnan(step.rise_s) == ends


def test_what_a_log_does_not_hold_is_named() -> None:
    nothing = [
        "a mission", "position setpoints", "velocity setpoints", "wanted heights",
        "wanted attitude", "wanted body rates", "vibration", "clipping", "innovation ratios",
        "satellites", "accuracy of GNSS", "motors", "battery",
    ]  # fmt: skip
    assert missing(flight({})) == nothing
    held = {
        "wanted_position_m": ("position setpoints", "wanted heights"),
        "wanted_velocity_mps": ("velocity setpoints",), "wanted_height_m": ("wanted heights",),
        "height_error_m": ("wanted heights",), "wanted_attitude_deg": ("wanted attitude",),
        "wanted_rates_degps": ("wanted body rates",), "vibration_mps2": ("vibration",),
        "clips": ("clipping",), "innovation_ratio": ("innovation ratios",),
        "satellites": ("satellites",), "gnss_accuracy_m": ("accuracy of GNSS",),
        "hdop": ("accuracy of GNSS",), "motors": ("motors",), "voltage_v": ("battery",),
    }  # fmt: skip
    for name, of in held.items():
        assert missing(flight({name: over(0.0)})) == [each for each in nothing if each not in of]
    data = flight({})
    for only, lacks in ((HEIGHTS, "positions"), (LOCAL, "places on the globe")):
        found = missing(replace(data, source=replace(data.source, only=only)))
        assert found == [nothing[0], lacks, *nothing[1:]]
    empty, listed = (MissionRecord(0, "mission", items) for items in ((), ((1.0,),)))
    assert missing(replace(data, missions=(empty,))) == nothing
    assert missing(replace(data, missions=(empty, listed))) == nothing[1:]
