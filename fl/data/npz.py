"""Any classification task in one .npz file.

Arrays `x_train`, `y_train`, `x_test`, `y_test` (or `train_images`, `train_labels`,
`test_images`, `test_labels`), or just `images` and `labels`, or `features` and `labels`, of which
a sixth of every class is held out for validation. Images are (n, height, width) or (n, height,
width, channels) with 1, 3 or 4 channels, bytes or floats in [0, 1]; features are (n, features),
finite floats; labels are integers from 0, (n,) or (n, 1). With `owner`, integers (n,), the file
tells whose each training sample is.
"""

import lzma
import zipfile
import zlib
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fl.data.arrays import Samples, dataset_of, labels
from fl.data.dataset import Dataset, Provenance, SourceFile, held_out
from fl.data.files import LARGEST_BYTES, md5, reading
from fl.errors import DataDamagedError, DataLayoutError, DataMissingError
from native.errors import first_line

LAYOUTS = (
    ("x_train", "y_train", "x_test", "y_test"),
    ("train_images", "train_labels", "test_images", "test_labels"),
    ("images", "labels"),
    ("features", "labels"),
)
OWNER = "owner"
Found: TypeAlias = NDArray[np.generic]
HELD_OUT = 1.0 / 6.0
# The others are what numpy's parsing of a header of brackets, or a foreign compression, raises.
_DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, ValueError, TypeError),
    *(NotImplementedError, RuntimeError, SyntaxError, OverflowError, LookupError),
)


def wanted(name: str) -> str:
    """The file that is looked for and the key that names it, for errors."""
    return f"the file {name} (communities.data_file)"


def load(name: str, data_dir: Path) -> Dataset:
    """The data set in the .npz file `name` of the folder `data_dir`."""
    path = data_dir / name
    if not path.is_file():
        raise DataMissingError("npz", data_dir, wanted(name))
    with reading(path, "npz", *_DAMAGE, how=first_line):
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
            arrays = [_array(archive, key) for key in layout]
            owner = _array(archive, OWNER) if OWNER in archive.files else None
        content_md5 = md5(path.read_bytes())
    provenance = Provenance(str(path), False, (SourceFile(path.name, content_md5, False),))
    if len(layout) == 2:
        arrays, owner = _held_out(arrays, layout, owner, path)
        layout = layout * 2
    x_train, y_train, x_test, y_test = arrays
    samples = Samples(x_train, y_train, x_test, y_test, owner)
    return dataset_of("npz", samples, provenance=provenance, names=layout)


def _array(archive: "np.lib.npyio.NpzFile", name: str) -> Found:
    """A member of the archive. Raises ValueError where it is no array."""
    array = archive[name]
    if not isinstance(array, np.ndarray):  # numpy gives the bytes of what it does not know
        raise ValueError(f"{name} is no .npy file")
    return array


def _held_out(
    arrays: list[Found], layout: tuple[str, ...], owner: Found | None, path: Path
) -> tuple[list[Found], Found | None]:
    """Split one set of samples into training and held-out arrays; keep the training owners."""
    x, y = arrays
    classes = labels(y, layout[1], str(path))
    for name, array in ((layout[0], x), (OWNER, owner)):
        if array is not None and (array.ndim == 0 or len(array) != len(classes)):
            raise DataLayoutError(
                path, f"{len(array) if array.ndim else 0} {name}, but {len(classes)} {layout[1]}"
            )
    held = held_out(classes, share=HELD_OUT, seed=0)
    parts = [x[~held], classes[~held], x[held], classes[held]]
    return parts, None if owner is None else owner[~held]
