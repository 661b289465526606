"""Any image classification task in one .npz file.

Arrays `x_train`, `y_train`, `x_test`, `y_test` (or `train_images`, `train_labels`,
`test_images`, `test_labels`), or just `images` and `labels`, of which a sixth of every class is
held out for validation. Images are (n, height, width) or (n, height, width, channels) with 1, 3
or 4 channels, bytes or floats in [0, 1]; labels are integers from 0, (n,) or (n, 1).
"""

import lzma
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fl.data.bounded import LARGEST_BYTES
from fl.data.dataset import Dataset, Pixels, Provenance, SourceFile, Split, checked, hold_out
from fl.data.official import md5
from fl.errors import DataDamagedError, DataLayoutError, DataMissingError, first_line

LAYOUTS = (
    ("x_train", "y_train", "x_test", "y_test"),
    ("train_images", "train_labels", "test_images", "test_labels"),
    ("images", "labels"),
)
HELD_OUT = 1.0 / 6.0
MOST_CLASSES = 2**16


def load(name: str, data_dir: Path) -> Dataset:
    """The task in the file `name` of `data_dir`."""
    path = data_dir / name
    if not path.is_file():
        raise DataMissingError("npz", data_dir, f"the file {name}")
    try:
        if not zipfile.is_zipfile(path):
            raise DataDamagedError(path, "not an .npz archive, or only the beginning of one")
        with zipfile.ZipFile(path) as members:
            size = sum(member.file_size for member in members.infolist())
        if size > LARGEST_BYTES:
            raise DataDamagedError(
                path, f"unpacks to {size} bytes; at most {LARGEST_BYTES} are believed"
            )
        with np.load(path, allow_pickle=False) as archive:
            layout = next((keys for keys in LAYOUTS if set(keys) <= set(archive.files)), None)
            if layout is None:
                raise DataLayoutError(
                    path,
                    f"holds the arrays {', '.join(archive.files) or '(none)'}; wanted are"
                    f" {', or '.join(', '.join(keys) for keys in LAYOUTS)}",
                )
            arrays = [archive[key] for key in layout]
        content_md5 = md5(path.read_bytes())
    # The others are what numpy's parsing of a header of brackets, or a foreign compression, raises.
    except (
        *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, ValueError, TypeError),
        *(NotImplementedError, RuntimeError, SyntaxError, OverflowError, LookupError),
    ) as error:
        raise DataDamagedError(path, f"npz: {first_line(error)}") from error
    except MemoryError:
        raise DataDamagedError(path, "takes more memory than there is") from None
    except OSError as error:
        raise DataDamagedError(path, error.strerror or str(error)) from error
    splits = [
        Split(_images(arrays[i], layout[i], path), _labels(arrays[i + 1], layout[i + 1], path))
        for i in range(0, len(layout), 2)
    ]
    if len(splits) == 1:
        only = splits[0]
        if len(only.images) != len(only.labels):
            raise DataLayoutError(path, f"{len(only.images)} images, but {len(only.labels)} labels")
        splits = list(hold_out(only.images, only.labels, share=HELD_OUT, seed=0))
    provenance = Provenance(str(path), False, (SourceFile(path.name, content_md5, False),))
    classes = 1 + max(int(split.labels.max(initial=0)) for split in splits)
    return checked("npz", splits[0], splits[1], classes=classes, provenance=provenance)


def _images(array: NDArray[Any], key: str, path: Path) -> Pixels:
    if array.ndim == 3:
        array = array[..., np.newaxis]
    if array.ndim != 4 or array.shape[3] not in (1, 3, 4):
        raise DataLayoutError(
            path,
            f"{key} is {array.shape}; wanted (n, height, width) or"
            " (n, height, width, channels) with 1, 3 or 4 channels",
        )
    if array.dtype == np.uint8:
        return np.ascontiguousarray(array)
    if array.dtype.kind == "f":
        if not np.all((array >= 0.0) & (array <= 1.0)):
            raise DataLayoutError(path, f"{key} holds floats outside [0, 1]")
        return np.ascontiguousarray(array, dtype=np.float32)
    raise DataLayoutError(path, f"{key} is of type {array.dtype}; wanted bytes or floats")


def _labels(array: NDArray[Any], key: str, path: Path) -> NDArray[np.int64]:
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise DataLayoutError(
            path, f"{key} is {array.dtype} {array.shape}; wanted integers (n,) or (n, 1)"
        )
    if len(array) and int(array.max()) >= MOST_CLASSES:
        raise DataLayoutError(
            path, f"{key} holds a label {array.max()}; at most {MOST_CLASSES - 1}"
        )
    return array.astype(np.int64)
