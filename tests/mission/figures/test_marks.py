"""What the marks of devices on maps are called, and how large they are."""

from collections.abc import Sequence

import numpy as np
import pytest

from mission.figures.marks import RoundMarks, Scene, Sent, _device_words
from mission.figures.words import Look
from mission.log.values import Devices


@pytest.mark.parametrize(
    ("count", "outcomes", "told"),
    [
        (60, ("lost", "served"), range(60)),
        (61, ("lost", "served"), [3, 40]),
        (61, ("late", "served"), range(61)),
        (61, (), range(61)),
    ],
)
def test_in_a_crowd_only_who_did_not_arrive_is_numbered(
    count: int, outcomes: tuple[str, ...], told: Sequence[int]
) -> None:
    at_m = np.column_stack((np.arange(float(count)), np.zeros(count)))
    went = {3: "lost", 7: "served", 40: "late"}
    sent = {k: Sent(1, k, 0, None, 0.5, outcome) for k, outcome in went.items()}
    marks = [RoundMarks(1, np.ones(count), sent)]
    scene = Scene(Devices(at_m, ("",) * count), marks, [], [], [], [], at_m[0], outcomes=outcomes)
    look, numbers = _device_words(scene)
    assert [(word.text, *word.at_m) for word in numbers] == [(str(k), k, 0.0) for k in told]
    assert (look.font_px < Look().font_px) == (count > 60)
