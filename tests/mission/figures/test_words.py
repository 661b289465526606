"""Where labels stand beside their marks, up to where another side is the better one.

A label of five characters in 9.5 px is taken to be 26.6 px wide and 8.55 px high, and to begin
12.65 px from the middle of its mark to either side, 15.4 px above or below, and 8.8 and 7.7 px
across. The map has a pixel a metre, 500 either way.
"""

from collections.abc import Sequence

import numpy as np
import pytest

from mission.base.arrays import Floats
from mission.figures.frame import MapFrame
from mission.figures.words import Drawn, Look, Word, gathered, words

FRAME = MapFrame(np.zeros(2), np.full(2, 500.0), 500.0)
NO_DOTS = np.empty((0, 3))
MIDDLE = (250.0, 250.0)
USUAL = Look()
Side = tuple[int, int]


def placed(
    each: Sequence[Word], dots: Sequence[Sequence[float]] = (), lines: Sequence[Floats] = (),
    *, look: Look = USUAL, round_: int = 0,
) -> dict[str, Side]:  # fmt: skip
    """On which side of its mark each label stands: to the right and down count as 1."""
    drawn = Drawn(np.array(dots, dtype=float).reshape(-1, 3), [(round_, of) for of in lines])
    charts = words(FRAME, [(look, each)], drawn)
    found: dict[str, Side] = {}
    for chart in charts[len(charts) // 2 :]:
        mark = chart.to_dict()["mark"]
        side = int(np.sign(mark["dx"])), int(np.sign(mark["dy"]))
        assert mark["align"] == {1: "left", 0: "center", -1: "right"}[side[0]]
        found |= {row["word"]: side for row in chart.data["values"]}
    return found


def moves(first: Side, other: Side, *, at: tuple[float, float] = MIDDLE, times: int = 1,
          **drawn: object) -> bool:  # fmt: skip
    """Whether a label stands on the other side, where the first may be had `times` before it."""
    word = Word("88888", at, sides=[first] * times + [other])
    (side,) = placed([word], **drawn).values()  # type: ignore[arg-type]  # as they are given
    assert side in (first, other)
    return side == other


@pytest.mark.parametrize(
    ("side", "edge"),
    [  # the middle of the side of its box that is the farthest from the mark, right and up
        ((1, 0), (39.25, 0.0)), ((-1, 0), (-39.25, 0.0)), ((0, -1), (0.0, 19.675)),
        ((0, 1), (0.0, -19.675)), ((1, -1), (35.4, 7.7)), ((1, 1), (35.4, -7.7)),
        ((-1, -1), (-35.4, 7.7)), ((-1, 1), (-35.4, -7.7)), ((1, -1), (22.1, 11.975)),
        ((-1, 1), (-22.1, -11.975)),
    ],
)  # fmt: skip
def test_a_dot_that_a_label_covers_by_a_fifth_of_a_pixel_is_worth_another_side(
    side: Side, edge: tuple[float, float]
) -> None:
    across = abs(edge[0]) > 30.0
    away = np.sign(edge) * ((1.0, 0.0) if across else (0.0, 1.0))
    dot = np.add(MIDDLE, edge) + 5.0 * away
    other = (-side[0], -side[1])
    assert not moves(side, other, dots=[(*dot, 5.19)])
    assert moves(side, other, dots=[(*dot, 5.21)])


def test_a_label_stands_beside_its_own_dot_but_not_over_one_close_to_it() -> None:
    assert not moves((1, 0), (-1, 0), dots=[(250.9, 250.0, 13.5)])
    assert moves((1, 0), (-1, 0), dots=[(251.1, 250.0, 13.5)])


def test_a_point_of_a_line_is_worth_as_much_as_three_sides() -> None:
    for at, there in (((270.0, 250.0), True), ((262.0, 250.0), False), ((290.0, 250.0), False),
                      ((270.0, 254.0), True), ((270.0, 254.5), False), ((270.0, 245.5), False),
                      ((263.0, 246.0), True), ((289.0, 254.0), True)):  # fmt: skip
        point = np.array([at])
        assert moves((1, 0), (-1, 0), lines=[point], times=3) == there
        assert not moves((1, 0), (-1, 0), lines=[point], times=4)


def test_a_line_is_points_four_pixels_apart() -> None:
    """Along the label: at 264 to 288 px there are seven, of 2 each; a side counts 0.6."""
    along = np.array([[252.0, 250.0], [400.0, 250.0]])
    assert moves((1, 0), (-1, 0), lines=[along], times=23)
    assert not moves((1, 0), (-1, 0), lines=[along], times=24)
    short = np.array([[200.0, 210.0], [270.0, 250.0], [270.0, 250.5], [270.0, 290.0]])
    assert moves((1, 0), (-1, 0), lines=[short])
    assert not moves((1, 0), (-1, 0), lines=[np.add(short, (45.0, 0.0))])


@pytest.mark.parametrize(("apart_px", "aside"), [(5.17, True), (5.19, False)])
def test_a_label_covers_another_by_a_square_pixel_at_most(apart_px: float, aside: bool) -> None:
    one = Word("1", MIDDLE, sides=[(1, 0)])
    other = Word("2", (250.0 + apart_px, 250.0), sides=[(1, 0), (-1, 0)])
    assert placed([one, other]) == {"1": (1, 0), "2": (-1 if aside else 1, 0)}
    above = Word("2", (250.0, 250.0 + 1.6 * apart_px), sides=[(1, 0), (-1, 0)])
    assert placed([one, above])["2"] == (-1 if 1.6 * apart_px < 8.32 else 1, 0)


@pytest.mark.parametrize(
    ("first", "second", "meet"),
    [(1, 1, True), (1, 2, False), (0, 2, True), (1, 0, True), (0, 0, True)],
)
def test_labels_and_lines_of_two_rounds_are_never_seen_at_once(first, second, meet: bool) -> None:
    both = [Word(str(n), MIDDLE, of, sides=[(1, 0), (-1, 0)])
            for n, of in enumerate((first, second))]  # fmt: skip
    assert placed(both) == {"0": (1, 0), "1": (-1 if meet else 1, 0)}
    line = np.array([[264.0, 250.0]])
    assert placed(both[1:], lines=[line], round_=first)["1"] == (-1 if meet else 1, 0)


@pytest.mark.parametrize(
    ("side", "out", "within"),
    [
        ((1, 0), (421.6, 250.0), (421.4, 250.0)), ((-1, 0), (78.4, 250.0), (78.6, 250.0)),
        ((0, -1), (250.0, 460.7), (250.0, 460.6)), ((0, 1), (250.0, 39.3), (250.0, 39.4)),
    ],
)  # fmt: skip
def test_a_label_would_also_stand_within_a_map_of_half_the_size(side: Side, out, within) -> None:
    other = (-side[0], -side[1])
    assert moves(side, other, at=out)
    assert not moves(side, other, at=within)
    assert moves(side, other, at=out, times=33)
    assert not moves(side, other, at=out, times=34)


def test_what_is_on_the_place_itself_is_in_its_middle() -> None:
    word = Word("88888", MIDDLE, sides=[(0, 0), (1, 0)])
    assert placed([word]) == {"88888": (0, 0)}
    for at, covered in (((262.5, 250.0), True), ((264.0, 250.0), False), ((237.0, 254.0), True)):
        assert (placed([word], lines=[np.array([at])])["88888"] == (1, 0)) == covered


def test_sizes_are_those_of_the_look() -> None:
    """Of twice the font and the distance all is twice as far."""
    look = Look(22.0, 19.0)
    for radius, aside in ((5.19, False), (5.21, True)):
        dot = (250.0 + 2 * 39.25 + 5.0, 250.0, radius)
        assert moves((1, 0), (-1, 0), dots=[dot], look=look) == aside
    (text,) = words(FRAME, [(look, [Word("1", MIDDLE, sides=[(1, -1)])])], Drawn(NO_DOTS, []))[1:]
    mark = text.to_dict()["mark"]
    assert (mark["fontSize"], mark["dx"], mark["dy"]) == pytest.approx((19.0, 17.6, -15.4))


def test_places_are_gathered_about_the_first_of_them() -> None:
    places = [(np.array([at, 0.0]), n) for n, at in enumerate((0.0, 9.9, 10.0, 19.8, -9.9, 25.0))]
    found = [(at[0], numbers) for at, numbers in gathered(places, 10.0)]
    assert found == [(0.0, [0, 1, 4]), (10.0, [2, 3]), (25.0, [5])]
