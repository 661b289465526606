"""What the studies share: runs side by side, their rounds in tables, panels of pictures, tests."""

import gzip
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

import aerofed
from mission.base.run_folder import write_atomically
from mission.config.preflight import code_digests
from mission.figures.charts import DotRow, dot_rows
from mission.figures.style import WIDTH, Chart
from mission.sweep.execute.worker import ENVIRONMENT, RunOrder, execute
from mission.sweep.outcome.curves import interval

Floats = NDArray[np.float64]


@contextmanager
def finished(
    config: aerofed.RunConfig, name: str, *, data_dir: Path | None = None, code: Path = Path()
) -> Iterator[Path]:
    """The folder of a run, which is gone after the block; plug-ins are found in `code`.

    Raises:
        RuntimeError: the run failed, with what it said.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run"
        plugins = code_digests(config)
        end = execute(RunOrder("run", config, path, data_dir, code, figures=False, plugins=plugins))
        if end.exit_code != 0:
            raise RuntimeError(f"{name}: {end.message}")
        yield path


def in_parallel(jobs: int, calls: Iterable[tuple[Callable[..., str], tuple[object, ...]]]) -> None:
    """Make each call in one of so many processes; print what it returns as soon as it is done."""
    os.environ.update(ENVIRONMENT)
    with ProcessPoolExecutor(jobs) as pool:
        for call, arguments in calls:
            pool.submit(call, *arguments).add_done_callback(
                lambda done: print(done.result(), flush=True)
            )


def csv(rows: pd.DataFrame) -> str:
    """Rows as text."""
    text: str = rows.to_csv(index=False, lineterminator="\n")
    return text


def write(out: Path, readme: str, **tables: pd.DataFrame) -> None:
    """README.md, and each table as NAME.csv.gz: the same rows are the same bytes."""
    out.mkdir(parents=True, exist_ok=True)
    for name, rows in tables.items():
        packed = gzip.compress(csv(rows).encode(), mtime=0)
        write_atomically(out / f"{name}.csv.gz", packed)
    write_atomically(out / "README.md", readme)


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table."""
    rule = ["---" for _ in heads]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, rule, *rows))


def parts(texts: dict[str, str]) -> str:
    """Sections of a page, by title."""
    return "".join(f"\n## {title}\n\n{text}\n" for title, text in texts.items())


def mean_of(values: Sequence[float] | Floats, digits: int = 1, *, sign: str = "") -> str:
    """A mean with its 95 % interval (Student's t)."""
    of = interval(np.asarray(values))
    return f"{of.mean:{sign}.{digits}f} ± {of.half:.{digits}f}"


def ahead(values: Floats) -> str:
    """How many of them are above 0."""
    return f"{(values > 0.0).sum()} of {len(values)}"


def dots(label: str, colour: str, values: Sequence[float] | Floats) -> DotRow:
    """Values as rings, with their mean and its interval."""
    of = interval(np.asarray(values))
    return DotRow(label, colour, tuple(values), of.mean, (of.mean - of.half, of.mean + of.half))


def panel(title: str, rows: Sequence[DotRow], *, x: str, zero: bool = False) -> Chart:
    """One of two panels that stand side by side."""
    chart = dot_rows(title, rows, x=x, zero=zero)
    chart["width"] = WIDTH / 2
    return chart


def one_scale(panels: Sequence[Chart], ends: Sequence[float] | None = None) -> None:
    """Give all panels one scale: these ends, or the farthest of their own."""
    scales = [layer["encoding"]["x"]["scale"] for p in panels for layer in p["layer"]]
    own = [scale["domain"] for scale in scales]
    for scale in scales:
        scale["domain"] = list(ends or (min(map(min, own)), max(map(max, own))))


def two_sided(differences: Floats) -> float:
    """p of Student's t-test that the mean is 0."""
    spread = differences.std(ddof=1) / np.sqrt(len(differences))
    return float(2.0 * stdtr(len(differences) - 1, -abs(differences.mean()) / spread))


def holm(p_values: Sequence[float]) -> list[float]:
    """The p-values, corrected by Holm for there being so many."""
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p)
    steps = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    corrected = np.empty_like(p)
    corrected[order] = steps
    return [float(value) for value in corrected]


def corrected_half(values: Floats, p_values: Sequence[float], index: int) -> float:
    """Half of the interval of a mean of values (n,), at the level at which Holm tests `index`."""
    rank = int(np.argsort(np.argsort(p_values))[index])
    level, freedom = 0.05 / (len(p_values) - rank), len(values) - 1
    spread = values.std(ddof=1) / np.sqrt(len(values))
    return float(stdtrit(freedom, 1.0 - level / 2.0) * spread)
