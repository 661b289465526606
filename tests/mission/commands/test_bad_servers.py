"""`aerofed firmware fetch` from servers that answer what they should not, byte by byte."""

import hashlib
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from patience import HANG_S

from mission.cli import call

GOOD = b"\x7fELF ArduCopter V4.6.3" + bytes(50_000)
NEWER = GOOD + b"!"
LONG = b"a" * 70_000


@contextmanager
def serving(answer: bytes) -> Iterator[str]:
    """A server that sends `answer` to whoever calls, `{here}` being its address, and hangs up."""

    def serve() -> None:
        while True:
            try:
                client, _ = listening.accept()
            except OSError:
                return  # it is closed
            with client:
                clients.append(client)
                try:
                    client.settimeout(HANG_S)
                    client.recv(65536)
                    client.sendall(answer.replace(b"{here}", address.encode()))
                    client.shutdown(socket.SHUT_WR)
                    while client.recv(65536):  # until it has read what was sent
                        pass
                except OSError:
                    pass

    clients: list[socket.socket] = []
    with socket.create_server(("127.0.0.1", 0)) as listening:
        address = f"http://127.0.0.1:{listening.getsockname()[1]}"
        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield address
        finally:
            for each in (listening, *clients):
                with suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)
            thread.join()


def answer(*headers: bytes, body: bytes = NEWER, status: bytes = b"200 OK") -> bytes:
    return b"\r\n".join((b"HTTP/1.1 " + status, *headers, b"", body))


def sized(body: bytes, *headers: bytes, promised: int | None = None) -> bytes:
    length = len(body) if promised is None else promised
    return answer(b"Content-Length: %d" % length, *headers, body=body)


def moved(to: bytes, status: bytes = b"302 Found") -> bytes:
    return answer(b"Location: " + to, b"Content-Length: 0", body=b"", status=status)


CHUNKED = b"Transfer-Encoding: chunked"
CHUNK = b"%x\r\n%s\r\n" % (len(NEWER), NEWER)

# What the server answers, exit code, and words of the line that is printed.
BAD: dict[str, tuple[bytes, int, str]] = {
    "short": (
        sized(NEWER, promised=len(NEWER) + 9), 5,
        f"the server promised {len(NEWER) + 9} bytes and sent {len(NEWER)}",
    ),
    "far too short": (sized(b"", promised=10**18), 5, f"promised {10**18} bytes"),
    "endless promise": (sized(b"", promised=10**30), 5, "promised 1000000"),
    "chunks that break off": (answer(CHUNKED, body=CHUNK), 5, "IncompleteRead"),
    "a chunk that breaks off": (answer(CHUNKED, body=CHUNK[:-999]), 5, "IncompleteRead"),
    "chunks of no size": (answer(CHUNKED, body=b"zz\r\nabc\r\n0\r\n\r\n"), 5, "not fetched"),
    "an endless chunk": (answer(CHUNKED, body=LONG), 5, "not fetched"),
    "packed": (sized(b"\x1f\x8b\x08" + bytes(99), b"Content-Encoding: gzip"), 2, "not ArduCopter"),
    "a page": (sized(b"<html>moved</html>"), 2, "not ArduCopter"),
    "a page about it": (sized(b"<html>ArduCopter V4.6.3</html>"), 2, "not ArduCopter"),
    "a script": (sized(b"#!/bin/sh\nexit 0\n"), 2, "not ArduCopter"),
    "nothing": (sized(b""), 2, "not ArduCopter"),
    "no content": (answer(body=b"", status=b"204 No Content"), 5, "answers 204 No Content"),
    "a part": (answer(status=b"206 Partial Content"), 5, "answers 206 Partial Content"),
    "refused": (answer(status=b"403 Forbidden", body=b""), 5, "answers 403 Forbidden"),
    "a loop": (moved(b"{here}/again"), 5, "infinite loop"),
    "moved nowhere": (answer(status=b"302 Found", body=b""), 5, "answers 302"),
    "moved to no address": (moved(b"http://[half"), 5, "not fetched"),
    "moved to no port": (moved(b"http://127.0.0.1:99999/x"), 5, "not fetched"),
    "moved to a word as port": (moved(b"http://127.0.0.1:port/x"), 5, "not fetched"),
    "moved to a file": (moved(b"file:///etc/hostname"), 5, "not fetched"),
    "moved to a label": (moved(b"http://a..b/"), 5, "not fetched"),
    "moved to a long label": (moved(b"http://" + b"a" * 99 + b".org/"), 5, "not fetched"),
    "moved to odd letters": (moved(b"http://\xe4\xff/\xe4"), 5, "not fetched"),
    "no status": (b"\r\n\r\n", 5, "not fetched"),
    "another protocol": (b"SSH-2.0-OpenSSH_9.6\r\n", 5, "not fetched"),
    "a status in words": (answer(status=b"fine"), 5, "not fetched"),
    "a negative status": (answer(status=b"-200 OK"), 5, "not fetched"),
    "a huge status": (answer(status=b"99999 OK"), 5, "not fetched"),
    "an escaped status": (
        answer(status=b"404 \x1b[31mred\x07\x9b2J\rover", body=b""), 5,
        r"answers 404 \x1b[31mred\x07\x9b2J\rover",
    ),
    "an escape as protocol": (b"\x1b]0;title\x07 200 OK\r\n\r\n", 5, "not fetched"),
    "a long line": (answer(b"X: " + LONG), 5, "not fetched"),
    "many headers": (answer(*[b"X: y"] * 999), 5, "not fetched"),
    "hung up": (b"", 5, "not fetched"),
    "no TLS": (b"\x15\x03\x01\x00\x02\x02\x28", 5, "not fetched"),
}  # fmt: skip

