"""`aerofed data`: fetch the data sets from where they are published, and check a folder."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from rich.progress import BarColumn, DownloadColumn, Progress, TaskID, TextColumn

from fl.errors import FETCHED
from mission.base.console import PLAIN, Terminal
from mission.base.errors import InputError
from mission.commands.options import Json, print_json, tell

if TYPE_CHECKING:
    from fl.data.fetch import TaskCheck

Task = Literal["mnist", "fashion-mnist", "cifar10"]
Tasks = Annotated[tuple[Task, ...], Parameter(name="--task", negative=(), consume_multiple=True)]


def fetch(folder: Path, *, task: Tasks = ("mnist", "cifar10"), as_json: Json = False) -> int:
    """Download data sets from their official locations; a file is kept if its checksum is right.

    Example: aerofed data fetch data --task mnist cifar10

    Args:
        folder: Folder for the data; each data set gets a sub-folder of its own.
        task: Data sets to download.
        as_json: Print the files' paths as a JSON list.
    """
    from fl.data.fetch import fetch as download

    console = Terminal(**PLAIN)
    done: list[Path] = []
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        DownloadColumn(),
        console=console,
        transient=True,
        disable=as_json,
    ) as bar:
        shown: dict[str, TaskID] = {}

        def progress(name: str, done: int, total: int | None) -> None:
            if name not in shown:
                shown[name] = bar.add_task(name)
            bar.update(shown[name], completed=done, total=total)

        for name in task:
            paths = download(name, folder, progress=progress)
            done += paths
            for path in () if as_json else paths:
                console.print(path)
    if as_json:
        print_json(done)
    return 0


def check(folder: Path, *, task: Tasks | None = None, as_json: Json = False) -> int:
    """Read every data set in a folder as a run would, and say what was found.

    Example: aerofed data check data

    Args:
        folder: The data folder.
        task: Which data sets must be there. Default: those that are, and one at least.
        as_json: Print what was found as a JSON list.
    """
    from fl.data.fetch import check as look

    if folder.exists() and not folder.is_dir():
        raise InputError(
            f"{folder}: is a file; a data folder is wanted, which holds the files of the data sets"
            f" or a sub-folder for each: aerofed data check {folder.absolute().parent}"
        )
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; aerofed data fetch {folder} makes it")
    found: tuple[TaskCheck, ...] = look(folder, tasks=tuple(task or FETCHED))
    tell(found, [f"{one.task}: {one.status}: {one.detail}" for one in found], as_json=as_json)
    bad = {"damaged"} if task is None else {"damaged", "missing"}
    if any(item.status in bad for item in found):
        return InputError.exit_code
    if all(item.status == "missing" for item in found):
        raise InputError(
            f"{folder}: holds none of the data sets; aerofed data fetch {folder} downloads them"
        )
    return 0
