"""`aerofed reproduction`."""

from pathlib import Path

from mission.base.errors import InputError


def reproduction(sweep: Path, *, out: Path | None = None) -> int:
    """A sweep's outcome as Markdown tables, beside what the paper reports.

    Final accuracies with 95 % intervals over seeds, participation and packet error rates of every
    strategy; and what the CoV method gains on each of the others, seed by seed.

    Example: aerofed reproduction paper-sweep --out table.md

    Parameters
    ----------
    sweep
        The folder of a sweep; it need not be over.
    out
        A new file for the tables. Default: they are printed.
    """
    from mission.sweep.outcome.reproduction import reproduction as tables
    from mission.sweep.state import read_sweep

    text = tables(read_sweep(sweep))
    if out is None:
        print(text, end="")
        return 0
    try:
        with out.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{out}: exists already; give a new file by --out") from None
    except OSError as error:
        raise InputError(f"{out}: cannot write: {error.strerror}") from None
    return 0
