"""Rendering of Vega-Lite charts: to picture files, and to parts of a self-contained page."""

import base64
import hashlib
import json
import math
import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from subprocess import PIPE, Popen

from altair import SCHEMA_VERSION

from mission.base.errors import AerofedError, InputError
from mission.base.palette import LIGHT
from mission.base.run_folder import write_atomically
from mission.base.user_files import cache_folder, or_input_error, read_bytes
from mission.figures.style import CONFIG, Chart, arranged, heading

_ROUND = 65.0  # about a chart: its title and axes, in pixels
_TALLEST = 1.7  # of a picture with columns, height by width
_ENGINE = Path(__file__).with_name("engine.py")
_KINDS = ("png", "svg", "pdf")
_ANYTHING = ("svg", '{"mark": "point"}')
_LIBRARIES = ("libraries", "window.vegaEmbed = vegaEmbed;")
_VERSION = ".".join(SCHEMA_VERSION.removeprefix("v").split(".")[:2])


def stacked(
    charts: Sequence[Chart], *, title: str, about: str, one_key: bool = False, together: int = 1
) -> Chart:
    """Stack charts vertically as one picture, with a legend each or, `one_key`, one for all.

    Groups of `together` charts are laid out in columns if the picture would be too tall.
    """
    own = () if one_key else ("color", "strokeDash", "stroke", "fillOpacity")
    columns = _columns(charts, together) if together > 1 else 1
    rows: Sequence[Chart] = charts
    if columns > 1:
        rows = [
            arranged(charts[i : i + together], how="concat", own=own, columns=columns, spacing=14)
            for i in range(0, len(charts), together)
        ]
    return arranged(rows, how="vconcat", own=own, spacing=14, title=heading(title, about))


def _columns(charts: Sequence[Chart], together: int) -> int:
    """The fewest columns that make no picture too tall for a screen, and leave no chart alone."""
    width, height = (max(chart[side] for chart in charts) + _ROUND for side in ("width", "height"))
    for columns in range(1, together):
        rows = len(charts) // together * math.ceil(together / columns)
        alone = columns > 1 and together % columns == 1
        if not alone and rows * height <= _TALLEST * columns * width:
            return columns
    return together


def save(picture: Chart, target: Path) -> None:
    """Write a picture as PNG, SVG or PDF, by the file's suffix; output is deterministic.

    Raises:
        InputError: it cannot be written, or it is no kind of picture.
        AerofedError: it cannot be drawn: no memory.
    """
    kind = target.suffix[1:].lower()
    if kind not in _KINDS:
        raise InputError(f"{target}: not a kind of picture; use .png, .svg or .pdf")
    (drawn,) = _drawn([(kind, _described(picture))])
    write_atomically(target, drawn)


def save_all(
    pictures: Mapping[str, Chart], folder: Path, started: Popen[str] | None = None
) -> tuple[Path, ...]:
    """Write pictures (PNG) by name into `folder`, which is made; returns the files.

    They are drawn by the engine that has `started`, or by another one.

    Raises:
        InputError: they cannot be written.
        AerofedError: they cannot be drawn: no memory.
    """
    with or_input_error(folder, "cannot write the figures"):
        folder.mkdir(parents=True, exist_ok=True)
    drawn = _drawn([("png", _described(picture)) for picture in pictures.values()], started)
    for name, content in zip(pictures, drawn, strict=True):
        write_atomically(folder / name, content)
    return tuple(folder / name for name in pictures)


def card(chart: Chart, *, is_map: bool = False) -> dict[str, object]:
    """A chart for a page: `title` and `note` are the page's to write, `spec` is Vega-Lite.

    Its data are columns, which is shorter; the page makes rows of them. It is as wide as its
    place; a map keeps its shape (`aspect`, height by width). The wheel zooms with the shift key,
    so that the page scrolls; a drag moves, a double click resets.
    """
    spec = {**chart, "layer": _zoomed(chart["layer"], ["x", "y"] if is_map else ["x"])}
    title = spec.pop("title")
    aspect = spec["height"] / spec["width"] if is_map else None
    # `resize`: another round's numbers may need more room beside the axis.
    fit = {"type": "fit-x", "contains": "padding", "resize": True}
    spec |= {"width": "container", "autosize": fit}
    spec["datasets"] = {
        name: {key: [row[key] for row in rows] for key in (rows[0] if rows else {})}
        for name, rows in spec["datasets"].items()
    }
    spec["description"] = title["text"]
    note = title.get("subtitle", "")
    return {"title": title["text"], "note": note, "spec": spec, "aspect": aspect}


