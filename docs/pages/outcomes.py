"""What the sweeps under docs/data came to: tables of `aerofed reproduction`, a page for each."""

from pathlib import Path

from mission.sweep.outcome.reproduction import reproduction
from mission.sweep.state import read_sweep


def page(folder: Path) -> str:
    """The tables of one sweep, made anew from its compressed results."""
    head = (
        f"# Outcome of `{folder.name}`\n\n"
        f"Made from the tables beside this page by `aerofed reproduction docs/data/{folder.name}`. "
        "What the sweep is for: [The paper's experiment, reproduced](../../reproduction.md).\n\n"
    )
    return head + reproduction(read_sweep(folder))
