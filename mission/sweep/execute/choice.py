"""The choice between the engines of a sweep."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from mission.base.errors import InputError
from mission.config.models import RunConfig
from mission.sweep.execute.engine import Engine

EngineName = Literal["joblib", "ray"]


def check_options(name: EngineName, *, jobs: int | None, address: str | None) -> None:
    """Refuse options that do not fit the engine.

    Raises:
        InputError: naming the option.
    """
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}: at least 1")
    if address is not None and name != "ray":
        raise InputError(f"--address {address}: belongs to --engine ray")
    if address is not None and "://" in address:
        raise InputError(
            f"--address {address}: must be HOST:PORT of a cluster that this machine is part of; "
            "ray start --address=HOST:PORT makes it one"
        )


def make_engine(
    name: EngineName,
    *,
    jobs: int | None,
    address: str | None,
    configs: Sequence[RunConfig],
    data_dir: Path | None,
) -> Engine:
    """The engine of that name for runs of these configurations. Its library is imported here.

    Raises:
        InputError: it is not installed, or the options do not fit it.
        LinkLostError: it cannot be reached.
    """
    check_options(name, jobs=jobs, address=address)
    if name == "ray":
        from mission.sweep.execute.cluster import RayEngine

        return RayEngine(jobs=jobs, address=address, configs=configs, data_dir=data_dir)
    from mission.sweep.execute.local import LocalEngine

    return LocalEngine(jobs)
