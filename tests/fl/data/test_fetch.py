"""Downloads over real HTTP from a server on this machine; checks of real folders."""

import gzip
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from fl.data.fetch import LOCATIONS, check, fetch
from fl.data.idx import NAMES
from fl.errors import FetchError, SettingError


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def site(tmp_path: Path) -> Iterator[tuple[Path, str]]:
    """A folder and the address under which it is served."""
    folder = tmp_path / "site"
    folder.mkdir()
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder))) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield folder, f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()
        thread.join()


def test_official_files_are_fetched_once_and_recognised(
    site: tuple[Path, str], shared_data: Path, tmp_path: Path
) -> None:
    folder, address = site
    for path in (shared_data / "full" / "mnist").iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    data = tmp_path / "data"
    steps: list[tuple[str, int, int | None]] = []
    paths = fetch(
        "mnist", data, locations={"mnist": address}, progress=lambda *step: steps.append(step)
    )
    assert [path.name for path in paths] == [f"{name}.gz" for name in NAMES]
    assert steps[-1][1] == steps[-1][2] == paths[-1].stat().st_size
    assert check(data, tasks=("mnist",))[0].status == "official"
    for path in folder.iterdir():
        path.unlink()  # nothing is asked for again
    assert fetch("mnist", data, locations={"mnist": address}) == paths


def test_a_file_with_another_checksum_is_not_kept(site: tuple[Path, str], tmp_path: Path) -> None:
    folder, address = site
    for content in (gzip.compress(b"something else"), b"<html>moved</html>", b""):
        (folder / f"{NAMES[0]}.gz").write_bytes(content)
        with pytest.raises(FetchError, match=r"train-images-idx3-ubyte\.gz: .* checksum"):
            fetch("mnist", tmp_path / "data", locations={"mnist": address})
        assert list((tmp_path / "data" / "mnist").iterdir()) == []


def test_an_answer_that_is_no_file(site: tuple[Path, str], tmp_path: Path) -> None:
    _, address = site
    with pytest.raises(FetchError, match="the server answers 404"):
        fetch("cifar10", tmp_path, locations={"cifar10": address})


def test_no_network_is_said_plainly(tmp_path: Path) -> None:
    for address in ("http://127.0.0.1:1/", "http://no-such-host.invalid/"):
        with pytest.raises(FetchError, match="is there a network") as caught:
            fetch("mnist", tmp_path, locations={"mnist": address})
        assert address in str(caught.value)
        assert "\n" not in str(caught.value)


def test_unknown_task_and_unwritable_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SettingError, match="'digits': can be fetched: mnist, fashion-mnist"):
        fetch("digits", tmp_path)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(SettingError, match="cannot be written"):
        fetch("mnist", tmp_path / "file")
    (tmp_path / "mnist").mkdir()

    def no_room(**_: object) -> tuple[int, str]:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.mkstemp", no_room)
    with pytest.raises(FetchError, match=r"cannot be stored as .*mnist/.*: Permission denied"):
        fetch("mnist", tmp_path)


def test_check_says_what_a_folder_holds(shared_data: Path, tmp_path: Path) -> None:
    small = {found.task: found for found in check(shared_data / "small")}
    assert small["mnist"].status == "intact"
    assert "6000 training" in small["mnist"].detail
    assert small["fashion-mnist"].status == "missing"
    assert small["cifar10"].status == "intact"
    (tmp_path / "cifar-10-python.tar.gz").write_bytes(b"\x1f\x8bnot a tar")
    found = {f.task: f.status for f in check(tmp_path)}
    assert found == {"mnist": "missing", "fashion-mnist": "missing", "cifar10": "damaged"}


def test_every_location_is_a_folder_on_the_web() -> None:
    for address in LOCATIONS.values():
        assert address.startswith(("https://", "http://"))
        assert address.endswith("/")
