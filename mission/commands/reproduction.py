"""`aerofed reproduction`."""

from pathlib import Path

from mission.base.errors import InputError


def reproduction(sweep: Path, *, out: Path | None = None, figures: Path | None = None) -> int:
    """A sweep's outcome as Markdown tables, beside what the paper reports.

    Final accuracies with 95 % intervals over seeds, participation and packet error rates of every
    strategy; and what the CoV method gains on each of the others, seed by seed. Of a sweep whose
    runs are gone its tables are enough.

    Parameters
    ----------
    sweep
        The folder of a sweep; it need not be over.
    out
        A new file for the tables. Default: they are printed.
    figures
        A folder for the sweep's pictures, which are drawn anew.
    """
    from mission.sweep.outcome.reproduction import reproduction as tables
    from mission.sweep.state import read_sweep

    state = read_sweep(sweep)
    text = tables(state)
    if figures is not None:
        from mission.sweep.outcome.figures import draw_sweep

        draw_sweep(sweep.resolve().name, state.results, figures)
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
