"""Data files as they are found in the wild, intact and damaged: read exactly or refused by name."""

import bz2
import gzip
import hashlib
import io
import lzma
import pickle
import struct
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fl.data.cifar import BATCHES
from fl.data.dataset import Dataset, Provenance, SourceFile
from fl.data.files import md5
from fl.data.idx import NAMES
from fl.data.load import load
from fl.errors import DataDamagedError, DataMissingError
from native.errors import InputError


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def idx_bytes(array: np.ndarray) -> bytes:
    header = bytes((0, 0, 8, array.ndim)) + struct.pack(f">{array.ndim}I", *array.shape)
    return header + array.astype(np.uint8).tobytes()


def write_mnist(folder: Path, *, packed: bool = True) -> dict[str, np.ndarray]:
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {
        NAMES[0]: rng(1).integers(0, 256, (30, 28, 28)),
        NAMES[1]: np.arange(30) % 10,
        NAMES[2]: rng(2).integers(0, 256, (20, 28, 28)),
        NAMES[3]: np.arange(20) % 10,
    }
    for name, array in arrays.items():
        content = idx_bytes(array)
        if packed:
            (folder / f"{name}.gz").write_bytes(gzip.compress(content))
        else:
            (folder / name).write_bytes(content)
    return arrays


def cifar_arrays() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {
        name: (
            rng(i).integers(0, 256, (4, 3, 32, 32)).astype(np.uint8),
            (np.arange(4) + i) % 10,
        )
        for i, name in enumerate(BATCHES)
    }


def cifar_files(kind: str) -> dict[str, bytes]:
    files = {}
    for name, (images, labels) in cifar_arrays().items():
        rows = images.reshape(4, 3072)
        if kind == "python":
            files[name] = pickle.dumps({"data": rows, "labels": labels.tolist()}, protocol=4)
        else:
            files[f"{name}.bin"] = np.column_stack([labels.astype(np.uint8), rows]).tobytes()
    return files


