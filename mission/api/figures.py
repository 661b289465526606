"""Pictures as values: shown by a notebook without a network, or written to a file."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from mission.api.configuring import as_path
from mission.base.errors import InputError

if TYPE_CHECKING:
    from mission.figures.style import Chart


@dataclass(frozen=True)
class Figure:
    """One picture. As the last value of a notebook's cell it is shown."""

    name: str
    chart: "Chart" = field(repr=False)  # Vega-Lite, as JSON has it

    def save(self, path: Path | str) -> Path:
        """Write it to a file, .png, .svg or .pdf; returns the path.

        Raises:
            InputError: another kind of file, or it cannot be written.
        """
        from mission.figures.render import save

        target = as_path(path, "path")
        save(self.chart, target)
        return target

    def _repr_png_(self) -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            return self.save(Path(folder) / "figure.png").read_bytes()


def chosen(pictures: Mapping[str, "Chart"], name: str, *, of: Path) -> Figure:
    """The picture of that name, among files `NAME.png`.

    Raises:
        InputError: there is none of that name.
    """
    picture = pictures.get(f"{name}.png")
    if picture is None:
        names = ", ".join(repr(file.removesuffix(".png")) for file in pictures) or "none"
        raise InputError(f"{of}: no figure {name!r}; there are: {names}")
    return Figure(name, picture)
