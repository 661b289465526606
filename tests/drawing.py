"""The engine that draws: off for most tests, of whose time it would take the largest part."""

import base64
import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext

import pytest

from mission.figures import render, run

# One black pixel.
_DOT = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR42mNgAAAAAgAB5Sfe/AAAAABJRU5ErkJggg=="
)
_draw, _engine = render._drawn, render.engine


def _described(jobs: Sequence[tuple[str, str]], _: object = None) -> list[bytes]:
    if any(kind != "png" for kind, _ in jobs):
        return _draw(jobs)
    return [_DOT + hashlib.sha256(text.encode()).digest() for _, text in jobs]


@contextmanager
def undrawn() -> Iterator[None]:
    """Pictures (PNG) are described to the end, as Vega-Lite in JSON, and not drawn: each is a dot
    and a digest of its description."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(render, "_drawn", _described)
        patch.setattr(run, "engine", nullcontext)
        yield


@contextmanager
def drawn() -> Iterator[None]:
    """And here they are drawn all the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(render, "_drawn", _draw)
        patch.setattr(run, "engine", _engine)
        yield
