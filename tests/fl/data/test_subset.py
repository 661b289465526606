"""A share of a data set: which samples it keeps, of what kind of data, and in a run."""

import numpy as np
import pytest

import aerofed
from fl.data.bundled import colour_shapes
from fl.data.dataset import Dataset, Provenance, Split, checked, subset


def uneven() -> Dataset:
    """Three classes of 6, 3 and 1 training images, whose pixels are their numbers."""
    labels = np.array([0, 1, 0, 0, 2, 0, 1, 0, 0, 1])
    images = np.arange(10, dtype=np.uint8).reshape(10, 1, 1, 1)
    held = np.array([0, 0, 0, 0, 1, 2])
    return checked(
        "t", Split(images, labels), Split(images[:6].copy(), held), classes=3,
        provenance=Provenance("here", official=False), owners=np.arange(10),
    )  # fmt: skip


def test_it_keeps_the_first_ones_and_as_many_of_each_class_as_there_are() -> None:
    part = subset(uneven(), 0.6)  # 10 * 0.6 / 3 = 2 of each
    assert part.train.images.ravel().tolist() == [0, 1, 2, 4, 6]
    assert part.train.labels.tolist() == part.labels.tolist() == [0, 1, 0, 2, 1]
    assert part.owners is not None
    assert part.owners.tolist() == [0, 1, 2, 4, 6]
    assert part.validation.labels.tolist() == [0, 1, 2]  # 6 * 0.6 / 3 = 1.2
    assert part.held_out.tolist() == [1, 1, 1]


def test_the_smallest_has_one_of_each_class_and_the_whole_is_itself() -> None:
    assert subset(uneven(), 1e-6).labels.tolist() == [0, 1, 2]
    whole = uneven()
    assert subset(whole, 1.0) is whole


def test_images_that_are_drawn_when_looked_at_are_not_looked_at() -> None:
    part = subset(colour_shapes(), 0.1)
    assert np.array_equal(np.bincount(part.labels), np.full(10, len(part.labels) // 10))
    assert "_splits" not in vars(part)
    assert len(part.train.images) == len(part.labels)
    assert np.array_equal(np.bincount(part.validation.labels), part.held_out)


@pytest.mark.parametrize("share", [0.0, 1.1, -1])
def test_another_share_is_refused(share: float) -> None:
    with pytest.raises(aerofed.InputError, match=r"communities\.0\.subset"):
        aerofed.config("quickstart", {"communities.0.subset": share})
