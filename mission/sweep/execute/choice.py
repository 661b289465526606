"""The choice between the engines of a sweep."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from mission.base.errors import InputError
from mission.config.models import RunConfig
from mission.sweep.execute.engine import Engine

EngineName = Literal["joblib", "ray"]


@dataclass(frozen=True)
class EngineChoice:
    """Which engine flies the runs of a sweep."""

    name: EngineName = "joblib"
    jobs: int | None = None  # runs at a time; None: one a core
    address: str | None = None  # of a Ray cluster

    def check(self) -> None:
        """Refuse options that do not fit the engine, before anything is written.

        Raises:
            InputError: naming the option.
        """
        if self.name not in get_args(EngineName):
            names = " or ".join(get_args(EngineName))
            raise InputError(f"--engine {self.name}: must be {names}")
        if self.jobs is not None and self.jobs < 1:
            raise InputError(f"--jobs {self.jobs}: at least 1")
        if self.address is not None and self.name != "ray":
            raise InputError(f"--address {self.address}: belongs to --engine ray")
        if self.address is not None and "://" in self.address:
            raise InputError(
                f"--address {self.address}: must be HOST:PORT of a cluster that this machine is "
                "part of; ray start --address=HOST:PORT makes it one"
            )

    def make(self, configs: Sequence[RunConfig], *, data_dir: Path | None) -> Engine:
        """The engine, for runs of these configurations. Its library is imported here.

        Raises:
            InputError: it is not installed, or the options do not fit it.
            LinkLostError: it cannot be reached.
        """
        self.check()
        if self.name == "ray":
            from mission.sweep.execute.cluster import RayEngine

            return RayEngine(
                jobs=self.jobs, address=self.address, configs=configs, data_dir=data_dir
            )
        from mission.sweep.execute.local import LocalEngine

        return LocalEngine(self.jobs)
