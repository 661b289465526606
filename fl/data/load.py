"""From a task's name to its images and labels: bundled, generated, or read from files."""

from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path

from fl.config import TASKS
from fl.data import bundled, cifar, idx, npz
from fl.data.arrays import CustomDataset
from fl.data.dataset import Dataset
from fl.data.files import reading
from fl.errors import DataMissingError

Stamp = tuple[tuple[str, int, int], ...]

# Sub-folders of a data folder, or of these, in which files are looked for.
FOLDERS = (
    *("mnist", "MNIST", "fashion-mnist", "fashion", "FashionMNIST", "raw"),
    *("cifar10", "cifar-10-batches-py", "cifar-10-batches-bin"),
)

_BUNDLED: dict[str, Callable[[], Dataset]] = {
    "digits": bundled.digits,
    "colour-shapes": bundled.colour_shapes,
}
Source = tuple[str, Path | None, str | None]  # task, data folder, data file

_KEPT = 3  # data sets that stay in memory, of files and of own code
_brought: dict[Source, Dataset] = {}
# The plug-in is kept, too, so that its number stays its own.
_own: dict[tuple[int, Path | None, Stamp], tuple[CustomDataset, Dataset]] = {}
CLASSES = 10  # of every task but npz, whose file must be read


def needs_files(task: str) -> bool:
    """Whether the images of `task` have to be fetched; the others come along."""
    return task not in _BUNDLED


def bring(datasets: Mapping[Source, Dataset]) -> None:
    """Make `load` return these data sets in this process, as read where the files are."""
    _brought.clear()
    _brought.update(datasets)


def load(
    task: str, *, data_dir: Path | None, data_file: str | None = None, community: int | None = None
) -> Dataset:
    """The data set of `task`, from `data_dir` unless it is bundled or generated.

    Raises `DataMissingError` that says what is looked for, `DataDamagedError` naming the file.
    Intact files that are not the official ones (a subset, say) are used. A process
    that asks again while the files are as they were gets the same data set again: an archive
    takes seconds to unpack, and a sweep has many runs. Errors of code of one's own name the
    `community`, from 0.
    """
    if task in _BUNDLED:
        return _BUNDLED[task]()
    if (task, data_dir, data_file) in _brought:
        return _brought[task, data_dir, data_file]
    if task not in TASKS:
        return _of_own(CustomDataset.found(task, community), data_dir)
    if data_file is not None and Path(data_file).is_absolute():
        data_dir = Path(data_file).parent
    return _read(task, data_dir, data_file, _stamp(data_dir, data_file))


def _of_own(plugin: CustomDataset, data_dir: Path | None) -> Dataset:
    """Load a plug-in's data set; kept while its code and the files of the folder are unchanged
    (files in sub-folders other than `FOLDERS` are not looked at)."""
    folder = None if data_dir is None else data_dir.resolve()
    key = id(plugin.inner), folder, _stamp(folder)
    if key not in _own:
        loaded = plugin.load(data_dir)
        while len(_own) >= _KEPT:
            del _own[next(iter(_own))]
        _own[key] = plugin, loaded
    return _own[key][1]


@lru_cache(maxsize=_KEPT)
def _read(
    task: str,
    data_dir: Path | None,
    data_file: str | None,
    stamp: Stamp,  # noqa: ARG001  # tells the cache that files have changed
) -> Dataset:
    if task in ("mnist", "fashion-mnist"):
        return idx.load(task, _folder(task, data_dir, idx.WANTED))
    if task == "cifar10":
        return cifar.load(_folder(task, data_dir, cifar.WANTED))
    name = data_file or ""
    return npz.load(name, _folder(task, data_dir, npz.wanted(name)))


def _folder(task: str, data_dir: Path | None, wanted: str) -> Path:
    if data_dir is None or not data_dir.is_dir():
        raise DataMissingError(task, data_dir, wanted)
    return data_dir


def _stamp(folder: Path | None, data_file: str | None = None) -> Stamp:
    """Return paths, sizes in bytes and modification times in ns of the files of a data folder."""
    if folder is None or not folder.is_dir():
        return ()
    found: list[tuple[str, int, int]] = []
    with reading(folder):
        paths = set(folder.iterdir()) | ({folder / data_file} if data_file else set())
        for path in sorted(paths):
            if path.is_file():
                status = path.stat()
                found.append((str(path), status.st_size, status.st_mtime_ns))
            elif path.name in FOLDERS:
                found += _stamp(path)
    return tuple(found)
