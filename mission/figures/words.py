"""Label placement on maps: words beside marks that cover neither each other nor what is drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import altair as alt
import numpy as np

from mission.base.arrays import Floats
from mission.figures.frame import MapFrame
from mission.figures.style import INK, PAPER, SOFT, table

# Towards where from the mark, the best first: dx and dy in pixels, of which down is more.
SIDES = ((1, -1), (1, 1), (-1, -1), (-1, 1), (1, 0), (-1, 0), (0, -1), (0, 1))
_ALIGN = {1: "left", 0: "center", -1: "right"}
_ROUND_THE_MARK = {(0, 0): (0.0, 0.0), (1, 1): (0.8, 0.7), (1, 0): (1.15, 0.0), (0, 1): (0.0, 1.4)}
_WIDE, _HIGH = 0.56, 0.9  # of a character, and of a word, in font sizes
_EACH_PX = 4.0  # between the points that a line is taken for
_ORDER, _LINE, _DOT, _WORD, _OUTSIDE = 0.6, 2.0, 3.0, 0.5, 20.0  # what covering one costs


@dataclass(frozen=True)
class Word:
    """A label at a place of the map, shown in one round (0: in all)."""

    text: str
    at_m: tuple[float, ...]  # x and y
    round: int = 0
    sides: Sequence[tuple[int, int]] = SIDES  # where it may stand; (0, 0): on the place itself


@dataclass(frozen=True)
class Look:
    """Style of labels: distance from the middle of their marks, font size, colour."""

    gap_px: float = 11.0
    font_px: float = 9.5
    colour: str = INK


CROWDED = Look(7.0, 8.0)
NAME = Look(12.0, 10.0, SOFT)  # of start and home


@dataclass(frozen=True)
class Drawn:
    """Obstacles of label placement: dots and lines."""

    dots: Floats  # (n, 3) x and y on the map, radius in pixels
    lines: Sequence[tuple[int, Floats]]  # round (0: of all), and points (n, 2) on the map


def gathered(
    places: Sequence[tuple[Floats, int]], within_m: float
) -> list[tuple[Floats, list[int]]]:
    """Cluster numbered places (2,): those nearer than `within_m` to the first of a cluster."""
    found: list[tuple[Floats, list[int]]] = []
    for at_m, number in places:
        near = (numbers for other, numbers in found if np.linalg.norm(other - at_m) < within_m)
        if (numbers := next(near, None)) is None:
            found.append((at_m, [number]))
        else:
            numbers.append(number)
    return found


def words(
    frame: MapFrame, each: Sequence[tuple[Look, Sequence[Word]]], drawn: Drawn
) -> list[alt.Chart]:
    """Place labels greedily, in the order given; return their layers, all halos below texts."""
    dots = np.column_stack((frame.pixels(drawn.dots[:, :2]), drawn.dots[:, 2]))
    lines: dict[int, list[Floats]] = {}
    for number, points in drawn.lines:
        lines.setdefault(number, []).append(_dotted(frame.pixels(points)))
    seen = {number: _together(lines, number) for number in {0, *_rounds(each)}}
    taken: dict[int, list[Floats]] = {}
    halos, texts = [], []
    for look, items in each:
        sides = []
        for word in items:
            at = frame.pixels(np.array([word.at_m]))[0]
            others = _together(taken, word.round, columns=4)
            side, box = _best(frame, look, word, at, dots, seen[word.round], others)
            taken.setdefault(word.round, []).append(box[None])
            sides.append(side)
        for side in dict.fromkeys(sides):
            mine = [word for word, own in zip(items, sides, strict=True) if own == side]
            halo, text = _layers(frame, look, side, mine)
            halos.append(halo)
            texts.append(text)
    return halos + texts


def _rounds(each: Sequence[tuple[Look, Sequence[Word]]]) -> set[int]:
    return {word.round for _, items in each for word in items}


def _together(parts: Mapping[int, Sequence[Floats]], number: int, *, columns: int = 2) -> Floats:
    """All rows that are ever seen at once with those of a round; 0 stands for all rounds."""
    rounds = parts if number == 0 else {0, number}
    rows = [row for other in rounds for row in parts.get(other, ())]
    return np.vstack((np.empty((0, columns)), *rows))


def _offset(side: tuple[int, int], gap_px: float) -> tuple[float, float]:
    across, down = _ROUND_THE_MARK[abs(side[0]), abs(side[1])]
    return side[0] * across * gap_px, side[1] * down * gap_px


def _best(
    frame: MapFrame,
    look: Look,
    word: Word,
    at: Floats,
    dots: Floats,
    points: Floats,
    others: Floats,
) -> tuple[tuple[int, int], Floats]:
    wide, high = _WIDE * look.font_px * len(word.text), _HIGH * look.font_px
    # What no word beside the mark can reach is left out before eight sides are tried.
    reach = wide + high + 1.4 * look.gap_px
    points = points[(np.abs(points - at) <= reach).all(axis=1)]
    away = np.hypot(*(dots[:, :2] - at).T)
    rivals = dots[(away > 1.0) & (away <= 1.5 * reach + dots[:, 2])]
    best: tuple[float, tuple[int, int], Floats] | None = None
    for rank, side in enumerate(word.sides):
        dx, dy = _offset(side, look.gap_px)
        left, top = at[0] + dx - (1 - side[0]) / 2.0 * wide, at[1] + dy - high / 2.0
        box = np.array([left, top, left + wide, top + high])
        inside = (points >= box[:2]) & (points <= box[2:])
        away = np.hypot(*(np.clip(rivals[:, :2], box[:2], box[2:]) - rivals[:, :2]).T)
        shared = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
        # On a phone a map is half as wide, and its words are as large.
        far = np.tile(at, 2) + 2.0 * (box - np.tile(at, 2))
        out = (far < 0.0).any() or far[2] > frame.width or far[3] > frame.height
        cost = (
            _ORDER * rank
            + _LINE * float(inside.all(axis=1).sum())
            + _DOT * float(np.maximum(rivals[:, 2] - away, 0.0).sum())
            + _WORD * float(np.maximum(shared, 0.0).prod(axis=1).sum())
            + _OUTSIDE * bool(out)
        )
        if best is None or cost < best[0]:
            best = cost, side, box
    assert best is not None
    return best[1], best[2]


def _dotted(points: Floats) -> Floats:
    """Points of a line, close enough that no word lies between them."""
    legs = np.hypot(*np.diff(points, axis=0).T)
    counts = np.maximum(np.ceil(legs / _EACH_PX).astype(np.int64), 1)
    parts = [
        np.linspace(a, b, count, endpoint=False)
        for a, b, count in zip(points[:-1], points[1:], counts, strict=True)
    ]
    return np.vstack((*parts, points[-1:]))


def _layers(
    frame: MapFrame, look: Look, side: tuple[int, int], mine: Sequence[Word]
) -> tuple[alt.Chart, alt.Chart]:
    """Words on one side of their marks, under them a rim of paper where they must cover a line."""
    data = table(
        round=[word.round for word in mine],
        x=[word.at_m[0] for word in mine],
        y=[word.at_m[1] for word in mine],
        word=[word.text for word in mine],
    )
    dx, dy = _offset(side, look.gap_px)
    places = frame.chart(data).encode(alt.Text("word:N"))
    shape: dict[str, Any] = {"align": _ALIGN[side[0]], "dx": dx, "dy": dy, "fontSize": look.font_px}
    rim: dict[str, Any] = {"stroke": PAPER, "strokeWidth": 2.5, "strokeOpacity": 0.8}
    return places.mark_text(color=PAPER, **rim, **shape), places.mark_text(
        color=look.colour, **shape
    )
