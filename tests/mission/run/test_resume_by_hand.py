"""Whether a run can go on, by the header of its checkpoint: each thing that may differ."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from mission.base.errors import InputError
from mission.run import resume
from mission.run.resume import header, other_code, read_checkpoint, sealed

TEXT = 'name = "a"\nrounds = 12\nworkers = 3\n'


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(resume, "library_versions", lambda: {"aerofed": "1.2", "numpy": "3.4"})
    folder = tmp_path / "run"
    (folder / "checkpoint").mkdir(parents=True)
    (folder / "config.toml").write_text(TEXT)
    keep(folder)
    return folder


def keep(folder: Path, **changed: Any) -> None:
    values = {**header(TEXT, None, {}), "more": [1, 2], **changed}
    (folder / "checkpoint" / "rounds.json").write_bytes(sealed(values))


def refused(folder: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_checkpoint(folder)
    return str(caught.value)


def test_a_header(run: Path, tmp_path: Path) -> None:
    plain = hashlib.sha256(b'name = "a"\n\nworkers = 3\n').hexdigest()  # without the rounds
    found = header(TEXT, tmp_path / "x" / "..", {"m:f": "abc", "m:g": None}, faults=True)
    assert found == {
        "faults": True,
        "format": 5,
        "config_sha256": plain,
        "data_dir": str(tmp_path.resolve()),
        "libraries": {"aerofed": "1.2", "numpy": "3.4"},
        "plugins": {"m:f": "abc", "m:g": None},
    }
    assert header(TEXT, None, {})["data_dir"] is None
    assert read_checkpoint(run) == {**header(TEXT, None, {}), "more": [1, 2]}
    (run / "config.toml").write_text(TEXT.replace("12", "400"))
    assert read_checkpoint(run)["more"] == [1, 2]  # a run may be lengthened
    for other in ("rounds = 12 # or so", "rounds = -12", "all_rounds = 12"):
        (run / "config.toml").write_text(TEXT.replace("rounds = 12", other))
        assert "cannot be resumed: its config.toml was changed; the run would" in refused(run)


def test_a_seal() -> None:
    values: dict[str, object] = {"b": [1.5, None], "a": "x"}
    digest = hashlib.sha256(json.dumps(values).encode()).hexdigest()
    assert json.loads(sealed(values)) == {**values, "sha256": digest}
    assert "sha256" not in values


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"libraries": 3}, ": its checkpoint does not say what wrote it;"),
        (
            {"format": 4, "libraries": {"aerofed": "0.9"}},
            ": its checkpoint is of format 4, written by aerofed 0.9, and this is aerofed 1.2,"
            " which reads format 5;",
        ),
        ({"format": 6, "libraries": {}}, "of format 6, written by aerofed ?, and this"),
        (
            {"libraries": {"numpy": "3.3", "scipy": "1", "aerofed": "1.2"}},
            ": versions of libraries differ: numpy was 3.3, is 3.4, scipy was 1, is None;",
        ),
        ({"plugins": {"json:dumps": "f" * 64}}, "the code of plug-in 'json:dumps', or of what"),
        ({"plugins": {"json:dumps": None}}, "nothing tells whether plug-in 'json:dumps' is the"),
        ({"plugins": {"python:f_12345678": "f" * 64}}, "nothing tells whether plug-in 'python:"),
        ({"plugins": {"nowhere_at_all:f": "f" * 64}}, "here: plug-in 'nowhere_at_all:f' cannot be"),
    ],
)
def test_what_differs(run: Path, changed: dict[str, Any], words: str) -> None:
    keep(run, **changed)
    assert words in refused(run)


def test_what_is_no_checkpoint_any_more(run: Path) -> None:
    file = run / "checkpoint" / "rounds.json"
    whole = json.loads(file.read_bytes())
    edited = {**whole, "more": [1, 3]}
    for content, words in {
        "{": "not valid JSON, so it was changed or cut short",
        "[]": "not what aerofed run writes",
        json.dumps({k: v for k, v in whole.items() if k != "data_dir"}): "not what aerofed run",
        json.dumps(edited): "its checksum differs, so it was changed or cut short",
        json.dumps({k: v for k, v in whole.items() if k != "sha256"}): "its checksum differs",
        json.dumps({k: whole[k] for k in ("format", "config_sha256", "data_dir", "libraries")}): (
            "its checksum differs"
        ),
        # What has no seal is of an older format, which is said.
        json.dumps({**edited, "format": 4}): "its checkpoint is of format 4",
    }.items():
        file.write_text(content)
        assert words in refused(run)
    file.write_text("{")
    assert refused(run) == (
        f"{file}: damaged: not valid JSON, so it was changed or cut short; the run cannot go on: "
        f"begin it anew in another folder, aerofed run {run / 'config.toml'}"
    )


def test_code_then_and_now() -> None:
    assert other_code("m:f", "a" * 64, "a" * 64) == ""
    assert "(SHA-256 aaaaaaaa, now bbbbbbbb)" in other_code("m:f", "a" * 64, "b" * 64)
    for then, now in ((None, "a"), ("a", None), (None, None)):
        assert other_code("m:f", then, now).startswith("nothing tells whether plug-in 'm:f'")


def test_what_is_no_folder_of_a_run(run: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    assert refused(other) == f"{other}: no such folder"
    assert refused(run / "config.toml").endswith("a file; give the folder that aerofed run left")
    assert f"it is the checkpoint itself; give {run}" in refused(run / "checkpoint")
    other.mkdir()
    (other / "a.txt").touch()
    assert refused(other).endswith("left: it has no checkpoint/rounds.json")
    (other / "sweep.json").touch()
    assert "it holds a sweep, which goes on when the same" in refused(other)
