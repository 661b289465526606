"""`aerofed init`."""

from pathlib import Path

from mission.base.console import PLAIN, Terminal
from mission.base.errors import InputError
from mission.base.run_folder import write_atomically
from mission.config import Shipped


def init(name: Shipped = "quickstart", *, out: Path = Path()) -> int:
    """Write a configuration of your own, with comments, to begin from.

    Example: aerofed init
    Example: aerofed init paper --out my-paper

    Args:
        name: quickstart: two small communities, with data that come with Aerofed; paper: the
            paper's experiment on MNIST and CIFAR-10; paper-sweep: the same for aerofed sweep;
            apart: two communities in opposite corners; town: devices and no-fly areas from GeoJSON
            files; city: buildings from one, which decide what reaches the aircraft; munich: a radio
            traced by Sionna RT, an extra.
        out: Folder for the files, made if it is missing. Existing files are not replaced.
    """
    from mission.config.loading import shipped_files

    files = shipped_files(name)
    targets = [out / file.name for file in files]
    there = next((target for target in targets if target.exists()), None)
    if there is not None:
        raise InputError(f"{there}: exists already; give another folder by --out")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{out}: not a folder; give another by --out") from None
    except OSError as error:
        raise InputError(f"{out}: cannot be made: {error.strerror}") from None
    console = Terminal(**PLAIN)
    for file, target in zip(files, targets, strict=True):
        write_atomically(target, file.read_bytes())
        console.print(target)
    console.print(f"next: {_next(targets[0])}")
    return 0


def _next(config: Path) -> str:
    """What to do with a configuration that was written."""
    if not config.name.startswith("paper"):
        return f"aerofed run {config}"
    verb = "sweep" if config.name == "paper-sweep.toml" else "run"
    return f"aerofed data fetch data && aerofed {verb} {config} --data-dir data"
