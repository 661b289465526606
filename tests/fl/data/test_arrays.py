"""Arrays as data sets: what is taken, up to where, and what is held out of it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fl.data.arrays import CustomDataset, Samples, dataset_of, labels
from fl.data.dataset import (
    Dataset,
    Provenance,
    Split,
    checked,
    held_out,
    held_out_of_each,
    hold_out,
)
from fl.errors import DataLayoutError
from native.errors import UsersCodeError

HERE = Provenance("here", official=False)
EIGHT = np.arange(8) % 2


def made(x: Any, y: Any = EIGHT, owner: Any = None) -> Dataset:
    """The first six are of the training."""
    samples = Samples(np.asarray(x)[:6], np.asarray(y)[:6], np.asarray(x)[6:], np.asarray(y)[6:],
                      owner)  # fmt: skip
    return dataset_of("t", samples, provenance=HERE)


def pixels(*shape: int, kind: Any = np.uint8, value: float = 0) -> Any:
    return np.full((8, *shape), value, kind)


def test_images_and_features_are_kept_as_they_are() -> None:
    rng = np.random.default_rng(1)
    for shape, seen in (
        ((5, 7), (5, 7, 1)), ((5, 7, 1), (5, 7, 1)), ((5, 7, 3), (5, 7, 3)), ((5, 7, 4), (5, 7, 4)),
    ):  # fmt: skip
        given = rng.integers(0, 256, (8, *shape)).astype(np.uint8)
        found = made(given)
        assert found.image_shape == seen
        assert (found.train.images == given[:6].reshape(6, *seen)).all()
        assert found.train.images.dtype == np.uint8
        floats = made(given / 255.0)
        assert floats.validation.images.dtype == np.float32
        assert floats.validation.images == pytest.approx(given[6:].reshape(2, *seen) / 255.0)
    features = rng.normal(0.0, 900.0, (8, 3))
    found = made(features)
    assert found.image_shape == (1, 1, 3)
    assert found.train.images[:, 0, 0] == pytest.approx(features[:6])
    assert (found.classes, found.labels.tolist()) == (2, [0, 1, 0, 1, 0, 1])
    assert found.held_out.tolist() == [1, 1]
    assert made(pixels(2, 2), [0, 1, 0, 1, 0, 1, 4, 2]).classes == 5
    owned = made(pixels(2, 2), owner=np.arange(6, dtype=np.uint8))
    assert owned.owners is not None
    assert owned.owners.tolist() == [0, 1, 2, 3, 4, 5]
    assert owned.owners.dtype == np.int64


@pytest.mark.parametrize(
    ("what", "why"),
    [
        (lambda: made(pixels(5, 7, 2)), r"x_train is \(6, 5, 7, 2\); wanted images"),
        (lambda: made(pixels(5, 7, 5)), "with 1, 3 or 4 channels"),
        (lambda: made(pixels(1, 5, 7, 1)), "wanted images"),
        (lambda: made(pixels()), "wanted images"),
        (lambda: made(pixels(5, 7, kind=float, value=-1e-9)), "x_train holds floats outside"),
        (lambda: made(pixels(5, 7, kind=float, value=1 + 1e-9)), "floats outside"),
        (lambda: made(pixels(5, 7, kind=float, value=np.nan)), "floats outside"),
        (lambda: made(pixels(5, 7, kind=np.int16)), "of type int16; wanted bytes or floats"),
        (lambda: made(pixels(2, 2), EIGHT + 0.0), r"y_train is float64 \(6,\); wanted integers"),
        (lambda: made(pixels(2, 2), np.stack([EIGHT, EIGHT], axis=1)), "y_train is int64"),
        (lambda: made(pixels(2, 2), EIGHT - 1), "training label -1 is outside the classes 0 to"),
        (lambda: made(pixels(2, 2), owner=np.zeros(5, int)), r"owner is int64 \(5,\); wanted"),
        (lambda: made(pixels(2, 2), owner=np.zeros((6, 1), int)), r"owner is int64 \(6, 1\)"),
        (lambda: made(pixels(2, 2), owner=np.zeros(6)), "owner is float64"),
    ],
)
def test_what_is_no_data_set_is_refused(what: Callable[[], Dataset], why: str) -> None:
    with pytest.raises(DataLayoutError, match=why):
        what()
    assert made(pixels(5, 7, kind=float, value=1.0)).image_shape == (5, 7, 1)


def test_labels_are_whole_numbers_below_65536() -> None:
    column = labels(np.array([[3], [65_535]], dtype=np.uint16), "y", "here")
    assert (column.tolist(), column.dtype) == ([3, 65_535], np.int64)
    with pytest.raises(DataLayoutError, match="y holds a label 65536; at most 65535"):
        labels(np.array([65_536]), "y", "here")
    assert labels(np.zeros(0, dtype=np.int64), "y", "here").tolist() == []


def test_splits_fit_each_other_and_their_labels() -> None:
    def split(count: int, *shape: int, last: int = 0, of: int | None = None) -> Split:
        names = np.zeros(count, dtype=np.int64)
        names[-1:] = last
        images = np.zeros((count if of is None else of, *(shape or (2, 2, 1))), np.uint8)
        return Split(images, names)

    good = split(3, last=1)
    for train, validation, why in (
        (split(0), good, "no training images"), (good, split(0), "no validation images"),
        (split(3, of=2), good, "2 training images, but 3 training labels"),
        (good, split(3, last=2), "validation label 2 is outside the classes 0 to 1"),
        (good, split(3, last=-1), "validation label -1 is outside"),
        (good, split(3, 2, 3, 1), r"training images of \(2, 2, 1\), validation images of \(2, 3,"),
    ):  # fmt: skip
        with pytest.raises(DataLayoutError, match=why):
            checked("t", train, validation, classes=2, provenance=HERE)
    assert checked("t", good, good, classes=2, provenance=HERE).held_out.tolist() == [2, 1]


def test_what_is_held_out_of_a_class_is_its_share_and_one_at_least() -> None:
    samples = np.array([0, 1, 2, 5, 6, 7, 100])
    assert held_out_of_each(samples, 0.2).tolist() == [0, 1, 1, 1, 1, 1, 20]
    assert held_out_of_each(samples, 0.4).tolist() == [0, 1, 1, 2, 2, 3, 40]
    names = np.array([0] * 10 + [4] * 5 + [9])
    held = held_out(names, share=0.4, seed=3)
    assert [int(held[names == n].sum()) for n in (0, 4, 9)] == [4, 2, 1]
    assert (held == held_out(names, share=0.4, seed=3)).all()
    assert (held != held_out(names, share=0.4, seed=4)).any()
    rest, part = hold_out(np.arange(16, dtype=np.uint8)[:, None, None, None], names, share=0.4,
                          seed=3)  # fmt: skip
    assert rest.images.ravel().tolist() == np.flatnonzero(~held).tolist()
    assert part.images.ravel().tolist() == np.flatnonzero(held).tolist()
    assert (part.labels == names[held]).all()


def test_a_data_set_of_ones_own_is_known_by_its_arrays() -> None:
    """By type, shape and content, and not by how they lie in memory."""

    def md5(samples: Samples) -> str:
        return CustomDataset("own:data", lambda _: samples).load(None).provenance.files[0].md5

    x, y = np.arange(24, dtype=np.uint8).reshape(6, 2, 2), np.arange(6) % 2
    usual = Samples(x, y, x[:2], y[:2])
    turned = np.asfortranarray(x)
    others = [
        Samples(x / 255.0, y, x[:2] / 255.0, y[:2]),
        Samples(x[..., None], y, x[:2, ..., None], y[:2]),
        Samples(x, y.astype(np.int32), x[:2], y[:2]), Samples(x, 1 - y, x[:2], y[:2]),
        Samples(x, y, x[:2], y[:2], np.arange(6)), Samples(x, y, x[2:4], y[:2]),
    ]  # fmt: skip
    assert md5(usual) == md5(Samples(turned, y, turned[:2], y[:2]))
    assert len({md5(usual), *map(md5, others)}) == 7
    for wrong in (7, Samples(x, y, x[:0], y[:0])):
        with pytest.raises(
            UsersCodeError, match=r"the factory gives an int, |no validation images"
        ):
            CustomDataset("own:data", lambda _, of=wrong: of).load(None)
