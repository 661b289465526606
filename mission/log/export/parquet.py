"""A log's tables as Parquet."""

from pathlib import Path

from mission.base.parquet import parquet
from mission.log.export.tables import new_folder, tables
from mission.log.read.reader import read_log


def export_parquet(path: Path, folder: Path) -> tuple[Path, ...]:
    """Write every table with a row to `folder` as Parquet (zstd); returns the files.

    Raises:
        LogError: the log cannot be read. InputError: the folder is used or cannot be written.
    """
    found = {name: columns for name, columns in tables(read_log(path)).items() if columns}
    with new_folder(folder) as partial:
        for name, columns in found.items():
            (partial / f"{name}.parquet").write_bytes(parquet(columns))
    return tuple(folder / f"{name}.parquet" for name in found)
