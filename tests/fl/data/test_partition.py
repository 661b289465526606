"""Partitioners: every sample used once, labels as asked, coverage when asked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fl.data.partition import (
    CustomPartition,
    PartitionTask,
    by_dirichlet,
    by_labels,
    by_owner,
    class_counts,
    draw_owners,
    iid,
)
from native.errors import SettingError, UsersCodeError


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def balanced(each: int) -> np.ndarray:
    return rng(99).permutation(np.repeat(np.arange(10), each))


@given(
    devices=st.integers(1, 9),
    classes=st.integers(2, 12),
    per_device=st.integers(1, 12),
    coverage=st.booleans(),
    seed=st.integers(0, 10_000),
)
@settings(max_examples=150, deadline=None)
def test_owners_have_as_many_labels_as_asked_and_coverage_is_kept(
    devices: int, classes: int, per_device: int, coverage: bool, seed: int
) -> None:
    possible = per_device <= classes and (not coverage or devices * per_device >= classes)
    if not possible:
        with pytest.raises(SettingError):
            draw_owners(devices, classes, per_device=per_device, coverage=coverage, rng=rng(seed))
        return
    owns = draw_owners(devices, classes, per_device=per_device, coverage=coverage, rng=rng(seed))
    assert owns.shape == (devices, classes)
    assert (owns.sum(axis=1) == per_device).all()
    if coverage:
        assert owns.any(axis=0).all()


def test_two_random_labels_on_six_devices_leave_2_6_of_10_classes_orphaned() -> None:
    orphans = [
        10 - draw_owners(6, 10, per_device=2, coverage=False, rng=rng(i)).any(axis=0).sum()
        for i in range(3000)
    ]
    # Expected 10 (4/5)^6: a class is missed by each of six devices with probability 8/10.
    assert np.mean(orphans) == pytest.approx(10 * 0.8**6, abs=0.06)


@pytest.mark.parametrize("seed", range(5))
def test_a_class_is_split_equally_over_its_owners_and_used_once(seed: int) -> None:
    labels = balanced(101)
    owns = draw_owners(6, 10, per_device=4, coverage=False, rng=rng(seed))
    shares = by_labels(labels, owns, rng=rng(seed + 1))
    counts = class_counts(labels, shares, classes=10)
    np.testing.assert_array_equal(counts > 0, owns)
    for label in range(10):
        owned = counts[owns[:, label], label]
        if owned.size:
            assert owned.sum() == 101
            assert owned.max() - owned.min() <= 1
    joined = np.concatenate(shares)
    assert np.unique(joined).size == joined.size


def test_split_is_random_not_in_file_order() -> None:
    labels = np.zeros(1000, dtype=np.int64)
    first, second = by_labels(labels, np.ones((2, 1), dtype=bool), rng=rng())
    assert 300 < np.median(first) < 700
    assert not np.array_equal(first, np.arange(500))
    assert np.array_equal(np.sort(np.concatenate([first, second])), np.arange(1000))


def test_iid_uses_all_samples_equally() -> None:
    shares = iid(1003, devices=7, rng=rng())
    assert sorted(len(s) for s in shares) == [143] * 5 + [144] * 2
    np.testing.assert_array_equal(np.sort(np.concatenate(shares)), np.arange(1003))


def test_dirichlet_is_even_for_large_and_uneven_for_small_alpha() -> None:
    labels = balanced(200)

    def spread(alpha: float) -> float:
        shares = by_dirichlet(labels, devices=5, classes=10, alpha=alpha, rng=rng(3))
        np.testing.assert_array_equal(np.sort(np.concatenate(shares)), np.arange(2000))
        return float(class_counts(labels, shares, classes=10).std())

    # Var of Dirichlet proportions: (1/5)(4/5) / (5 alpha + 1), of 200 samples each.
    for alpha in (0.3, 3.0, 1000.0):
        expected = 200 * np.sqrt(0.16 / (5 * alpha + 1))
        assert spread(alpha) == pytest.approx(expected, rel=0.25, abs=2.0)


def test_a_device_without_samples_is_an_error() -> None:
    labels = np.zeros(3, dtype=np.int64)
    with pytest.raises(SettingError, match=r"devices = 5: device \d of them would be without"):
        by_labels(labels, np.ones((5, 1), dtype=bool), rng=rng())
    with pytest.raises(SettingError, match="devices = 5"):
        iid(3, devices=5, rng=rng())
    with pytest.raises(SettingError, match=r"dirichlet_alpha = 0\.01"):
        by_dirichlet(labels, devices=5, classes=1, alpha=0.01, rng=rng())


def test_same_stream_same_assignment() -> None:
    labels = balanced(30)
    for make in (
        lambda r: by_labels(labels, draw_owners(4, 10, per_device=3, coverage=True, rng=r), rng=r),
        lambda r: by_dirichlet(labels, devices=4, classes=10, alpha=0.5, rng=r),
        lambda r: iid(300, devices=4, rng=r),
    ):
        for one, other in zip(make(rng(5)), make(rng(5)), strict=True):
            np.testing.assert_array_equal(one, other)
        assert any(
            not np.array_equal(a, b) for a, b in zip(make(rng(5)), make(rng(6)), strict=True)
        )


@pytest.mark.parametrize("kind", ["labels", "dirichlet", "iid"])
def test_weights_say_who_has_how_much(kind: str) -> None:
    labels, weights = balanced(300), np.array([4.0, 2.0, 1.0, 1.0])
    if kind == "labels":
        owns = np.ones((4, 10), dtype=np.bool_)
        shares = by_labels(labels, owns, rng=rng(1), weights=weights)
    elif kind == "dirichlet":
        shares = by_dirichlet(
            labels, devices=4, classes=10, alpha=1000.0, rng=rng(1), weights=weights
        )
    else:
        shares = iid(3000, devices=4, rng=rng(1), weights=weights)
    assert sorted(np.concatenate(shares)) == list(range(3000))
    got = np.array([len(share) for share in shares]) / 3000
    np.testing.assert_allclose(got, weights / weights.sum(), atol=0.01)


def test_a_device_whose_share_is_no_sample_is_refused() -> None:
    with pytest.raises(SettingError, match="device 1 of them would be without a sample"):
        iid(100, devices=2, rng=rng(), weights=np.array([1.0, 1e-6]))


def test_classes_are_dealt_to_as_many_as_can_own_them() -> None:
    for devices, per_device, coverage, fits in (
        (5, 2, True, True), (4, 2, True, False), (1, 10, True, True), (4, 2, False, True),
        (1, 11, False, False),
    ):  # fmt: skip
        try:
            draw_owners(devices, 10, per_device=per_device, coverage=coverage, rng=rng())
        except SettingError:
            assert not fits, (devices, per_device, coverage)
        else:
            assert fits, (devices, per_device, coverage)


def test_each_device_has_the_samples_of_an_owner_of_its_own() -> None:
    owners = np.array([7, 3, 7, 9, 3, 3, 5])
    shares = [share.tolist() for share in by_owner(owners, devices=4, rng=rng())]
    assert sorted(shares) == [[0, 2], [1, 4, 5], [3], [6]]
    assert len({str(by_owner(owners, devices=2, rng=rng(seed))) for seed in range(20)}) > 5
    with pytest.raises(SettingError, match="devices = 5: the data have 4 owners"):
        by_owner(owners, devices=5, rng=rng())


@pytest.mark.parametrize(
    ("given_shares", "why"),
    [
        ([[0, 9], [3]], None),
        ([[0]], "gives shares of 1 devices, not 2"),
        ([[0], []], r"device 1 gets float64 \(0,\); wanted whole numbers"),
        ([[0], np.zeros(0, dtype=np.int64)], r"device 1 gets int64 \(0,\); wanted"),
        ([[0], [[1]]], r"device 1 gets int64 \(1, 1\); wanted"),
        ([[0.0], [1]], "device 0 gets float64"),
        ([[0, 10], [3]], "device 0 gets sample 10; there are 0 to 9"),
        ([[0], [-1, 3]], "device 1 gets sample -1; there are 0 to 9"),
        ([[0, 4], [4, 3]], "sample 4 is given 2 times"),
        ([[5, 5, 5], [3]], "sample 5 is given 3 times"),
    ],
)
def test_shares_of_a_plug_in_are_checked(given_shares, why: str | None) -> None:
    task = PartitionTask(np.zeros(10, dtype=np.int64), None, 2, 1, rng())
    plugin = CustomPartition("own:split", lambda _: given_shares, 0)
    if why is None:
        assert [share.tolist() for share in plugin.shares(task)] == [[0, 9], [3]]
        turned = CustomPartition("own:split", lambda _: [[9, 0], [3]], 0).shares(task)
        assert turned[0].tolist() == [0, 9]
        return
    with pytest.raises(UsersCodeError, match=why):
        plugin.shares(task)
