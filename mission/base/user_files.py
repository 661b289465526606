"""Reading of files that users name: regular files of limited size, UTF-8 text, JSON, TOML.

Devices, pipes and what the kernel serves (`/dev/zero`, `/proc/kmsg`) would hang or fill the memory.
JSON and TOML are refused where they are nested deeper than anything of ours, or hold numbers that
no 64 bits do: what is built from them then never meets either.
"""

import json
import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from mission.base.errors import InputError

TEXT_BYTES = 1 << 24  # of one file: a thousand times what people write
DATA_BYTES = 1 << 31  # of one that programs wrote: a month of flight
MOST_DEEP = 100  # tables or lists in one another; ours has 6


# What takes a file by the end of its name.
_TAKEN_BY = {
    **dict.fromkeys((".plan", ".waypoints", ".mission"), "aerofed fly flies it"),
    **dict.fromkeys((".mcap", ".ulg", ".bin", ".tlog"), "aerofed compare reads it"),
    ".toml": "aerofed run flies it",
}


def taken_by(path: Path) -> str:
    """Say which command a file is for, where it was given to another; empty where none is known."""
    words = _TAKEN_BY.get(path.suffix.lower())
    return f"; {words}" if words else ""


@contextmanager
def or_input_error(place: object, cannot: str) -> Iterator[None]:
    """Context manager: turn an OSError into an InputError `place: cannot: reason`."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{place}: {cannot}: {error.strerror or error}") from None


def whole_path(folder: Path, name: str | Path) -> Path:
    """Resolve a path named in a file of `folder`: relative to it, absolute, or from a home (~).
    The home of an unknown user is taken as a plain name."""
    path = Path(name)
    with suppress(RuntimeError):
        path = path.expanduser()
    return (folder / path).resolve()


def cache_folder(name: str) -> Path:
    """Return the cache folder `name` for what is fetched or computed once; make it if missing.

    Raises:
        InputError: it cannot be made.
    """
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # a container's user, whom its system does not know
        raise InputError("no home folder is known: name a cache folder in XDG_CACHE_HOME") from None
    folder = (cache / "aerofed" / name).absolute()
    with or_input_error(folder, "cannot be made"):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def read_bytes(path: Path, *, most: int = TEXT_BYTES) -> bytes:
    """The content of a regular file.

    Raises:
        InputError: it cannot be read, is no regular file, or has more than `most` bytes.
    """
    try:
        size = check_regular(path, most=most)
        with or_input_error(path, "cannot be read"), path.open("rb") as file:
            return file.read(size)  # no more: /proc has files of no size that never end
    except ValueError:  # a null in it
        raise InputError(f"{path}: no name of a file") from None


def check_regular(path: Path, *, most: int) -> int:
    """Check a file that a library opens itself: regular, not too large. Return its size in bytes.

    Raises:
        InputError: it is not there, is no regular file, or has more than `most` bytes.
    """
    with or_input_error(path, "cannot be read"):
        size = path.stat().st_size
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "a device or a pipe"
        raise InputError(f"{path}: cannot be read: {kind}, not a file")
    if size > most:
        raise InputError(f"{path}: cannot be read: {size} bytes, {most} are allowed")
    return size


def read_text(path: Path, *, most: int = TEXT_BYTES) -> str:
    """The text of a UTF-8 file, without its byte order mark.

    Raises:
        InputError: as `read_bytes`, or it is not UTF-8.
    """
    return decoded(read_bytes(path, most=most), path)


def decoded(content: bytes, path: Path) -> str:
    """The text of a file's content, UTF-8 without its byte order mark.

    Raises:
        InputError: it is not UTF-8.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: cannot be read: not UTF-8 text; save it as UTF-8") from None


def read_json(path: Path) -> Any:
    """The value of a JSON file.

    Raises:
        InputError: as `read_text`, or it is no JSON.
    """
    return parse_json(read_text(path), path)


def parse_json(text: str, source: object) -> Any:
    """The value of a JSON text that `source` holds.

    Raises:
        InputError: no JSON, nested too deep, or with an integer beyond 64 bits.
    """
    try:
        return _bounded(json.loads(text))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: not valid JSON: {_reason(error)}") from None


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ValueError: no TOML, nested too deep, or with an integer beyond 64 bits.
    """
    try:
        values: dict[str, Any] = _bounded(tomllib.loads(text))
    except RecursionError as error:
        raise ValueError(_reason(error)) from None
    return values


def _reason(error: BaseException) -> str:
    return "nested too deep" if isinstance(error, RecursionError) else str(error)


def _bounded(values: Any) -> Any:
    """Check the nesting depth and the integers of parsed values, and return them."""
    level, depth = [values], 0
    while level:
        if depth > MOST_DEEP:
            raise ValueError(f"nested deeper than {MOST_DEEP} tables or lists")
        inner: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                inner += item.values()
            elif isinstance(item, list):
                inner += item
            elif isinstance(item, int) and abs(item) >= 1 << 64:
                raise ValueError("an integer beyond 64 bits")
        level, depth = inner, depth + 1
    return values
