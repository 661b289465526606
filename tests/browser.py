"""Pages in a real browser: Chromium, spoken to over a pipe (the DevTools protocol).

Where it is missing, tests are skipped with the reason; with CI in the environment, they fail.
"""

import base64
import html
import json
import os
import re
import select
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from fcntl import F_DUPFD, fcntl
from pathlib import Path
from typing import Any

import pytest
from patience import HANG_S

HIGH = 1500  # of the window, in pixels

_NAMES = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-dev-shm-usage", "--hide-scrollbars", "--remote-debugging-pipe"),
)
_DRAWN = """new Promise((done) => {
  const look = () => document.readyState === "complete"
    && (document.documentElement.dataset.drawn || !document.querySelector(".chart"))
    ? done() : setTimeout(look, 20);
  look();
})"""


class Browser:
    """One page at a time; `told` is what its console was told as a warning or an error."""

    def __init__(self, orders: int, answers: int) -> None:
        self.told: list[str] = []
        self._orders, self._answers = orders, answers
        self._number, self._rest, self._session = 0, b"", {}
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        found = self._ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": found["sessionId"]}
        for domain in ("Page", "Runtime", "Log"):
            self._ask(f"{domain}.enable")

    def open(self, page: Path, width: int) -> None:
        """Load a page and wait until all of its charts are drawn.

        Raises:
            AssertionError: a script of the page has failed.
        """
        self.told.clear()
        size = {"width": width, "height": HIGH, "deviceScaleFactor": 1, "mobile": False}
        self._ask("Emulation.setDeviceMetricsOverride", **size)
        self._ask("Page.navigate", url=page.as_uri())
        self.run(_DRAWN)

    def run(self, script: str) -> Any:
        """The value of an expression, awaited where it is a promise."""
        done = self._ask(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in done, done
        return done["result"].get("value")

    def press(self, key: str, code: int) -> None:
        """Press and release a key, with its number on Windows."""
        for what in ("rawKeyDown", "keyUp"):
            self._ask("Input.dispatchKeyEvent", type=what, key=key, windowsVirtualKeyCode=code)

    def shot(self) -> bytes:
        """The whole page as PNG."""
        done = self._ask("Page.captureScreenshot", captureBeyondViewport=True)
        return base64.b64decode(done["data"])

    def printed(self) -> bytes:
        """The page on A4, as PDF."""
        paper = {"paperWidth": 8.27, "paperHeight": 11.69, "printBackground": True}
        paper["generateTaggedPDF"] = False  # a tree for screen readers, a fifth of the time
        return base64.b64decode(self._ask("Page.printToPDF", **paper)["data"])

    def _ask(self, method: str, **params: Any) -> Mapping[str, Any]:
        self._number += 1
        order = {"id": self._number, "method": method, "params": params, **self._session}
        os.write(self._orders, json.dumps(order).encode() + b"\0")
        while (answer := self._heard()).get("id") != self._number:
            match answer.get("method"), answer.get("params", {}):
                case "Runtime.exceptionThrown", {"exceptionDetails": details}:
                    raise AssertionError(details.get("exception", details).get("description"))
                case "Runtime.consoleAPICalled", {"type": "warning" | "error", "args": args}:
                    self.told += [str(arg.get("value", arg)) for arg in args]
                case "Log.entryAdded", {"entry": entry}:
                    self.told.append(entry["text"])
        assert "error" not in answer, answer["error"]
        found: Mapping[str, Any] = answer["result"]
        return found

    def _heard(self) -> Mapping[str, Any]:
        while b"\0" not in self._rest:
            assert select.select([self._answers], [], [], HANG_S)[0], "the browser hangs"
            more = os.read(self._answers, 1 << 20)
            assert more, "the browser has ended"
            self._rest += more
        message, _, self._rest = self._rest.partition(b"\0")
        found: Mapping[str, Any] = json.loads(message)
        return found


def words_of(pdf: bytes) -> list[tuple[str, float]]:
    """The words of a PDF, each with where it ends: at 1 the paper does."""
    told = subprocess.run(
        ["pdftotext", "-bbox", "-", "-"], input=pdf, check=True, capture_output=True
    ).stdout.decode()
    wide = float(re.findall(r'<page width="([\d.]+)"', told)[0])
    found = re.findall(r'<word .*?xMax="([\d.-]+)".*?>(.*?)</word>', told)
    return [(html.unescape(word), float(right) / wide) for right, word in found]


@contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """A browser with an empty profile, which ends with the block."""
    command = next(filter(None, map(shutil.which, _NAMES)), None)
    if command is None or shutil.which("pdftotext") is None:
        stop = pytest.fail if os.environ.get("CI") else pytest.skip
        stop("needs a browser and pdftotext: apt-get install chromium poppler-utils")
    ends = [*os.pipe(), *os.pipe()]
    # It reads from 3 and writes to 4; above both, neither is overwritten before it is copied.
    theirs = [fcntl(end, F_DUPFD, 10) for end in (ends[0], ends[3])]
    place = f'exec 3<&{theirs[0]} 4>&{theirs[1]}; exec "$@"'
    process = subprocess.Popen(
        ["bash", "-c", place, "-", command, *_OPTIONS, f"--user-data-dir={profile}"],
        pass_fds=theirs, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    for end in (ends[0], ends[3], *theirs):
        os.close(end)
    try:
        yield Browser(ends[1], ends[2])
    finally:
        os.close(ends[1])  # with which it ends
        process.wait(HANG_S)
        os.close(ends[2])
