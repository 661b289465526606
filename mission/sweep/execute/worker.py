"""One run of a sweep, in whatever process an engine gives it."""

import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console

from fl.plugin_code import PassedObject, bring
from mission.base.console import RunConsole
from mission.base.errors import AerofedError, InputError
from mission.base.run_folder import RunFolder
from mission.config.models import RunConfig
from mission.config.preflight import code_digests
from mission.run.resume import other_code, read_checkpoint
from native.errors import printable

# A run takes one core: batches are small, and runs side by side make better use of the others.
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@dataclass(frozen=True)
class RunOrder:
    """Configuration, folder and data of a run, as a worker takes them."""

    name: str
    config: RunConfig
    folder: Path
    data_dir: Path | None
    working_dir: Path  # the user's own modules are found from here
    figures: bool = True  # whether its own pictures are drawn
    plugins: Mapping[str, str | None] = field(default_factory=dict)  # digests, as the sweep began
    objects: Mapping[str, PassedObject] = field(default_factory=dict)  # plug-ins, by their names


@dataclass(frozen=True)
class RunEnd:
    """Exit code and message of a run."""

    exit_code: int
    message: str = ""


def execute(order: RunOrder) -> RunEnd:
    """Fly one run, from its last finished round where it was cut off.

    An error of the run (flight failed, learning diverged, disk full) is an end, not an exception:
    the other runs of the sweep go on.
    """
    if str(order.working_dir) not in sys.path:
        sys.path.append(str(order.working_dir))
    bring(order.objects)
    from mission.run.recorded import Around
    from mission.run.session import fly_session, resume_session

    around = Around(RunConsole(Console(quiet=True)), workers=1, figures=order.figures)
    try:
        for name, digest in code_digests(order.config).items():
            if why := other_code(name, order.plugins[name], digest):
                raise InputError(f"{why} while the sweep was at work; give it a new folder")
        if clear_unless_resumable(order.folder):
            code = resume_session(order.folder, around)
        else:
            code = fly_session(order.config, order.folder, around, data_dir=order.data_dir)
    except (AerofedError, OSError) as error:
        return failed(error, order.folder)
    return RunEnd(code)


def clear_unless_resumable(path: Path) -> bool:
    """Whether a run that was cut off can go on in this folder; if not, the folder is removed.

    A run that failed, that other versions of the libraries began, or whose vehicle cannot fly its
    rounds again, starts anew.

    Raises:
        InputError: somebody flies into it.
        OSError: the folder cannot be removed.
    """
    if path.exists():
        with RunFolder(path).lock():  # nobody flies into it while we judge and remove it
            if _goes_on(RunFolder(path)):
                return True
            shutil.rmtree(path)
    return False


def _goes_on(folder: RunFolder) -> bool:
    summary = folder.read_summary()
    if summary.get("status") not in ("running", "interrupted") or not summary.get("resumable"):
        return False
    try:
        read_checkpoint(folder.path)
    except (OSError, ValueError, KeyError, TypeError, InputError):
        return False
    return True


def failed(error: AerofedError | OSError, folder: Path) -> RunEnd:
    """The `RunEnd` of a run that ended with an error."""
    if isinstance(error, AerofedError):
        return RunEnd(error.exit_code, printable(error))
    where, why = error.filename or folder, error.strerror or error
    return RunEnd(InputError.exit_code, f"{where}: {why}")
