"""Pictures: off for most tests, of whose time they would take the largest part."""

import base64
import hashlib
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

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


def _described(jobs: Sequence[tuple[str, str]], _: object = None) -> list[bytes]:
    if any(kind != "png" for kind, _ in jobs):
        return _draw(jobs)
    return [_DOT + hashlib.sha256(text.encode()).digest() for _, text in jobs]


def in_svg(pictures: Iterable[Chart]) -> list[str]:
    """Pictures drawn, in half the time that PNG takes."""
    return [svg.decode() for svg in _draw([("svg", render._described(each)) for each in pictures])]


@contextmanager
def undrawn() -> Iterator[None]:
    """Runs leave no pictures. Others (PNG) are described to the end, as Vega-Lite in JSON, and not
    drawn: each is a dot and a digest of its description."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(render, "_drawn", _described)
        patch.setattr(run, "engine", nullcontext)
        patch.setattr(run, "draw_run", lambda _: ())
        yield


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
