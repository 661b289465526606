"""The choice between the engines of a sweep."""

from typing import Literal

from mission.base.errors import InputError
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


def make_engine(name: EngineName, *, jobs: int | None, address: str | None) -> Engine:
    """The engine of that name. Its library is imported here, not before.

    Raises:
        InputError: it is not installed, or the options do not fit it.
        LinkLostError: it cannot be reached.
    """
    check_options(name, jobs=jobs, address=address)
    if name == "ray":
        from mission.sweep.execute.cluster import RayEngine

        return RayEngine(jobs=jobs, address=address)
    from mission.sweep.execute.local import LocalEngine

    return LocalEngine(jobs)
