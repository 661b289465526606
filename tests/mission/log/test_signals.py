"""Quantities of logs over time, by hand."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from mission.log.signals import (
    AXES,
    Signal,
    Source,
    euler_deg,
    gathered,
    motors,
    while_controlled,
)

NAN = math.nan


def column(*values: float) -> np.ndarray:
    return np.array(values)


def test_what_lies_ten_minutes_beside_a_flight_is_damage() -> None:
    t_s = column(-601.0, -599.0, 5.0, 609.0, 611.0)
    kept = Signal(t_s, t_s[:, None]).between(np.array([0, 10_000_000_000]))
    assert kept.t_s.tolist() == kept.values[:, 0].tolist() == [-599.0, 5.0, 609.0]


def test_between_samples_it_is_linear_and_in_holes_unknown() -> None:
    t_s = np.append(np.arange(11.0), np.arange(16.0, 22.0))
    found = Signal(t_s, 2.0 * t_s[:, None]).at(column(-0.1, 0.25, 10.0, 13.0, 17.5, 21.0, 21.1))
    np.testing.assert_equal(found[:, 0], [NAN, 0.5, 20.0, NAN, 35.0, 42.0, NAN])
    # Five usual intervals are none.
    t_s = np.append(np.arange(11.0), np.arange(15.0, 20.0))
    assert Signal(t_s, t_s[:, None]).at(column(13.0)).tolist() == [[13.0]]


def test_the_first_message_that_has_a_signal_counts_in_its_unit() -> None:
    tables = {
        "A": {"t_s": column(2.0, 0.0, 2.0, 9.1e9), "mm": column(1e3, 2e3, 3e3, 4e3)},
        "B": {"t_s": column(0.0, 2.0), "m": column(7.0, 8.0)},
        "C": {"t_s": column(0.0, 1.0), "cm": column(1.1e10, 50.0)},
        "D": {"t_s": column(0.0, 1.0), "m": column(1.0, 2.0), "units": column(1.0, 1.0)},
    }
    sources = (
        Source("height_m", "missing", "m"),
        Source("height_m", "A", "mm", 1e-3),
        Source("height_m", "B", "m"),
        Source("height_m", "C", "cm", plain=0.01, axis=1),
        Source("other_m", "C", "cm", plain=0.01),
        Source("third_m", "D", "m", plain=0.01),
    )
    found = gathered(tables, sources)
    assert found["height_m"].t_s.tolist() == [0.0, 2.0]  # in order, the first of an instant
    np.testing.assert_equal(found["height_m"].values, [[2.0, NAN], [1.0, NAN]])
    np.testing.assert_equal(found["other_m"].values[:, 0], [NAN, 0.5])
    assert found["third_m"].values[:, 0].tolist() == [1.0, 2.0]


def test_motors_are_the_outputs_that_parameters_name_in_their_order() -> None:
    outputs = {
        "t_s": column(0.0, 1.0), "C1": column(1100.0, 900.0), "C2": column(1500.0, 2000.0),
        "C3": column(1300.0, 1700.0),
    }  # fmt: skip
    named = {"SERVO1_FUNCTION": 34.0, "SERVO2_FUNCTION": 33.0, "SERVO3_FUNCTION": 82.0}
    found = motors(named, outputs, "C{}")["motors"]
    np.testing.assert_allclose(found.values, [[0.5, 0.1, 0.3], [1.0, 0.0, 0.7]])
    ends = {**named, "MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0}
    np.testing.assert_allclose(
        motors(ends, outputs, "C{}")["motors"].values, [[0.5, 0.0, 0.25], [1.0, 0.0, 0.75]]
    )
    assert not motors({"SERVO1_FUNCTION": 32.0, "SERVO2_FUNCTION": 41.0}, outputs, "C{}")


def test_targets_are_none_while_the_asked_velocity_stands_still() -> None:
    """North and east for 1.2 s; down never for a second."""
    n = np.arange(60)
    t_s = n / 10.0
    north = np.where((n >= 20) & (n <= 31), 7.0, t_s)
    asked = Signal(t_s, np.column_stack((north, north, n // 9)))
    place = Signal(t_s + 0.05, np.column_stack((t_s, t_s, t_s)))
    found = while_controlled({"wanted_velocity_mps": asked, "wanted_position_m": place})
    unknown = (n > 20) & (n <= 31)
    for name, given in (("wanted_velocity_mps", asked), ("wanted_position_m", place)):
        lost = np.isnan(found[name].values)
        np.testing.assert_array_equal(lost, np.column_stack((unknown, unknown, False & unknown)))
        np.testing.assert_array_equal(found[name].values[~lost], given.values[~lost])


def test_angles_of_quaternions_are_scipys() -> None:
    turns = Rotation.random(50, random_state=1)
    x, y, z, w = turns.as_quat().T
    yaw, pitch, roll = turns.as_euler("ZYX", degrees=True).T
    found = euler_deg(np.column_stack((w, x, y, z)))
    np.testing.assert_allclose(found, np.column_stack((roll, pitch, yaw)), atol=1e-9)


def test_a_signal_without_samples_is_unknown_everywhere() -> None:
    none = Signal(np.zeros(0), np.zeros((0, 3)))
    assert none.holes_s.shape == (0, 2)
    np.testing.assert_equal(none.at(column(1.0, 2.0)), [[NAN], [NAN]])
    holes = Signal(np.append(np.arange(4.0), [12.0, 13.0]), np.zeros((6, 1))).holes_s
    assert holes.tolist() == [[3.0, 12.0]]
    assert len(AXES["motors"]) == 12
    assert (AXES["motors"][0], AXES["motors"][-1]) == ("motor 1", "motor 12")
    assert AXES["remaining"] == ("battery 1", "battery 2")


def test_axes_of_other_messages_are_at_the_times_of_the_first() -> None:
    tables = {
        "N": {"t_s": column(0.0, 1.0, 2.0), "a": column(1.0, 2.0, 3.0)},
        "E": {"t_s": column(0.5, 1.5, 2.5), "a": column(10.0, 20.0, 30.0)},
        "D": {"t_s": column(0.0, 9e9), "a": column(5.0, 6.0)},
        "none": {"t_s": column(0.0), "a": column(NAN)},
    }
    sources = [Source("x", "E", "a", axis=1), Source("x", "N", "a"), Source("x", "E", "a"),
               Source("y", "D", "a"), Source("z", "none", "a")]  # fmt: skip
    found = gathered(tables, sources)
    np.testing.assert_equal(found["x"].values, [[1.0, NAN], [2.0, 15.0], [3.0, 25.0]])
    assert found["y"].t_s.tolist() == [0.0]
    assert "z" not in found
    few = {"m": {"t_s": column(-8.9e9, 0.0), "a": column(-1e10, 1.1e10)}}
    np.testing.assert_equal(gathered(few, [Source("x", "m", "a")])["x"].values, [[-1e10], [NAN]])


def test_a_velocity_that_stands_for_a_second_is_asked_for() -> None:
    """And only what is told after it stood still is none; down is on its own."""
    t_s = column(0.0, 0.25, 0.5, 1.0, 1.25, 2.0, 2.5)
    for last_s, none in ((1.25, False), (1.3125, True)):
        times = t_s.copy()
        times[4] = last_s
        down = column(1, 2, 2, 2, 3, 4, 5)
        flat = np.column_stack((times, times))
        asked = Signal(times, np.column_stack((flat, down)))
        place = Signal(column(-1.0, 0.3, 1.1), np.zeros((3, 3)))
        found = while_controlled({"wanted_velocity_mps": asked, "wanted_position_m": place})
        velocity = found["wanted_velocity_mps"].values
        assert np.isnan(velocity[:, 2]).tolist() == [False, False, none, none, *[False] * 3]
        assert not np.isnan(velocity[:, :2]).any()
        # At 0.3 s it is new; at 1.1 s it stands; before the first nobody knows.
        lost = np.isnan(found["wanted_position_m"].values)
        assert lost[:, 2].tolist() == [False, False, none]
        assert not lost[:, :2].any()
    assert while_controlled({"other": place}) == {"other": place}
    level = Signal(column(0.0, 2.0, 4.0), np.ones((3, 2)))  # without down
    found = while_controlled({"wanted_velocity_mps": level})
    assert np.isnan(found["wanted_velocity_mps"].values).tolist() == [
        [False] * 2,
        *[[True] * 2] * 2,
    ]


def test_every_number_of_a_motor_is_known() -> None:
    """33 to 40 are the first eight, 82 to 85 the last four of SERVOn_FUNCTION."""
    functions = [*range(33, 41), *range(82, 86)]
    outputs = {"t_s": column(0.0), **{f"C{n}": column(1000.0 + 10 * n) for n in range(1, 33)}}
    named = {f"SERVO{33 - n}_FUNCTION": float(f) for n, f in enumerate(functions, start=1)}
    found = motors(named, outputs, "C{}")["motors"].values[0]
    np.testing.assert_allclose(found, [(33 - n) / 100 for n in range(1, 13)])
    assert not motors({"SERVO33_FUNCTION": 33.0, "SERVO0_FUNCTION": 34.0}, outputs, "C{}")
    others = {f"SERVO{n}_FUNCTION": f for n, f in enumerate((32.0, 41.0, 81.0, 86.0), start=1)}
    assert not motors(others, outputs, "C{}")
