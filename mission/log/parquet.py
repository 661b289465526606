"""A log's tables as Parquet."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet

from mission.errors import InputError
from mission.log.export import prepare_folder, tables
from mission.log.reader import read_log


def export_parquet(path: Path, folder: Path) -> tuple[Path, ...]:
    """Write every table with a row to `folder` as Parquet (zstd); returns the files.

    Raises:
        LogError: the log cannot be read. InputError: the folder is used or cannot be written.
    """
    found = tables(read_log(path))
    prepare_folder(folder)
    written = []
    for name, columns in found.items():
        if not columns:
            continue
        target = folder / f"{name}.parquet"
        table = pa.table({key: pa.array(list(column)) for key, column in columns.items()})
        try:
            pyarrow.parquet.write_table(table, target, compression="zstd")
        except OSError as error:
            raise InputError(f"{target}: cannot write: {error}") from None
        written.append(target)
    return tuple(written)
