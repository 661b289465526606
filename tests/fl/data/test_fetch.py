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
from fl.errors import FetchError
from native.errors import SettingError


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


AMAZON = "http://fashion-mnist.s3-website.eu-central-1.amazonaws.com/"
IDX = (
    "train-images-idx3-ubyte", "train-labels-idx1-ubyte", "t10k-images-idx3-ubyte",
    "t10k-labels-idx1-ubyte",
)  # fmt: skip


def test_each_file_is_asked_for_where_it_is_kept_and_by_its_checksum(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, Path, str]] = []

    def download(url: str, path: Path, *, checksum: str, **_: object) -> None:
        asked.append((url, path.relative_to(tmp_path), checksum))

    monkeypatch.setattr("fl.data.fetch.download", download)
    for task in LOCATIONS:
        fetch(task, tmp_path)
    urls = [
        *(f"https://ossci-datasets.s3.amazonaws.com/mnist/{name}.gz" for name in IDX),
        *(f"{AMAZON}{name}.gz" for name in IDX),
        "https://www.cs.toronto.edu/~kriz/cifar-10-python.tar.gz",
    ]
    paths = [Path(task, f"{name}.gz") for task in ("mnist", "fashion-mnist") for name in IDX]
    assert [url for url, *_ in asked] == urls
    assert [path for _, path, _ in asked] == [*paths, Path("cifar10", "cifar-10-python.tar.gz")]
    # As CIFAR's page prints it; of MNIST the sums of the files as they were first published.
    sums = [checksum for *_, checksum in asked]
    assert sums[-1] == "c58f30108f718f92721af3b95e74349a"
    assert sums[:4] == [
        "6bbc9ace898e44ae57da46a324031adb", "a25bea736e30d166cdddb491f175f624",
        "2646ac647ad5339dbf082846283269ea", "27ae3e4e09519cfbb04c329615203637",
    ]  # fmt: skip
    assert len({*sums}) == 9
