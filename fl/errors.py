"""Errors of learning that carry what explains them."""

from pathlib import Path

from native.errors import InputError, LinkLostError, TrainingError, one_line

FETCHED = ("mnist", "fashion-mnist", "cifar10")  # tasks whose files are published


class DataMissingError(InputError):
    """The files of a data set are not in the folder that was given."""

    def __init__(self, dataset: str, folder: Path | None, wanted: str) -> None:
        fetched = f"aerofed data fetch {folder or 'FOLDER'} --task {dataset}"
        get = f"; get it by: {fetched}" if dataset in FETCHED else ""
        super().__init__(
            f"{dataset}: needs files: give their folder (--data-dir FOLDER, in Python "
            f"data_dir); needed: {wanted}{get}"
            if folder is None
            else f"{dataset}: not found in {folder}; looked for {wanted}{get}"
        )


class DataDamagedError(InputError):
    """A data file that is there but cannot be read or is not what its format says."""

    words = "damaged or unreadable: "

    def __init__(self, path: Path | str, reason: str) -> None:
        super().__init__(f"{path}: {self.words}{reason}")
        self.reason = reason


class DataLayoutError(DataDamagedError):
    """A data file that can be read, but is not laid out as Aerofed wants it."""

    words = ""


class CheckpointError(InputError):
    """Learning state that is damaged or belongs to another federation."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"checkpoint of the learning: {reason}")


class DivergedError(TrainingError):
    """Local training that left the finite numbers: no retry helps, another setting may."""

    def __init__(self, number: int, community: str, device: int, loss: float) -> None:
        super().__init__(
            f"learning diverged: round {number}, community {community}, device {device}:"
            f" training left the finite numbers (mean loss {loss:.3g});"
            " a smaller learning rate may help"
        )
        self.round, self.community, self.device = number, community, device


class FetchError(LinkLostError):
    """A file that could not be downloaded; trying again may help."""

    def __init__(self, url: str, reason: str) -> None:
        super().__init__(one_line(f"{url}: not fetched: {reason}"))
