"""Check of whether the run in a folder can be resumed here, by the header of its checkpoint.

It imports nothing heavy, so that a wrong folder is refused at once.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fl.plugin_code import digest_of
from fl.plugins import problem_of
from mission.base.errors import InputError
from mission.base.run_folder import RunFolder, library_versions
from mission.base.user_files import DATA_BYTES, parse_json, read_text

FORMAT = 5
ROUNDS = "rounds.json"
SEAL = "sha256"
_LENGTH = re.compile(r"^rounds = \d+$", re.MULTILINE)  # mission.rounds, which alters no round
_HEAD = {"format", "config_sha256", "data_dir", "libraries"}


def sealed(values: dict[str, object]) -> bytes:
    """Serialise a checkpoint as JSON, with the SHA-256 of its values under `SEAL`."""
    return json.dumps({**values, SEAL: _digest(values)}).encode()


def _digest(values: dict[str, object]) -> str:
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()


def damaged(file: Path, reason: str) -> InputError:
    """The error for a file of a checkpoint that no run can go on from."""
    run = file.parents[1]
    return InputError(
        f"{file}: damaged: {reason}; the run cannot go on: begin it anew in another folder, "
        f"aerofed run {RunFolder(run).config}"
    )


def header(
    config_toml: str, data_dir: Path | None, plugins: Mapping[str, str | None], **options: bool
) -> dict[str, object]:
    """Return the header by which a checkpoint is matched to its run. `plugins`: digests of those
    that alter results; `options`: start options that are not in the configuration."""
    return {
        **options,
        "format": FORMAT,
        "config_sha256": hashlib.sha256(_LENGTH.sub("", config_toml).encode()).hexdigest(),
        "data_dir": str(data_dir.resolve()) if data_dir else None,
        "libraries": library_versions(),
        "plugins": dict(plugins),
    }


def read_checkpoint(path: Path) -> dict[str, Any]:
    """The values of the checkpoint in the run's folder `path`.

    Raises:
        InputError: no folder of a run, damaged, or of another configuration or version.
    """
    folder = RunFolder(path)
    refuse_others(folder)
    file = folder.checkpoint / ROUNDS
    text, rounds = read_text(folder.config), read_text(file, most=DATA_BYTES)
    try:
        values = parse_json(rounds, file)
    except InputError:
        raise damaged(file, "not valid JSON, so it was changed or cut short") from None
    if not isinstance(values, dict) or not values.keys() >= _HEAD:
        raise damaged(file, "not what aerofed run writes")
    # An older format has no seal; what it is, is said before that.
    seal = values.pop(SEAL, None)
    if values["format"] == FORMAT and seal != _digest(values):
        raise damaged(file, "its checksum differs, so it was changed or cut short")
    now = {name: digest_of(name) for name in values.get("plugins", {})}
    for name, digest in now.items():
        if digest is not None and (why := problem_of(name)):  # others were passed from Python
            raise InputError(f"{path}: cannot be resumed here: plug-in {name!r} {why}")
    change = _change(values, header(text, None, now))
    if change:
        raise InputError(
            f"{path}: cannot be resumed: {change}; the run would not be the same, start a new one"
        )
    return values


def refuse_others(folder: RunFolder) -> None:
    """Refuse a folder that holds no run, as far as its files show.

    Raises:
        InputError: says what it is instead.
    """
    path = folder.path
    if not path.exists():
        raise InputError(f"{path}: no such folder")
    if not path.is_dir():
        raise InputError(f"{path}: a file; give the folder that aerofed run left")
    if (folder.checkpoint / ROUNDS).exists():
        return
    if (path / ROUNDS).exists():
        hint = f"it is the checkpoint itself; give {path.parent}"
    elif (path / "sweep.json").exists():
        hint = "it holds a sweep, which goes on when the same aerofed sweep command is given again"
    elif folder.stillborn:
        hint = "the run ended before its first checkpoint; the command that began it begins it anew"
    else:
        hint = f"it has no {folder.checkpoint.name}/{ROUNDS}"
    raise InputError(f"{path}: not a folder that aerofed run left: {hint}")


def other_code(name: str, then: str | None, now: str | None) -> str:
    """Say why a plug-in may have changed, by its digests (None: unknown); empty if it did not."""
    if then is None or now is None:
        return (
            f"nothing tells whether plug-in {name!r} is the same code as then: it was passed from "
            "Python, or an earlier version of aerofed flew it"
        )
    if then == now:
        return ""
    return (
        f"the code of plug-in {name!r}, or of what it imports from beside it, was changed "
        f"(SHA-256 {then[:8]}, now {now[:8]})"
    )


def _change(then: dict[str, Any], now: dict[str, Any]) -> str | None:
    """Say what differs between two headers; None where nothing does."""
    if not isinstance(then["libraries"], dict):
        return "its checkpoint does not say what wrote it"
    if then["format"] != now["format"]:
        wrote = then["libraries"].get("aerofed", "?")
        return (
            f"its checkpoint is of format {then['format']}, written by aerofed {wrote}, and this "
            f"is aerofed {now['libraries']['aerofed']}, which reads format {now['format']}"
        )
    if then["config_sha256"] != now["config_sha256"]:
        return "its config.toml was changed"
    for name, digest in then["plugins"].items():
        if why := other_code(name, digest, now["plugins"][name]):
            return why
    names = sorted(then["libraries"].keys() | now["libraries"].keys())
    versions = [(n, then["libraries"].get(n), now["libraries"].get(n)) for n in names]
    changed = [f"{n} was {old}, is {new}" for n, old, new in versions if old != new]
    return f"versions of libraries differ: {', '.join(changed)}" if changed else None