# What is odd and may be read all the same.
FINE: dict[str, bytes] = {
    "whole": sized(NEWER),
    "without a length": answer(),
    "a length in words": answer(b"Content-Length: many"),
    "a negative length": answer(b"Content-Length: -7"),
    "in chunks": answer(CHUNKED, body=CHUNK + b"0\r\n\r\n"),
    "headers beyond ASCII": sized(NEWER, b"Server: \xe4\xff\x1b[31m", "X-ü: ü".encode()),
}


def fetched(site: str, *more: str, folder: Path, version: str = "stable") -> int:
    where = ("--site", site, "--folder", str(folder), "--version", version)
    return call(["firmware", "fetch", "arducopter", *where, *more])


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """A folder into which GOOD was fetched."""
    with serving(sized(GOOD)) as site:
        assert fetched(site, folder=tmp_path) == 0
    return tmp_path


def holds(folder: Path, content: bytes) -> None:
    """See that the folder holds `content` and its sum, and nothing beside them."""
    path = folder / "arducopter-stable" / "arducopter"
    assert sorted(path.parent.iterdir()) == [path, path.with_suffix(".sha256")]
    assert path.read_bytes() == content
    sums = path.with_suffix(".sha256").read_text()
    assert sums.split()[0] == hashlib.sha256(content).hexdigest()
    assert path.stat().st_mode & 0o777 == 0o755


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_answer_is_one_line_and_leaves_what_was_there(
    kept: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    sent, code, words = BAD[kind]
    capsys.readouterr()
    with serving(sent) as site:
        assert fetched(site, folder=kept) == code
    said = capsys.readouterr()
    assert said.out == ""
    assert words in said.err
    assert said.err[-1] == "\n"
    assert said.err[:-1].isprintable(), said.err  # one line, and no control characters
    assert len(said.err) < 1000
    holds(kept, GOOD)


@pytest.mark.parametrize("kind", FINE)
def test_an_odd_answer_that_is_whole_is_taken(kept: Path, kind: str) -> None:
    with serving(FINE[kind]) as site:
        assert fetched(site, folder=kept) == 0
    holds(kept, NEWER)


def test_a_wrong_sum_and_a_server_without_tls_leave_what_was_there(
    kept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with serving(sized(NEWER)) as site:
        assert fetched(site, "--sha256", "0" * 64, folder=kept) == 5
        assert "wanted is 000" in capsys.readouterr().err
        assert fetched(site.replace("http", "https"), folder=kept) == 5
        assert "SSL" in capsys.readouterr().err
    holds(kept, GOOD)


@pytest.mark.parametrize(
    "site",
    [
        "", "ftp://127.0.0.1", "http://", "http:///x", "http://:80", "http://[::1", "http://[x]/",
        "http://127.0.0.1:0", "http://127.0.0.1:65536", "http://127.0.0.1:99999999999",
        "http://127.0.0.1:-1", "http://127.0.0.1:port", "http://127.0.0.1:80:80", "http://a b/",
        "http://me:word@127.0.0.1/", "http://127.0.0.1/?a=b", "http://127.0.0.1/#a",
        "http://127.0.0.1/\nX: y", "http://127.0.0.1\x1b[31m/", "http://müller/", "http://a/ü",
        "http://\udcff/", "http://٣/", "http://127.0.0.1:٣/",
    ],
)  # fmt: skip
def test_an_address_that_is_none_is_one_line(
    tmp_path: Path, site: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fetched(site, folder=tmp_path) == 2
    said = capsys.readouterr().err
    assert "--site" in said
    assert said[:-1].isprintable(), said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "site", ["http://a..b", "http://" + "a" * 99 + ".org", "http://-", "HTTP://%"]
)
def test_a_host_that_cannot_be_is_one_line(
    tmp_path: Path, site: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fetched(site, folder=tmp_path) in (2, 5)
    said = capsys.readouterr().err
    assert said[:-1].isprintable(), said
    assert not list(tmp_path.rglob("*arducopter"))[1:]


@pytest.mark.parametrize(
    "version", ["٤.٦.٣", "4.6.3\n", "4.6.3\x1b", "4", "v4.6.3", "4..6", "4.6.3/../..", "\udcff", ""]
)
def test_a_version_that_is_none_is_one_line(
    tmp_path: Path, version: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fetched("http://127.0.0.1:1", folder=tmp_path, version=version) == 2
    said = capsys.readouterr().err
    assert "such as 4.6.3, or stable, beta, latest" in said
    assert said[:-1].isprintable(), said
