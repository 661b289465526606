"""Who comes how near to whom, of motions whose every place is given."""

import numpy as np
import pytest

from sitl.nearness import Nearest, Nearness, straight_pieces

S = 1_000_000_000
TOUCH_M = 0.754  # twice 0.25 m to a rotor's axis and 0.127 m of its blades
BOTH = np.array([True, True])


def straight(*ends: tuple[tuple[float, ...], tuple[float, ...]]) -> np.ndarray:
    """(n, 2, 3) from one place (north, east, down) to another."""
    return np.array(ends, dtype=np.float64)


def followed(one: tuple, other: tuple, *, near_m: float = 0.0) -> Nearest:  # type: ignore[type-arg]  # places
    apart = Nearness([near_m, near_m])
    apart.follow(np.array([0, S]), straight(one, other), counts=BOTH)
    (least,) = apart.least
    return least


def test_pieces_of_a_stride_lie_on_the_parabola_that_is_flown() -> None:
    """A tenth of a second in fifths; accelerated evenly, a cubic through both ends is exact."""
    accel, speed, place = np.array([3.0, -2.0, 1.0]), np.array([5.0, 0.0, -1.0]), np.ones(3)
    t_ns = np.array([7 * S, 7 * S + 100_000_000])
    t_s = np.array([0.0, 0.1])[:, None]
    places = (place + speed * t_s + accel * t_s**2 / 2)[None]
    speeds = (speed + accel * t_s)[None]
    found_ns, found = straight_pieces(t_ns, places, speeds)
    assert found_ns.tolist() == [7 * S + n * 20_000_000 for n in range(6)]
    fine_s = np.linspace(0.0, 0.1, 6)[:, None]
    np.testing.assert_allclose(found[0], place + speed * fine_s + accel * fine_s**2 / 2, atol=1e-12)
    # What is a step already stays as it is.
    short = np.array([0, 20_000_000])
    assert straight_pieces(short, places, speeds)[0].tolist() == short.tolist()


def test_the_nearest_is_where_the_line_between_them_is_across() -> None:
    """One flies 10 m east in a second, past another 3 m to the north of its fourth metre."""
    least = followed(((0, 0, -9), (0, 10, -9)), ((3, 4, -9), (3, 4, -9)))
    assert least.distance_m == pytest.approx(3.0)
    assert least.t_ns == 400_000_000
    np.testing.assert_allclose(least.places_ned_m, [(0, 4, -9), (3, 4, -9)], atol=1e-12)
    over = followed(((0, 0, -9), (0, 10, -9)), ((3, 4, -13), (3, 4, -13)))
    assert (over.horizontal_m, over.vertical_m) == pytest.approx((3.0, 4.0))
    # Where they only come nearer, or fly apart, it is an end; where they keep apart, the begin.
    nearer = followed(((0, 0, -9), (0, 2, -9)), ((0, 9, -9), (0, 9, -9)))
    assert (nearer.distance_m, nearer.t_ns) == (7.0, S)
    slowly = followed(((0, 0, -9), (0, 0.5, -9)), ((0, 9, -9), (0, 9, -9)))
    assert (slowly.distance_m, slowly.t_ns) == (8.5, S)
    beside = followed(((0, 0, -9), (0, 2, -9)), ((4, 0, -9), (4, 2, -9)))
    assert (beside.distance_m, beside.t_ns) == (4.0, 0)


def test_of_a_way_with_a_corner_each_leg_counts() -> None:
    apart = Nearness([0.0, 0.0])
    way = np.array([(0, 0, -9), (0, 4, -9), (4, 4, -9)], dtype=np.float64)
    still = np.tile((3.0, 5.0, -9.0), (3, 1))
    apart.follow(S * np.arange(3), np.stack((way, still)), counts=BOTH)
    (least,) = apart.least
    assert (least.distance_m, least.t_ns) == pytest.approx((1.0, 1.75 * S))
    np.testing.assert_allclose(least.places_ned_m, [(3, 4, -9), (3, 5, -9)], atol=1e-12)


@pytest.mark.parametrize(("height_m", "known"), [(0.19, False), (0.21, True)])
def test_two_on_the_ground_are_not_followed(height_m: float, known: bool) -> None:
    stands, rises = ((3, 0, 0), (3, 0, 0)), ((0, 0, -height_m), (0, 0, -height_m))
    assert np.isnan(followed(stands, rises).distance_m) != known
    assert np.isnan(followed(rises, stands).distance_m) != known


@pytest.mark.parametrize(("apart_m", "touch"), [(0.75, True), (0.76, False)])
def test_they_touch_where_their_hulls_do(apart_m: float, touch: bool) -> None:
    places = straight(((0, 0, -9), (0, 0, -9)), ((0, apart_m, -9), (0, apart_m, -9)))
    touched, _ = Nearness([0.0, 0.0]).follow(np.array([0, S]), places, counts=BOTH)
    assert touched == ([(0, 1)] if touch else [])
    one = Nearness([0.0, 0.0]).follow(np.array([0, S]), places, counts=np.array([True, False]))
    assert one == ([], [])  # a wreck touches nobody


def test_an_encounter_is_told_once_as_it_begins() -> None:
    """Wanted within 5 m by one of them: at 0.5 s it is so near, and then goes away."""
    apart = Nearness([0.0, 5.0])
    t_ns, still = np.array([0, S]), ((0, 0, -9), (0, 0, -9))
    told = []
    for begin, end in (((10, 0, -9), (0.8, 0, -9)), ((0.8, 0, -9), (9, 0, -9)),
                       ((9, 0, -9), (8, 0, -9)), ((8, 0, -9), (4, 0, -9))):  # fmt: skip
        _, near = apart.follow(t_ns, straight(still, (begin, end)), counts=BOTH)
        told.append([round(new.distance_m, 3) for new in near])
    assert told == [[0.8], [], [], [4.0]]


@pytest.mark.parametrize(
    ("apart_m", "closing_mps", "clear_s"),
    [
        # Beyond touching: 10 m/s2 each towards the other is 10 s^2 metres.
        (TOUCH_M + 10.01, 0.0, 1.0), (TOUCH_M + 9.99, 0.0, 0.5), (TOUCH_M + 2.49, 0.0, 0.2),
        (TOUCH_M + 0.39, 0.0, 0.1), (TOUCH_M + 0.09, 0.0, 0.02), (TOUCH_M + 0.003, 0.0, 0.0),
        (TOUCH_M + 16.01, 6.0, 1.0), (TOUCH_M + 15.99, 6.0, 0.5), (TOUCH_M + 1.61, 6.0, 0.2),
        (TOUCH_M + 1.59, 6.0, 0.1),
    ],
)  # fmt: skip
def test_for_how_long_nobody_can_touch(apart_m: float, closing_mps: float, clear_s: float) -> None:
    places = np.array([(0.0, 0.0, -9.0), (apart_m, 0.0, -9.0)])
    speeds = np.array([(closing_mps + 3.0, 0.0, 0.0), (3.0, 0.0, 0.0)])
    assert Nearness([0.0, 0.0]).clear(places, speeds) == clear_s
