"""Data files that somebody has made to do harm: one line, no crash, bounded memory."""

import gzip
import os
import struct
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fl.config import CommunityConfig
from fl.data import idx, npz
from fl.data.files import LARGEST_BYTES
from fl.data.load import load
from fl.errors import DataDamagedError

BOMB = r"""
import sys
from pathlib import Path
from fl.data.load import load
from fl.errors import DataDamagedError
try:
    load(sys.argv[1], data_dir=Path(sys.argv[2]), data_file=sys.argv[3] or None)
except DataDamagedError as error:
    print(error)
# Not ru_maxrss: that begins with what the process had before it became this program.
print(int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]) // 1024)
"""


def unpack_bomb(task: str, folder: Path, file: str = "") -> tuple[str, int]:
    """What is said of the data, and the greatest memory (MiB) of the process that read them."""
    done = subprocess.run(
        [sys.executable, "-c", BOMB, task, folder, file], capture_output=True, text=True, check=True
    )
    said, peak = done.stdout.splitlines()
    return said, int(peak)


def zeros(path: Path, head: bytes, mebibytes: int) -> None:
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.write(head)
        for _ in range(mebibytes):
            file.write(bytes(1 << 20))


@pytest.mark.slow
def test_a_gzip_bomb_is_not_unpacked(tmp_path: Path) -> None:
    """600 MB behind a header that promises 30 images."""
    zeros(tmp_path / f"{idx.NAMES[0]}.gz", struct.pack(">BBBBIII", 0, 0, 8, 3, 30, 28, 28), 600)
    said, peak = unpack_bomb("mnist", tmp_path)
    assert "promises 30x28x28 = 23520 bytes, more follow" in said
    assert peak < 400


def test_a_header_that_promises_too_much(tmp_path: Path) -> None:
    head = struct.pack(">BBBBIII", 0, 0, 8, 3, 2**32 - 1, 2**16, 2**16)
    zeros(tmp_path / f"{idx.NAMES[0]}.gz", head, 1)
    said, _ = unpack_bomb("mnist", tmp_path)
    assert f"at most {LARGEST_BYTES} are read" in said


def test_an_archive_with_a_name_of_many_gigabytes(tmp_path: Path) -> None:
    """A GNU long name is read into memory whole, whatever its size."""
    block = bytearray(512)
    block[:14] = b"././@LongLink\0"
    block[124:136] = b"77777777777\0"  # 8 GiB
    block[156:157] = b"L"
    block[257:265] = b"ustar  \0"
    block[148:156] = b"%06o\0 " % (sum(block) + 8 * 32)
    zeros(tmp_path / "cifar-10-python.tar.gz", bytes(block), 50)
    said, peak = unpack_bomb("cifar10", tmp_path)
    assert "cifar-10-python.tar.gz" in said
    assert peak < 400


class RunsCode:
    """Unpickled, it makes a folder."""

    def __init__(self, path: Path) -> None:
        self.path = str(path)

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (self.path,)


@pytest.mark.parametrize("array", ["images", "labels", "owner"])
def test_a_pickle_in_an_npz_is_not_run(tmp_path: Path, array: str) -> None:
    mine: dict[str, Any] = {
        "images": np.zeros((6, 2, 2), np.uint8),
        "labels": np.arange(6) % 2,
        array: np.array([RunsCode(tmp_path / "ran")] * 6),
    }
    np.savez(tmp_path / "mine.npz", allow_pickle=True, **mine)
    with pytest.raises(DataDamagedError, match="Object arrays cannot be loaded"):
        load("npz", data_dir=tmp_path, data_file="mine.npz")
    assert not (tmp_path / "ran").exists()


def test_an_npz_of_just_as_much_as_is_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two members with headers of 128 bytes: 24 images of a byte, 12 labels of eight."""
    path = tmp_path / "mine.npz"
    np.savez(path, images=np.zeros((12, 2, 1), np.uint8), labels=np.arange(12) % 2)
    monkeypatch.setattr(npz, "LARGEST_BYTES", 2 * 128 + 24 + 96)
    assert npz.load("mine.npz", tmp_path).classes == 2
    monkeypatch.setattr(npz, "LARGEST_BYTES", 2 * 128 + 24 + 95)
    with pytest.raises(DataDamagedError, match="unpacks to 376 bytes; at most 375"):
        npz.load("mine.npz", tmp_path)


def test_an_npz_that_unpacks_to_too_much(tmp_path: Path) -> None:
    path = tmp_path / "mine.npz"
    np.savez(path, images=np.zeros((4, 2, 2), np.uint8), labels=np.zeros(4, np.int64))
    content = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        size = archive.infolist()[0].file_size
    # The size in the central directory, which is what is believed when unpacking.
    path.write_bytes(content.replace(struct.pack("<II", size, size), b"\xfe\xff\xff\xff" * 2))
    with pytest.raises(DataDamagedError, match="unpacks to"):
        load("npz", data_dir=tmp_path, data_file="mine.npz")


def test_classes_by_the_billion(tmp_path: Path) -> None:
    np.savez(
        tmp_path / "mine.npz",
        images=np.zeros((2, 2, 2), np.uint8),
        labels=np.array([0, 2**64 - 1], np.uint64),
    )
    with pytest.raises(DataDamagedError, match="a label 18446744073709551615; at most 65535"):
        load("npz", data_dir=tmp_path, data_file="mine.npz")


@pytest.mark.parametrize("name", ["../mine.npz", "a/../../mine.npz", ".."])
def test_data_file_stays_in_the_folder(name: str) -> None:
    with pytest.raises(ValueError, match="stays in the data folder"):
        CommunityConfig(name="a", task="npz", data_file=name)


def test_data_file_elsewhere_is_given_openly(tmp_path: Path) -> None:
    given = str(tmp_path / "mine.npz")
    assert CommunityConfig(name="a", task="npz", data_file=given).data_file == given
    np.savez(given, features=np.zeros((12, 2)), labels=np.arange(12) % 2)
    for data_dir in (None, tmp_path / "other"):
        assert load("npz", data_dir=data_dir, data_file=given).classes == 2
