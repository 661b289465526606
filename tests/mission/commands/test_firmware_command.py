"""`aerofed firmware`: real HTTP from a server on this machine, in place of the project's own."""

import hashlib
import resource
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from mission.cli import call

CONTENT = b"\x7fELF ArduCopter V4.6.3" + bytes(100_000)
SUM = hashlib.sha256(CONTENT).hexdigest()


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of the published file 4.6.3; the address is in the environment."""
    folder = tmp_path / "site" / "Copter" / "stable-4.6.3" / "SITL_x86_64_linux_gnu"
    folder.mkdir(parents=True)
    (folder / "arducopter").write_bytes(CONTENT)
    handler = partial(Quiet, directory=str(tmp_path / "site"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        address = f"http://127.0.0.1:{server.server_address[1]}"
        monkeypatch.setenv("AEROFED_FIRMWARE_SITE", address)
        yield folder
        server.shutdown()
        thread.join()


def fetch(*more: str) -> int:
    return call(["firmware", "fetch", "arducopter", "--version", "4.6.3", *more])


def test_a_version_is_fetched_once_may_be_run_and_is_listed(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cache" / "aerofed" / "firmware" / "arducopter-4.6.3" / "arducopter"
    for _ in range(2):
        assert fetch() == 0
        assert capsys.readouterr().out == f"sha256 {SUM}\nexport AEROFED_ARDUCOPTER={path}\n"
        assert path.read_bytes() == CONTENT
        assert path.stat().st_mode & 0o777 == 0o755
        (site / "arducopter").unlink(missing_ok=True)  # nothing is asked for again
    assert call(["firmware", "list"]) == 0
    assert capsys.readouterr().out == f"arducopter-4.6.3: {path}: as fetched\n"
    path.write_bytes(b"something else")
    assert call(["firmware", "list"]) == 0
    assert capsys.readouterr().out == f"arducopter-4.6.3: {path}: changed since it was fetched\n"
    # What is published under the same name later is not what was fetched first.
    (site / "arducopter").write_bytes(CONTENT + b"!")
    assert fetch() == 5
    assert f"wanted is {SUM}" in capsys.readouterr().err
    assert path.read_bytes() == b"something else"


@pytest.mark.usefixtures("site")
def test_only_the_checksum_that_is_asked_for_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "here"
    assert fetch("--folder", str(folder), "--sha256", "0" * 64) == 5
    error = capsys.readouterr().err
    assert f"its checksum is {SUM}, wanted is {'0' * 64}" in error
    assert error.count("\n") == 1
    assert list((folder / "arducopter-4.6.3").iterdir()) == []
    assert fetch("--folder", str(folder), "--sha256", SUM) == 0
    assert call(["firmware", "list", "--folder", str(folder)]) == 0


@pytest.mark.parametrize(
    ("more", "code", "words"),
    [
        (("--version", "9.9.9"), 5, "arducopter: not fetched: the server answers 404"),
        (("--version", "../x"), 2, "--version ../x: such as 4.6.3, or stable, beta, latest"),
        (("--sha256", "abc"), 2, "--sha256 abc: must be 64 hexadecimal digits"),
        (
            ("--site", "http://127.0.0.1:1/"),
            5,
            "not fetched: Connection refused; is there a network?",
        ),
    ],
)
def test_what_cannot_be_fetched_is_said_in_a_line(
    site: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], code: int, words: str
) -> None:
    assert site.is_dir()
    version = () if "--version" in more else ("--version", "4.6.3")
    assert call(["firmware", "fetch", "arducopter", *version, *more]) == code
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_what_is_no_arducopter_is_not_kept(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (site / "arducopter").write_text("<html>moved</html>")
    assert fetch() == 2
    assert "what is there is not ArduCopter" in capsys.readouterr().err
    assert not list((tmp_path / "cache").rglob("arducopter"))


@pytest.mark.usefixtures("site")
def test_a_full_disk_and_a_file_in_the_way_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, hard))
    try:
        code = fetch()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert code == 5
    assert "cannot be stored as" in capsys.readouterr().err
    assert not list((tmp_path / "cache").rglob("*arducopter"))[1:]
    (tmp_path / "file").write_text("")
    assert fetch("--folder", str(tmp_path / "file")) == 2
    assert "file/arducopter-4.6.3/arducopter: cannot be written: " in capsys.readouterr().err


def test_nothing_fetched_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "build" / "arducopter").mkdir(parents=True)  # a folder of that name is none
    assert call(["firmware", "list", "--folder", str(tmp_path)]) == 2
    assert "holds no firmware; aerofed firmware fetch arducopter" in capsys.readouterr().err


def test_what_is_stable_is_the_newest_of_that(site: Path, tmp_path: Path) -> None:
    published = site.parents[1] / "stable" / site.name
    published.mkdir(parents=True)
    path = tmp_path / "cache" / "aerofed" / "firmware" / "arducopter-stable" / "arducopter"
    for newer in (CONTENT, CONTENT + b"!"):
        (published / "arducopter").write_bytes(newer)
        assert call(["firmware", "fetch", "arducopter"]) == 0
        assert path.read_bytes() == newer


@pytest.mark.usefixtures("site")
def test_a_site_that_is_no_address_and_a_checksum_that_is_no_text(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fetch("--site", "nonsense") == 2
    assert "nonsense: must begin with https:// or http://" in capsys.readouterr().err
    assert fetch() == 0
    (tmp_path / "cache/aerofed/firmware/arducopter-4.6.3/arducopter.sha256").write_bytes(b"\xff")
    assert call(["firmware", "list"]) == 0
    assert "changed since it was fetched" in capsys.readouterr().out
