"""Data files that somebody has made to do harm: one line, no crash, bounded memory."""

import gzip
import pickle
import pickletools
import struct
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fl.config import CommunityConfig
from fl.data import cifar, idx
from fl.data.batch_pickle import BatchPickleError, load_batch
from fl.data.bounded import LARGEST_BYTES
from fl.data.load import load
from fl.errors import DataDamagedError

GOOD = {"data": np.arange(2 * 3072, dtype=np.uint8).reshape(2, 3072), "labels": [3, 7]}


@pytest.mark.parametrize("protocol", range(5))
def test_every_protocol_is_read_as_python_reads_it(protocol: int) -> None:
    batch = {**GOOD, "batch_label": "one", "filenames": ["a.png", "b.png"]}
    found = load_batch(pickle.dumps(batch, protocol=protocol))
    np.testing.assert_array_equal(found.pop("data"), GOOD["data"])
    assert found == {k: v for k, v in batch.items() if k != "data"}


def test_bytes_made_pointers_by_a_data_type_without_its_object_flag() -> None:
    """What crashed the interpreter: numpy's own state of a dtype says that bytes are objects."""
    state = (3, "|", None, None, None, -1, -1, 0)  # flags 0: "no objects", of dtype O8

    class Forged:
        def __reduce__(self) -> tuple[object, ...]:
            return (np.dtype, ("O8", False, True), state)

    class Image:
        def __reduce__(self) -> tuple[object, ...]:
            raw = b"\x41" * 16
            reduced: Any = np.empty(0, np.int8).__reduce__()
            reconstruct, empty, _ = reduced
            return (reconstruct, empty, (1, (2,), Forged(), False, raw))

    content = pickle.dumps({"data": Image(), "labels": [1, 2]}, protocol=2)
    with pytest.raises(DataDamagedError, match="no array of bytes"):
        cifar.decode_python(content, path="batch")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"\x80\x04r\xff\xff\xff\xff.", "damaged"),  # a memo of 4e9 places
        (b"\x80\x02" + b")" * 100_000 + b"\x85" * 100_000 + b"\x85}\x86.", "no table"),
        (b"\x80\x02}N\x85" + b"2\x86" * 90 + b"Ns.", "no place"),  # a key of 2^90 parts
        (b"\x80\x04\x8b" + struct.pack("<i", 1 << 30) + b"\1.", "damaged"),
        (b"\x80\x02cos\nsystem\n(U\x04true\x85R.", "os.system has no place"),
        (b"\x80\x02cnumpy\ndtype\n)\x81.", "NEWOBJ has no place"),
        (b"(" * 200_000 + b"t" * 200_000 + b".", "no table"),
        (b"(t" * 500_000 + b".", "no table"),
        (b"", "damaged"),
    ],
)  # fmt: skip
def test_programs_that_a_batch_is_not(content: bytes, reason: str) -> None:
    with pytest.raises(BatchPickleError, match=reason):
        load_batch(content)


def test_labels_of_any_size_are_refused() -> None:
    for label in (-1, 256, 1 << 70):
        with pytest.raises(DataDamagedError, match="do not fit into bytes"):
            cifar.decode_python(pickle.dumps({**GOOD, "labels": [1, label]}, 2), path="batch")


OPCODES = st.sampled_from([op.code.encode("latin-1") for op in pickletools.opcodes])


@settings(max_examples=300, deadline=None)
@given(st.lists(OPCODES | st.binary(max_size=6), max_size=60), st.integers(0, 4))
def test_any_program_is_a_batch_or_refused(parts: list[bytes], protocol: int) -> None:
    whole = pickle.dumps(GOOD, protocol=protocol)
    for content in (b"".join(parts), whole[: len(whole) // 2] + b"".join(parts)):
        refused = ""
        try:
            pixels, labels = cifar.decode_python(content, path="batch")
        except DataDamagedError as error:
            refused = str(error)
        assert refused or pixels.shape == (len(labels), 3072)
        assert "\n" not in refused


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_a_batch_with_bytes_changed_is_a_batch_or_refused(data: st.DataObject) -> None:
    content = bytearray(pickle.dumps(GOOD, protocol=data.draw(st.integers(0, 4))))
    places = [*range(120), *range(len(content) - 60, len(content))]
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.sampled_from(places))] = data.draw(st.integers(0, 255))
    try:
        pixels, labels = cifar.decode_python(bytes(content), path="batch")
    except DataDamagedError:
        return
    assert pixels.dtype == np.uint8
    assert pixels.shape == (len(labels), 3072)


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
