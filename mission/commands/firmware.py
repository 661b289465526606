"""`aerofed firmware`: fetch a firmware from where its project publishes it, list what is here."""

import hashlib
import os
import re
from pathlib import Path
from typing import Literal

from mission.base.console import PLAIN, Terminal
from mission.base.errors import InputError
from mission.base.user_files import cache_folder
from native.errors import one_line

_SITE = "https://firmware.ardupilot.org"
_BUILD = "Copter/{}/SITL_x86_64_linux_gnu/arducopter"
_SUM = ".sha256"
_ADDRESS = r"https?://(?:[\w.-]+|\[[\da-f:.]+])(?::(\d{1,5}))?(?:/[\w.~%!$&'()*+,;=:@/-]*)?"


def fetch(
    firmware: Literal["arducopter"],
    *,
    version: str = "stable",
    sha256: str | None = None,
    site: str | None = None,
    folder: Path | None = None,
) -> int:
    """Download ArduCopter as its project builds it for simulations, for Linux on x86-64.

    A numbered version that is here already is not fetched again; stable, beta and latest are.

    Example: aerofed firmware fetch arducopter --version 4.6.3

    Args:
        firmware: arducopter. PX4 publishes no program that is known to fly on another's aircraft:
            build it.
        version: Such as 4.6.3; stable, beta or latest for the newest of those.
        sha256: Checksum that the file must have. Its project publishes none; without this, the one
            that the first download of a numbered version had counts from then on.
        site: Where it is published. Default: AEROFED_FIRMWARE_SITE, or the project's own server.
        folder: Where to put it. Default: aerofed/firmware in XDG_CACHE_HOME, or in ~/.cache.
    """
    if not re.fullmatch(r"\d+(\.\d+)+|stable|beta|latest", version, re.ASCII):
        raise InputError(f"--version {one_line(version)}: such as 4.6.3, or stable, beta, latest")
    if sha256 is not None and not re.fullmatch(r"[0-9a-f]{64}", sha256):
        raise InputError(
            f"--sha256 {one_line(sha256)}: must be 64 hexadecimal digits, in small letters"
        )
    path = _folder(folder) / f"{firmware}-{version}" / firmware
    if site is None:
        site = os.environ.get("AEROFED_FIRMWARE_SITE") or _SITE
    named = re.fullmatch(_ADDRESS, site, re.ASCII | re.IGNORECASE)
    if named is None or int(named[1] or 80) not in range(1, 65536):
        raise InputError(
            f"--site (AEROFED_FIRMWARE_SITE) {one_line(site)}: must begin with https:// or "
            "http:// and a host, then a port up to 65535 and a folder if there are any"
        )
    moving = version.isalpha()
    wanted = sha256 or (None if moving else _first_sum(path))
    found = None if moving or not path.is_file() else _sum_of(path)
    if found is None or wanted not in (None, found):
        found = _download(path, version, wanted, site)
    Terminal(**PLAIN).print(f"sha256 {found}\nexport AEROFED_ARDUCOPTER={path}")
    return 0


def list_(*, folder: Path | None = None) -> int:
    """List the firmware that was fetched, and whether each file is as it was then.

    Example: aerofed firmware list

    Args:
        folder: Where it is. Default: as of aerofed firmware fetch.
    """
    console = Terminal(**PLAIN)
    binaries = sorted(path for path in _folder(folder).glob("*/arducopter") if path.is_file())
    for path in binaries:
        whole = (
            "as fetched" if _sum_of(path) == _first_sum(path) else "changed since it was fetched"
        )
        console.print(f"{path.parent.name}: {path}: {whole}")
    if not binaries:
        raise InputError(
            f"{_folder(folder)}: holds no firmware; aerofed firmware fetch arducopter downloads it"
        )
    return 0


def _download(path: Path, version: str, wanted: str | None, site: str) -> str:
    """Put the file in place, and its checksum beside it, which is returned."""
    from fl.data.fetch import download
    from sitl.firmware.ardupilot import NAME

    published = version if version.isalpha() else f"stable-{version}"
    url = f"{site.rstrip('/')}/{_BUILD.format(published)}"

    def checked(part: Path) -> str:
        content = part.read_bytes()
        if not content.startswith(b"\x7fELF") or NAME not in content:
            raise InputError(f"{url}: what is there is not ArduCopter")
        return _sum_of(part)

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        found = download(url, path, checksum=wanted, sum_of=checked, mode=0o755)
        path.with_suffix(_SUM).write_text(f"{found}  {path.name}\n")
        return found
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def _folder(given: Path | None) -> Path:
    return (given or cache_folder("firmware")).absolute()


def _sum_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _first_sum(path: Path) -> str | None:
    """The checksum that the file had when it was fetched; None where it never was."""
    kept = path.with_suffix(_SUM)
    return kept.read_text(errors="replace").partition(" ")[0] if kept.is_file() else None
