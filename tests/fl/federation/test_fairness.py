"""CoV and importance against hand-computed values, and the corner cases as documented."""

import math

import numpy as np
import pytest

from fl.federation.rounds import (
    coefficient_of_variation,
    device_accuracy,
    importance_of,
    windowed_accuracy,
)


def test_cov_by_hand() -> None:
    # eps_bar = .5*.8 + .25*.4 + .25*.2 = .55; deviations .25, -.15, -.35
    psi = coefficient_of_variation(np.array([0.5, 0.25, 0.25]), np.array([0.8, 0.4, 0.2]))
    assert psi == pytest.approx(math.sqrt(0.0625 + 0.0225 + 0.1225) / 0.55, rel=1e-12)


def test_cov_has_no_division_by_the_number_of_devices() -> None:
    p, eps = np.full(8, 1 / 8), np.array([0.2, 0.6] * 4)
    assert coefficient_of_variation(p, eps) == pytest.approx(math.sqrt(8 * 0.04) / 0.4)


def test_cov_of_equal_devices_is_zero_and_of_nothing_is_the_start_value() -> None:
    p = np.full(4, 0.25)
    assert coefficient_of_variation(p, np.full(4, 0.7)) == 0.0
    assert coefficient_of_variation(p, np.zeros(4)) == 1.0
    assert coefficient_of_variation(p, np.full(4, np.nan)) == 1.0


def test_a_device_never_heard_may_count_as_zero() -> None:
    p = np.full(2, 0.5)
    assert coefficient_of_variation(p, np.array([0.6, np.nan]), unheard="zero") == pytest.approx(
        math.sqrt(2 * 0.3**2) / 0.3
    )


def test_a_device_never_heard_is_left_out() -> None:
    p, eps = np.array([0.5, 0.3, 0.2]), np.array([0.6, np.nan, 0.2])
    # p of the others: 5/7 and 2/7, so eps_bar = 3.4 / 7.
    mean = 3.4 / 7
    psi = math.sqrt((0.6 - mean) ** 2 + (0.2 - mean) ** 2) / mean
    assert coefficient_of_variation(p, eps) == pytest.approx(psi)
    assert coefficient_of_variation(p, np.full(3, np.nan)) == 1.0


def test_importance_by_hand() -> None:
    p = np.array([0.5, 0.5, 0.2, 0.8])
    psi = np.array([2.0, 2.0, 0.5, 0.5])
    missed = np.array([True, False, False, True])
    delta = importance_of(p, psi, missed, boost=1.5, floor=1e-3)
    np.testing.assert_allclose(delta, [1.5, 1.0, 0.1, 0.6], rtol=1e-15)


def test_a_perfectly_fair_community_still_counts() -> None:
    p, missed = np.full(4, 0.5), np.zeros(4, dtype=bool)
    delta = importance_of(p, np.array([0.0, 0.0, 0.3, 0.3]), missed, boost=1.5, floor=1e-3)
    assert (delta > 0).all()
    assert delta[0] == pytest.approx(0.0005)
    assert delta[0] < delta[2] / 100


def test_device_accuracy_is_over_samples_in_the_devices_own_proportions() -> None:
    correct, total = np.array([9, 1, 0]), np.array([10, 10, 5])
    counts = np.array([[30, 30, 0], [0, 10, 30], [0, 0, 7], [30, 10, 0]])
    np.testing.assert_allclose(
        device_accuracy(correct, total, counts), [0.5, 0.25 * 0.1, 0.0, 0.75 * 0.9 + 0.25 * 0.1]
    )


def test_a_class_without_validation_samples_is_left_out_of_device_accuracy() -> None:
    counts = np.array([[0, 10, 30], [0, 0, 7]])
    got = device_accuracy(np.array([9, 1, 0]), np.array([10, 10, 0]), counts)
    np.testing.assert_allclose(got, [0.1, 0.0])


def test_window_is_the_mean_over_the_models_of_the_rounds_before() -> None:
    history = np.array([[0.9, 0.9], [0.1, 0.5], [0.3, 0.7], [0.0, 0.0]])
    np.testing.assert_allclose(windowed_accuracy(history, period=2), [0.2, 0.6])
    np.testing.assert_allclose(windowed_accuracy(history[:2], period=2), [0.9, 0.9])
    np.testing.assert_allclose(windowed_accuracy(history[:1], period=2), [0.9, 0.9])
