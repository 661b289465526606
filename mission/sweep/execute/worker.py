"""One run of a sweep, in whatever process an engine gives it."""

import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from mission.base.console import RunConsole
from mission.base.errors import AerofedError, InputError
from mission.config.models import RunConfig

# A run takes one core: batches are small, and runs side by side make better use of the others.
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}


@dataclass(frozen=True)
class RunOrder:
    """Everything that a worker must know of a run."""

    name: str
    config: RunConfig
    folder: Path
    data_dir: Path | None
    working_dir: Path  # the user's own modules are found from here
    figures: bool = True  # whether its own pictures are drawn


@dataclass(frozen=True)
class RunEnd:
    """How a run ended."""

    exit_code: int
    message: str = ""


def execute(order: RunOrder) -> RunEnd:
    """Fly one run from its start into a fresh folder; what a run before it left half-done goes.

    An error of the run (flight failed, learning diverged, disk full) is an end, not an exception:
    the other runs of the sweep go on.
    """
    if str(order.working_dir) not in sys.path:
        sys.path.append(str(order.working_dir))
    from mission.run.session import fly_session

    try:
        if order.folder.exists():
            shutil.rmtree(order.folder)
        code = fly_session(
            order.config,
            order.folder,
            data_dir=order.data_dir,
            console=RunConsole(Console(quiet=True), quiet=True),
            workers=1,
            figures=order.figures,
        )
    except AerofedError as error:
        return RunEnd(error.exit_code, str(error))
    except OSError as error:
        where, why = error.filename or order.folder, error.strerror or error
        return RunEnd(InputError.exit_code, f"{where}: {why}")
    return RunEnd(code)
