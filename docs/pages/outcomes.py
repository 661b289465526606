"""What the sweeps under docs/data came to: tables of `reproduction_tables.py`, a page each."""

from pathlib import Path

from studies.reproduction_tables import reproduction

from mission.sweep.folder import read_sweep


def page(folder: Path) -> str:
    """The tables of one sweep, made anew from its compressed results."""
    head = (
        f"# Outcome of `{folder.name}`\n\n"
        "Made from the tables beside this page by "
        f"`python docs/studies/reproduction_tables.py docs/data/{folder.name}`. "
        "What the sweep is for: [The paper's experiment, reproduced](../../reproduction.md).\n\n"
    )
    return head + reproduction(read_sweep(folder))
