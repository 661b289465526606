"""Gaps in what ought to come regularly, by hand."""

from collections.abc import Sequence

import numpy as np

from mission.base.gaps import gaps, inside, outside

S = 1_000_000_000


def found(
    t_s: list[float], *, during_s: tuple[float, float] = (0.0, 99.0), ends_s: Sequence[float] = ()
) -> object:
    t_ns, during_ns, ends_ns = (
        np.round(np.multiply(each, S)).astype(np.int64) for each in (t_s, during_s, ends_s)
    )
    begin_ns, end_ns = during_ns.tolist()
    return gaps(t_ns, (begin_ns, end_ns), usual=5.0, ends_ns=ends_ns.tolist()).tolist()


REGULAR = [n / 2 for n in range(11)]  # to 5 s


def test_a_gap_is_longer_than_a_second_and_than_so_many_usual_intervals() -> None:
    assert found([*REGULAR, 7.5, 8.0]) == []  # five of them
    assert found([*REGULAR, 7.6, 8.0]) == [[5.0, 7.6]]
    often = [n / 10 for n in range(31)]
    assert found([*often, 4.0]) == []  # a second
    assert found([*often, 4.1]) == [[3.0, 4.1]]
    assert found([1.0]) == []
    assert found([]) == []


def test_gaps_overlap_with_the_time_that_is_looked_at() -> None:
    times = [*REGULAR, 9.0, 9.5, 14.0]
    assert found(times) == [[5.0, 9.0], [9.5, 14.0]]
    assert found(times, during_s=(9.0, 9.5)) == []
    assert found(times, during_s=(8.9, 9.5)) == [[5.0, 9.0]]
    assert found(times, during_s=(9.0, 9.6)) == [[9.5, 14.0]]


def test_some_end_where_nothing_is_any_more() -> None:
    assert found(REGULAR, ends_s=[8.0]) == [[5.0, 8.0]]
    assert found(REGULAR, ends_s=[-3.0, 7.0]) == []  # outside, or too near
    assert found(REGULAR, ends_s=[-3.0], during_s=(-5.0, 9.0)) == [[-3.0, 0.0]]


def test_what_lies_in_gaps_and_what_outside() -> None:
    holes = np.array([[2.0, 4.0], [6.0, 9.0]])
    t_s = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.5, 8.0, 9.0])
    assert inside(t_s, holes).tolist() == [0, 0, 1, 0, 0, 1, 1, 0]
    values = np.column_stack((t_s, -t_s))
    parts = [part[:, 0].tolist() for part in outside(values, t_s, holes)]
    assert parts == [[1.0, 2.0], [4.0, 5.0], [9.0]]
    assert [part.tolist() for part in outside(values, t_s, np.zeros((0, 2)))] == [values.tolist()]
    early = np.array([[0.5, 1.5]])
    assert [part[0, 0] for part in outside(values, t_s, early)] == [2.0]