def _zoomed(layers: Sequence[Chart], channels: Sequence[str]) -> list[Chart]:
    """Return the layers, and have the first with a quantitative horizontal axis zoom."""
    select = {"type": "interval", "encodings": channels, "zoom": "wheel![event.shiftKey]"}
    zoom = {"params": [{"name": "zoom", "select": select, "bind": "scales"}]}
    kinds = [layer.get("encoding", {}).get("x", {}).get("type") for layer in layers]
    first = kinds.index("quantitative") if "quantitative" in kinds else -1
    return [{**layer, **zoom} if i == first else layer for i, layer in enumerate(layers)]


@cache
def libraries() -> str:
    """The JavaScript of Vega, Vega-Lite and Vega-Embed (BSD-3-Clause), as vl-convert brings it.

    It is made once for each version, and then kept in the user's cache folder.

    Raises:
        AerofedError: no memory for it.
    """
    script = b"" if _begun else _kept()
    if not script:
        _begin()
        (script,) = _results(_begun.pop(), [])
        with suppress(InputError):  # without a place to keep it, each process makes it
            write_atomically(_place(), _digest(script) + b"\n" + script)
    return script.decode()


_begun: list[Popen[str]] = []  # the engine that makes the libraries; none or one


def begin_libraries() -> None:
    """Start making `libraries` in the background, which takes two seconds, if none are kept."""
    if not libraries.cache_info().currsize and not _kept():
        _begin()


def _begin() -> None:
    if not _begun or _begun[0].poll() is not None:  # by Ctrl-C, in a notebook that goes on
        _begun[:] = [engine(_LIBRARIES)]


def _place() -> Path:
    """The file that keeps them, by all they are made of."""
    made_of = json.dumps([version("vl-convert-python"), _VERSION, *_LIBRARIES])
    return cache_folder("pages") / f"vega-{_digest(made_of.encode()).decode()[:16]}.js"


def _kept() -> bytes:
    """The kept libraries; empty where there are none, or damaged ones."""
    try:
        digest, _, script = read_bytes(_place()).partition(b"\n")
    except InputError:
        return b""
    return script if digest == _digest(script) else b""


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def engine(first: tuple[str, str] = _ANYTHING) -> Popen[str]:
    """Start a process of `engine.py` on its `first` job (kind, text), slow whatever it is."""
    command = [sys.executable, "-P", str(_ENGINE), _VERSION, *first]
    return Popen(command, stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True)


def _drawn(jobs: Sequence[tuple[str, str]], started: Popen[str] | None = None) -> list[bytes]:
    """Rendered bytes of charts, by the engine that has `started` or by another one."""
    return _results(started or engine(), jobs)[1:] if jobs else []


def _results(started: Popen[str], jobs: Sequence[tuple[str, str]]) -> list[bytes]:
    """Return an engine's results of its first job and of these, after which it has ended."""
    with started:
        output, errors = started.communicate("".join(json.dumps(job) + "\n" for job in jobs))
    if started.returncode:
        said = [line.strip("# ") for line in errors.splitlines() if line.strip("# ")]
        # V8 says first why it gives up, Python last.
        why = "it said nothing" if not said else said[-1 if "Traceback" in said[0] else 0]
        raise AerofedError(
            f"figures: the engine that draws them ended with code {started.returncode}: "
            f"{why} (it needs about 1 GB of memory and, where "
            "ulimit -v is set, 70 GB of address space)"
        )
    return [base64.b64decode(line) for line in output.splitlines()]


def _described(picture: Chart) -> str:
    """Vega-Lite JSON of a chart in the light theme."""
    text = json.dumps({**picture, "config": CONFIG})
    return re.sub(r"var\(--(\w+)\)", lambda found: LIGHT[found[1]], text)