@pytest.fixture
def made_official(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the batches that are written here pass for the official ones."""
    sums = {name: md5(content) for name, content in cifar_files("python").items()}
    monkeypatch.setattr("fl.data.cifar.CIFAR_BATCH_MD5", sums)


def tar_bytes(files: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as archive:
        for name, content in files.items():
            info = tarfile.TarInfo(f"cifar-10-batches/{name}")
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return out.getvalue()


def assert_is_cifar(dataset: Dataset, kind: str) -> None:
    arrays = cifar_arrays()
    images = np.concatenate([arrays[name][0] for name in BATCHES[:5]])
    np.testing.assert_array_equal(dataset.train.images, images.transpose(0, 2, 3, 1))
    np.testing.assert_array_equal(
        dataset.train.labels, np.concatenate([arrays[name][1] for name in BATCHES[:5]])
    )
    np.testing.assert_array_equal(
        dataset.validation.images, arrays["test_batch"][0].transpose(0, 2, 3, 1)
    )
    assert dataset.provenance.official == (kind == "python")


@pytest.mark.parametrize("sub", ["", "mnist", "MNIST/raw"])
@pytest.mark.parametrize("packed", [True, False])
def test_mnist_is_read_pixel_by_pixel(tmp_path: Path, sub: str, packed: bool) -> None:
    arrays = write_mnist(tmp_path / sub, packed=packed)
    dataset = load("mnist", data_dir=tmp_path)
    np.testing.assert_array_equal(dataset.train.images[..., 0], arrays[NAMES[0]])
    np.testing.assert_array_equal(dataset.train.labels, arrays[NAMES[1]])
    np.testing.assert_array_equal(dataset.validation.images[..., 0], arrays[NAMES[2]])
    np.testing.assert_array_equal(dataset.validation.labels, arrays[NAMES[3]])
    assert dataset.image_shape == (28, 28, 1)
    assert not dataset.train.images.flags.writeable
    assert not dataset.provenance.official


def test_files_are_read_again_only_when_they_changed(tmp_path: Path) -> None:
    write_mnist(tmp_path / "mnist")
    first = load("mnist", data_dir=tmp_path)
    assert load("mnist", data_dir=tmp_path) is first
    labels = tmp_path / "mnist" / f"{NAMES[1]}.gz"
    labels.write_bytes(gzip.compress(idx_bytes((np.arange(30) + 5) % 10)))
    np.testing.assert_array_equal(
        load("mnist", data_dir=tmp_path).train.labels, (np.arange(30) + 5) % 10
    )
    labels.write_bytes(b"")
    with pytest.raises(DataDamagedError):
        load("mnist", data_dir=tmp_path)


@pytest.mark.usefixtures("made_official")
@pytest.mark.parametrize("kind", ["python", "binary"])
@pytest.mark.parametrize("pack", [gzip.compress, lzma.compress, bz2.compress, bytes])
def test_cifar_from_any_archive(tmp_path: Path, kind: str, pack: Callable[[bytes], bytes]) -> None:
    (tmp_path / "cifar-10-mine.tar.x").write_bytes(pack(tar_bytes(cifar_files(kind))))
    assert_is_cifar(load("cifar10", data_dir=tmp_path), kind)


@pytest.mark.usefixtures("made_official")
@pytest.mark.parametrize("kind", ["python", "binary"])
@pytest.mark.parametrize(
    "sub", ["", "cifar10", "cifar-10-batches-py", "cifar10/cifar-10-batches-bin"]
)
def test_cifar_from_a_folder(tmp_path: Path, kind: str, sub: str) -> None:
    folder = tmp_path / sub
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in cifar_files(kind).items():
        (folder / name).write_bytes(content)
    assert_is_cifar(load("cifar10", data_dir=tmp_path), kind)


@pytest.mark.usefixtures("made_official")
def test_only_official_pickles_are_opened(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, ...]:
            return (Path.touch, (tmp_path / "ran",))

    files = cifar_files("python")
    files["data_batch_3"] = pickle.dumps({"data": Evil(), "labels": [0]}, protocol=4)
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    way_out = "not the official batch .* give the binary version, cifar-10-batches-bin"
    with pytest.raises(DataDamagedError, match=f"data_batch_3: {way_out}"):
        load("cifar10", data_dir=tmp_path)
    assert not (tmp_path / "ran").exists()


def truncated(content: bytes) -> bytes:
    return content[: len(content) * 2 // 3]


def flipped(content: bytes) -> bytes:
    """One byte of the packed pixels changed: only the checksum shows it."""
    middle = len(content) - 20
    return content[:middle] + bytes((content[middle] ^ 0x55,)) + content[middle + 1 :]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (truncated, "gzip: "),
        (lambda c: gzip.compress(truncated(gzip.decompress(c))), "the header promises"),
        (lambda c: gzip.compress(gzip.decompress(c) + b"x"), "the header promises"),
        (lambda c: gzip.compress(b"\0\0\x0d" + gzip.decompress(c)[3:]), "the header starts with"),
        (lambda _: gzip.compress(b"\0\0"), "too few for an IDX header"),
        (lambda _: b"", "0 bytes are too few"),
        (lambda _: b"<html>not found</html>", "gzip: "),
    ],
)
def test_damaged_mnist_is_refused_by_name(
    tmp_path: Path, name: str, damage: Callable[[bytes], bytes], reason: str
) -> None:
    write_mnist(tmp_path)
    path = tmp_path / f"{name}.gz"
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(DataDamagedError, match=reason) as caught:
        load("mnist", data_dir=tmp_path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_gzip_checksum_is_verified(tmp_path: Path) -> None:
    write_mnist(tmp_path)
    path = tmp_path / f"{NAMES[0]}.gz"
    stored = gzip.compress(gzip.decompress(path.read_bytes()), compresslevel=0)
    path.write_bytes(flipped(stored))
    with pytest.raises(DataDamagedError, match="CRC"):
        load("mnist", data_dir=tmp_path)
    folder = tmp_path / "c"
    folder.mkdir()
    whole = gzip.compress(tar_bytes(cifar_files("binary")), compresslevel=0)
    for content in (flipped(whole), whole[:5000] + b"\x99" + whole[5001:]):
        (folder / "cifar-10-binary.tar.gz").write_bytes(content)
        with pytest.raises(DataDamagedError, match=r"cifar-10-binary\.tar\.gz.*CRC"):
            load("cifar10", data_dir=folder)


@pytest.mark.parametrize("label", [10, 255])
def test_labels_out_of_range_are_refused(tmp_path: Path, label: int) -> None:
    write_mnist(tmp_path)
    labels = np.arange(30) % 10
    labels[7] = label
    (tmp_path / f"{NAMES[1]}.gz").write_bytes(gzip.compress(idx_bytes(labels)))
    with pytest.raises(DataDamagedError, match=f"training label {label} is outside"):
        load("mnist", data_dir=tmp_path)
    files = cifar_files("binary")
    files["test_batch.bin"] = bytes((label,)) + files["test_batch.bin"][1:]
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    with pytest.raises(DataDamagedError, match=rf"test_batch\.bin.*{label}"):
        load("cifar10", data_dir=tmp_path)


def test_images_and_labels_must_be_as_many(tmp_path: Path) -> None:
    write_mnist(tmp_path)
    (tmp_path / f"{NAMES[1]}.gz").write_bytes(gzip.compress(idx_bytes(np.zeros(29))))
    with pytest.raises(DataDamagedError, match="30 training images, but 29 training labels"):
        load("mnist", data_dir=tmp_path)


@pytest.mark.usefixtures("made_official")
@pytest.mark.parametrize("kind", ["python", "binary"])
@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda f: {k: v for k, v in f.items() if "batch_2" not in k}, "lacks data_batch_2"),
        (lambda f: {**f, next(k for k in f if "batch_4" in k): b"\x80\x02xyz"}, "data_batch_4"),
        (lambda f: {k: truncated(v) for k, v in f.items()}, "data_batch_1"),
    ],
)
def test_damaged_batches_are_refused_by_name(
    tmp_path: Path,
    kind: str,
    damage: Callable[[dict[str, bytes]], dict[str, bytes]],
    reason: str,
) -> None:
    archive = tmp_path / "cifar-10.tar"
    archive.write_bytes(tar_bytes(damage(cifar_files(kind))))
    with pytest.raises(DataDamagedError, match=reason) as caught:
        load("cifar10", data_dir=tmp_path)
    assert str(archive) in str(caught.value)


@pytest.mark.parametrize("pack", [gzip.compress, lzma.compress, bz2.compress])
def test_truncated_archive_is_refused(tmp_path: Path, pack: Callable[[bytes], bytes]) -> None:
    content = pack(tar_bytes(cifar_files("python")))
    for size in (0, 1, 100, len(content) // 2, len(content) - 3):
        (tmp_path / "cifar-10-python.tar.gz").write_bytes(content[:size])
        with pytest.raises(DataDamagedError, match=r"cifar-10-python\.tar\.gz"):
            load("cifar10", data_dir=tmp_path)


@pytest.mark.parametrize("task", ["mnist", "fashion-mnist", "cifar10"])
def test_missing_files_are_named(tmp_path: Path, task: str) -> None:
    wanted = "cifar-10-python.tar.gz" if task == "cifar10" else "train-images-idx3-ubyte"
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(DataMissingError) as caught:
            load(task, data_dir=folder)
        for part in (task, str(folder), wanted):
            assert part in str(caught.value)
    with pytest.raises(
        InputError,
        match=f"--data-dir FOLDER, .* aerofed data fetch FOLDER --task {task}",
    ):
        load(task, data_dir=None)


def test_one_file_of_four_missing(tmp_path: Path) -> None:
    write_mnist(tmp_path)
    (tmp_path / f"{NAMES[3]}.gz").unlink()
    with pytest.raises(DataMissingError, match=NAMES[3]):
        load("mnist", data_dir=tmp_path)


NPZ: dict[str, Any] = {
    "x_train": rng(1).integers(0, 256, (40, 12, 12, 3)).astype(np.uint8),
    "y_train": np.arange(40)[:, None] % 4,
    "x_test": rng(2).integers(0, 256, (12, 12, 12, 3)).astype(np.uint8),
    "y_test": np.arange(12)[:, None] % 4,
}


def test_npz_with_splits(tmp_path: Path) -> None:
    np.savez(tmp_path / "mine.npz", **NPZ)
    dataset = load("npz", data_dir=tmp_path, data_file="mine.npz")
    np.testing.assert_array_equal(dataset.train.images, NPZ["x_train"])
    np.testing.assert_array_equal(dataset.validation.labels, NPZ["y_test"][:, 0])
    assert dataset.classes == 4
    sum_of_file = hashlib.md5((tmp_path / "mine.npz").read_bytes()).hexdigest()
    assert dataset.provenance == Provenance(
        str(tmp_path / "mine.npz"), False, (SourceFile("mine.npz", sum_of_file, official=False),)
    )


def test_npz_without_splits_holds_out_a_sixth_of_every_class(tmp_path: Path) -> None:
    images = rng(3).random((120, 9, 9)).astype(np.float32)
    labels = np.arange(120) % 5
    np.savez(tmp_path / "mine.npz", images=images, labels=labels)
    dataset = load("npz", data_dir=tmp_path, data_file="mine.npz")
    assert np.bincount(dataset.validation.labels).tolist() == [4] * 5
    assert np.bincount(dataset.train.labels).tolist() == [20] * 5
    together = np.concatenate([dataset.train.images, dataset.validation.images])[..., 0]
    assert {i.tobytes() for i in together} == {i.tobytes() for i in images}
    again = load("npz", data_dir=tmp_path, data_file="mine.npz")
    np.testing.assert_array_equal(dataset.train.images, again.train.images)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"x_train": NPZ["x_train"].transpose(0, 3, 1, 2)}, r"x_train is \(40, 3, 12, 12\)"),
        ({"x_train": NPZ["x_train"].astype(np.int32)}, "of type int32"),
        ({"x_train": NPZ["x_train"].astype(np.float64)}, r"outside \[0, 1\]"),
        ({"y_train": NPZ["y_train"].astype(np.float64)}, "y_train is float64"),
        ({"y_train": NPZ["y_train"] - 1}, "training label -1"),
        ({"y_train": NPZ["y_train"][:-1]}, "40 training images, but 39"),
        ({"x_test": NPZ["x_test"][:, 1:]}, r"validation images of \(11, 12, 3\)"),
        ({"x_test": NPZ["x_test"][:0], "y_test": NPZ["y_test"][:0]}, "no validation images"),
        ({"y_train": np.array([{}] * 40, dtype=object)}, "npz: "),
    ],
)
def test_npz_that_does_not_fit(tmp_path: Path, change: dict[str, Any], reason: str) -> None:
    np.savez(tmp_path / "mine.npz", **{**NPZ, **change})
    with pytest.raises(DataDamagedError, match=reason) as caught:
        load("npz", data_dir=tmp_path, data_file="mine.npz")
    assert "mine.npz" in str(caught.value)


def test_npz_damaged_or_something_else(tmp_path: Path) -> None:
    path = tmp_path / "mine.npz"
    with pytest.raises(DataMissingError, match=r"mine\.npz"):
        load("npz", data_dir=tmp_path, data_file="mine.npz")
    np.savez(path, **NPZ)
    whole = path.read_bytes()
    np.save(tmp_path / "plain.npy", NPZ["x_train"])
    for content in (
        b"", whole[: len(whole) // 2], b"hello", (tmp_path / "plain.npy").read_bytes(),
        whole[:300] + bytes((whole[300] ^ 255,)) + whole[301:],
    ):  # fmt: skip
        path.write_bytes(content)
        with pytest.raises(DataDamagedError, match=r"mine\.npz"):
            load("npz", data_dir=tmp_path, data_file="mine.npz")
    np.savez(path, other=np.zeros(3))
    with pytest.raises(
        DataDamagedError, match=r"holds the arrays other; wanted are x_train, y_train"
    ):
        load("npz", data_dir=tmp_path, data_file="mine.npz")


def test_small_real_data(shared_data: Path) -> None:
    mnist = load("mnist", data_dir=shared_data / "small")
    assert (len(mnist.train.labels), len(mnist.validation.labels)) == (6000, 1000)
    assert not mnist.provenance.official
    cifar = load("cifar10", data_dir=shared_data / "small")
    assert cifar.train.images.shape == (5000, 32, 32, 3)
    assert np.bincount(cifar.train.labels).tolist() == [500] * 10


def test_official_mnist_is_recognised_and_not_taken_for_another(
    shared_data: Path, tmp_path: Path
) -> None:
    mnist = load("mnist", data_dir=shared_data / "full")
    assert mnist.provenance.official
    assert mnist.train.images.shape == (60_000, 28, 28, 1)
    for path in (shared_data / "full" / "mnist").iterdir():
        (tmp_path / path.name).symlink_to(path)
    with pytest.raises(DataDamagedError, match="this is the file of mnist, not of fashion-mnist"):
        load("fashion-mnist", data_dir=tmp_path)


@pytest.mark.slow
def test_official_cifar_is_recognised_however_it_is_packed(shared_data: Path) -> None:
    cifar = load("cifar10", data_dir=shared_data / "full")
    assert cifar.provenance.official
    assert np.bincount(cifar.train.labels).tolist() == [5000] * 10
    assert cifar.train.images[0, 0, 0].tolist() == [59, 62, 63]  # of the frog that comes first
