"""What a user names is no file, too large, or nested too deep: one line for every kind of file."""

import os
import zipfile
from pathlib import Path

import pytest

from mission.base.errors import InputError
from mission.base.user_files import parse_json, parse_toml, read_bytes, read_text
from mission.cli import call

RUN = ["run", "quickstart", "--rounds", "1", "--no-report"]
READERS = {
    "configuration.toml": ["run", "{}"],
    "places.csv": [*RUN, "--set", "communities.0.positions_file={}"],
    "zones.geojson": [*RUN, "--set", "area.no_fly_file={}"],
    "mine.plan": ["fly", "{}"],
    "mine.waypoints": ["fly", "{}"],
    "problems.json": ["plan", "{}"],
    "flight.mcap": ["log", "info", "{}"],
    "other.mcap": ["compare", "{}"],
    "data.npz": [*RUN, "--set", "communities.0.task=npz", "communities.0.data_file={}"],
    "parameters.txt": [*RUN, "--set", "vehicle.parameter_file={}"],
    "key.txt": [*RUN, "--set", "link.gcs=['udpout://127.0.0.1:1']", "link.signing_key={}"],
    "summary.json": ["report", "{}/.."],
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("kind", ["pipe", "zero", "folder"])
def test_only_regular_files_are_read(
    tmp_path: Path, name: str, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "zero":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    words = [word.format(path) for word in READERS[name]]
    if words[0] == "run":
        words += ["--out", str(tmp_path / "out"), "--data-dir", str(tmp_path)]
    assert call(words) == 2
    told = capsys.readouterr().err
    assert told.startswith("aerofed: ")
    assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_files_without_a_size_are_empty() -> None:
    """Such as those of /proc, which never end."""
    assert read_bytes(Path("/proc/self/environ")) == b""


def test_size_and_encoding(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"\xef\xbb\xbfabc")
    assert read_text(path) == "abc"
    with pytest.raises(InputError, match=f"^{path}: cannot be read: 6 bytes, 5 are allowed$"):
        read_bytes(path, most=5)
    path.write_bytes(b"\xff")
    with pytest.raises(InputError, match="not UTF-8 text; save it as UTF-8"):
        read_text(path)
    with pytest.raises(InputError, match="no name of a file"):
        read_text(Path("a\0b"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[" * 100_000, "nested too deep"),
        ("[" * 200 + "]" * 200, "nested deeper than 100"),
        ("1" * 5000, "Exceeds the limit"),
        ("1" * 400, "beyond 64 bits"),
        ("{", "Expecting"),
    ],
)
def test_json_within_bounds(text: str, said: str) -> None:
    with pytest.raises(InputError, match=f"^here: not valid JSON: .*{said}"):
        parse_json(text, "here")


@pytest.mark.parametrize(
    "text",
    [f"{'.'.join('a' * 2000)} = 1", f"a = {'[' * 5000}", f"a = {'1' * 5000}", f"a = {'1' * 400}"],
)
def test_toml_within_bounds(text: str) -> None:
    with pytest.raises(ValueError, match=r"nested|beyond 64 bits|Exceeds the limit"):
        parse_toml(text)


@pytest.mark.parametrize(
    "given", [f"{'.'.join('a' * 20_000)}=1", f"seed={'1' * 5000}", f"area={{{'a.' * 5000}a=1}}"]
)
def test_overrides_within_bounds(given: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call([*RUN, "--set", given]) == 2
    told = capsys.readouterr().err
    assert told.startswith("aerofed: command line: ")
    assert len(told) < 300


def test_a_member_of_an_npz_that_is_no_array(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with zipfile.ZipFile(tmp_path / "data.npz", "w") as archive:
        archive.writestr("images", b"hello")
        archive.writestr("labels", b"hello")
    words = [word.format("data.npz") for word in READERS["data.npz"]]
    assert call([*words, "--data-dir", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "images is no .npy file" in capsys.readouterr().err
