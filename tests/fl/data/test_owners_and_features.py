"""Owners that the data tell, and features instead of images."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fl.data import npz
from fl.data.arrays import CustomDataset, Samples
from fl.data.dataset import hold_out
from fl.data.load import load
from fl.data.partition import by_owner
from fl.errors import DataDamagedError
from native.errors import SettingError, UsersCodeError


def test_owners_stay_with_their_samples_when_some_are_held_out(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    labels = rng.integers(0, 3, 90)
    owner = rng.integers(0, 5, 90)
    images = np.zeros((90, 2, 2), np.uint8)
    images[:, 0, 0] = owner * 10 + labels  # so that a sample tells both
    np.savez(tmp_path / "a.npz", images=images, labels=labels, owner=owner)
    found = npz.load("a.npz", tmp_path)
    assert found.owners is not None
    told = found.train.images[:, 0, 0, 0]
    assert (found.owners * 10 + found.labels == told).all()
    kept, held = hold_out(images[..., None], labels, share=1.0 / 6.0, seed=0)
    assert (found.train.images == kept.images).all()
    assert (found.validation.images == held.images).all()


def test_each_device_has_one_owner() -> None:
    owners = np.array([7, 7, 3, 9, 3, 9, 9, 1])
    shares = by_owner(owners, devices=3, rng=np.random.default_rng(1))
    whose = [set(owners[share].tolist()) for share in shares]
    assert all(len(one) == 1 for one in whose)
    assert len(set.union(*whose)) == 3
    with pytest.raises(SettingError, match="the data have 4 owners"):
        by_owner(owners, devices=5, rng=np.random.default_rng(1))


def test_features_are_channels_of_one_pixel(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    features = rng.normal(50.0, 1000.0, (60, 4))
    np.savez(tmp_path / "a.npz", features=features, labels=np.arange(60) % 3)
    found = npz.load("a.npz", tmp_path)
    assert found.image_shape == (1, 1, 4)
    assert set(found.train.images[:, 0, 0, 1]) <= set(features[:, 1].astype(np.float32))


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"features": np.ones((6, 2), int)}, "features is int64"),
        ({"features": np.full((6, 2), np.nan)}, "no finite float32"),
        ({"features": np.full((6, 2), 1e300)}, "no finite float32"),
        ({"features": np.ones((6, 0))}, "one at least"),
        ({"features": np.ones((5, 2))}, "5 features, but 6 labels"),
        ({"features": np.array(5.0)}, "0 features, but 6 labels"),
        ({"features": np.ones((6, 2)), "owner": np.ones(6)}, "owner is float64"),
        ({"features": np.ones((6, 2)), "owner": np.ones(4, int)}, "4 owner, but 6 labels"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, arrays: dict[str, Any], words: str) -> None:
    np.savez(tmp_path / "a.npz", labels=np.arange(6) % 2, **arrays)
    with pytest.raises(DataDamagedError, match=words):
        npz.load("a.npz", tmp_path)


def test_images_of_two_kinds_are_refused() -> None:
    mixed = Samples(
        np.ones((6, 4, 4), np.uint8), np.arange(6), np.ones((3, 4, 4), np.float32), np.arange(3)
    )
    with pytest.raises(
        UsersCodeError, match="training images of uint8, validation images of float"
    ):
        CustomDataset("mine:data", lambda _: mixed).load(None)


def test_an_own_data_set_is_that_of_its_folder_as_it_is_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "own_data.py").write_text(
        "import numpy as np\n"
        "from fl.data.arrays import Samples\n"
        "def load(folder):\n"
        "    x = np.load(folder / 'x.npy')\n"
        "    return Samples(x, np.arange(len(x)) % 2, x, np.arange(len(x)) % 2)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))

    def count(samples: int, project: str) -> int:
        folder = tmp_path / project / "data"
        folder.mkdir(parents=True, exist_ok=True)
        np.save(folder / "x.npy", np.zeros((samples, 4, 4), np.uint8))
        monkeypatch.chdir(folder.parent)
        found = [load("own_data:load", data_dir=Path("data")) for _ in range(2)]
        assert found[0] is found[1]
        return len(found[0].labels)

    assert [count(6, "a"), count(8, "b"), count(7, "a")] == [6, 8, 7]


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_a_users_arrays_are_neither_frozen_nor_kept(kind: Any) -> None:
    mine = Samples(np.ones((6, 4, 4, 1), kind), np.arange(6), np.ones((3, 4, 4, 1), kind),
                   np.arange(3))  # fmt: skip
    found = CustomDataset("mine:data", lambda _: mine).load(None)
    mine.x_train[:] = 0
    assert (found.train.images == 1).all()
