"""`aerofed data`: what is found in a folder, and fetching over a real connection."""

import gzip
import http.server
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fl.data import fetch as fetching
from fl.data.idx import NAMES
from mission.cli import call


def test_check_says_what_is_there(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(shared_data / "small" / "mnist", tmp_path / "mnist")
    assert call(["data", "check", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("mnist: intact: ")
    assert "6000 training" in lines[0]
    assert [line.split(": ")[1] for line in lines[1:]] == ["missing", "missing"]
    assert call(["data", "check", str(tmp_path), "--task", "mnist", "cifar10"]) == 2


def test_check_names_the_damaged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in NAMES:
        (tmp_path / f"{name}.gz").write_bytes(gzip.compress(b"no images at all"))
    assert call(["data", "check", str(tmp_path), "--task", "mnist"]) == 2
    printed = capsys.readouterr().out
    assert "mnist: damaged: " in printed
    assert ".gz" in printed


def test_check_of_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["data", "check", str(tmp_path / "nothing")]) == 2
    assert "no such folder" in capsys.readouterr().err


def test_check_of_a_file_says_that_a_folder_is_wanted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "train.gz").touch()
    assert call(["data", "check", str(tmp_path / "train.gz")]) == 2
    said = capsys.readouterr().err
    assert "train.gz: is a file; a data folder is wanted" in said
    assert said.rstrip().endswith(f"aerofed data check {tmp_path}")


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A web server on the loopback address, whose folder stands for MNIST's official location."""
    folder = tmp_path / "www"
    folder.mkdir()

    class Handler(http.server.SimpleHTTPRequestHandler):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, directory=str(folder), **kwargs)

        def log_message(self, *_: object) -> None: ...

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as web:
        thread = threading.Thread(target=web.serve_forever)
        thread.start()
        address = f"http://127.0.0.1:{web.server_port}/"
        monkeypatch.setattr(
            fetching.fetch,
            "__kwdefaults__",
            {**(fetching.fetch.__kwdefaults__ or {}), "locations": {"mnist": address}},
        )
        yield folder
        web.shutdown()
        thread.join()


def test_fetch_keeps_only_what_has_the_official_sum(
    server: Path, shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in (shared_data / "full" / "mnist").iterdir():
        shutil.copyfile(path, server / path.name)
    data = tmp_path / "data"
    assert call(["data", "fetch", str(data), "--task", "mnist"]) == 0
    assert len(capsys.readouterr().out.split()) == 4
    assert call(["data", "check", str(data), "--task", "mnist"]) == 0
    assert "mnist: official" in capsys.readouterr().out
    (server / "t10k-labels-idx1-ubyte.gz").write_bytes(gzip.compress(b"another file"))
    (data / "mnist" / "t10k-labels-idx1-ubyte.gz").unlink()
    assert call(["data", "fetch", str(data), "--task", "mnist"]) == 5
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1
    assert "t10k-labels-idx1-ubyte.gz" in errors
    assert "checksum" in errors
    assert not (data / "mnist" / "t10k-labels-idx1-ubyte.gz").exists()


def test_fetch_without_the_file(
    server: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    del server
    assert call(["data", "fetch", str(tmp_path / "data"), "--task", "mnist"]) == 5
    assert "404" in capsys.readouterr().err
