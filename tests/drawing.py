"""Pictures: off for most tests, of whose time they would take the largest part."""

import base64
import hashlib
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from subprocess import PIPE, Popen

import pytest

from mission.figures import render, run
from mission.figures.style import Chart

# `aerofed` as a program, without pictures of runs.
UNDRAWN = (sys.executable, str(Path(__file__).with_name("undrawn.py")))

# One black pixel.
_DOT = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR42mNgAAAAAgAB5Sfe/AAAAABJRU5ErkJggg=="
)
_draw, _engine, _draw_run = render._drawn, render.engine, run.draw_run


_started: list[Popen[str]] = []  # the engine of all that `_answered` draws; none or one


def _described(jobs: Sequence[tuple[str, str]], _: object = None) -> list[bytes]:
    if any(kind != "png" for kind, _ in jobs):
        return _answered(jobs)
    return [_DOT + hashlib.sha256(text.encode()).digest() for _, text in jobs]


def _answered(jobs: Sequence[tuple[str, str]]) -> list[bytes]:
    """Drawn by one engine for all tests: to start it takes longer than most pictures."""
    if not _started or _started[0].poll() is not None:
        words = (str(render._ENGINE), render._VERSION, *render._ANYTHING)
        command = [sys.executable, "-P", "-u", *words]  # unbuffered: it answers at once
        _started[:] = [Popen(command, stdin=PIPE, stdout=PIPE, text=True, bufsize=1)]
        _line(_started[0])
    drawn = []
    for job in jobs:
        print(json.dumps(job), file=_started[0].stdin)
        drawn.append(base64.b64decode(_line(_started[0])))
    return drawn


def _line(engine: Popen[str]) -> str:
    assert engine.stdout is not None
    line = engine.stdout.readline()
    assert line, "the engine has ended; it says why on the standard error"
    return line


def in_svg(pictures: Iterable[Chart]) -> list[str]:
    """Pictures drawn, in half the time that PNG takes."""
    jobs = [("svg", render._described(each)) for each in pictures]
    return [svg.decode() for svg in _answered(jobs)]


@contextmanager
def undrawn() -> Iterator[None]:
    """Runs leave no pictures. Others (PNG) are described to the end, as Vega-Lite in JSON, and not
    drawn: each is a dot and a digest of its description. SVG and PDF are drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(render, "_drawn", _described)
        patch.setattr(run, "engine", nullcontext)
        patch.setattr(run, "draw_run", lambda _: ())
        yield
    for engine in _started:
        with engine:  # which closes its input
            pass


@contextmanager
def outlined() -> Iterator[None]:
    """Here the pictures of runs are described, too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "draw_run", _draw_run)
        yield


@contextmanager
def drawn() -> Iterator[None]:
    """And here all are drawn."""
    with outlined(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(render, "_drawn", _draw)
        patch.setattr(run, "engine", _engine)
        yield
