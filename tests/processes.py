"""Processes of this machine, as /proc tells of them."""

from pathlib import Path


def writer_of(file: Path) -> int:
    """The process that has a file open."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if any(link.readlink() == file for link in (process / "fd").iterdir()):
                return int(process.name)
        except OSError:
            continue  # it ended meanwhile, or is somebody else's
    raise AssertionError(f"nobody writes {file}")
