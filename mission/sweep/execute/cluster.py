"""Runs on a Ray cluster, or on a Ray that is started here: the one home of ray.

No folder is shared. Data sets and the user's code go to the machines, and the folder of a run that
has ended comes back, through Ray's object store. A run whose machine dies starts anew on another.
"""

import importlib
import io
import os
import shutil
import socket
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fl.data.dataset import Dataset
from fl.data.load import Source, bring, load, needs_files
from mission.base.errors import InputError, LinkLostError
from mission.base.run_folder import library_versions
from mission.config.models import RunConfig
from mission.config.preflight import code_digests
from mission.sweep.execute.worker import ENVIRONMENT, RunEnd, RunOrder, execute, failed
from native.errors import first_line

# Not sent with the working directory, where plug-ins are found in it: no code of the user's.
_LEFT_BEHIND = ["runs/", ".git/", ".venv/", "venv/", "__pycache__/", "*.mcap"]


class RayEngine:
    """Runs on a Ray cluster, each a task of one CPU."""

    def __init__(
        self,
        *,
        jobs: int | None,
        address: str | None,
        configs: Sequence[RunConfig],
        data_dir: Path | None,
    ) -> None:
        """Connect to the cluster at `address`, or start Ray on this machine.

        Raises:
            InputError: Ray is not installed, or data are missing or damaged.
            LinkLostError: there is no cluster at that address, or the working directory with the
                user's code is too large for it.
        """
        try:
            self._ray: Any = importlib.import_module("ray")
        except ImportError:
            raise InputError(
                "engine = ray: Ray is not installed: pip install 'aerofed[ray]'"
            ) from None
        read = _data_sets(configs, data_dir)
        self._connect(address, jobs, own_code=any(map(code_digests, configs)))
        self._data = {source: self._ray.put(dataset) for source, dataset in read.items()}
        self._jobs = jobs
        if self._cpus() < 1:
            self._ray.shutdown()
            raise LinkLostError(f"address = {address}: no machine of the cluster offers a CPU")
        # No retry by Ray: only the sweep knows how often a run was lost.
        self._fly = self._ray.remote(num_cpus=1, max_retries=0)(_task())
        self._versions = library_versions()
        self._flying: dict[Any, RunOrder] = {}  # by the reference to what comes back

    def _connect(self, address: str | None, jobs: int | None, *, own_code: bool) -> None:
        # Ray's workers run at the lowest priority unless this is set before it starts.
        os.environ["RAY_worker_niceness"] = "0"  # noqa: SIM112  # Ray's own spelling
        # A Ray that is started here tells nobody of it, unless it is asked to.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        local = {"num_cpus": jobs, "include_dashboard": False} if address is None else {}
        code = {"working_dir": str(Path.cwd()), "excludes": _LEFT_BEHIND} if own_code else {}
        try:
            self._ray.init(
                address=address or "local",
                log_to_driver=False,
                logging_level="error",
                runtime_env={"env_vars": ENVIRONMENT, **code},
                **local,
            )
        except Exception as error:  # Ray's own for a node that is up too late
            doing = (
                "engine = ray: cannot start Ray here"
                if address is None
                else f"address = {address}: cannot reach Ray"
            )
            raise LinkLostError(f"{doing}: {first_line(error)}") from None

    @property
    def slots(self) -> int:
        """Runs at a time: as many as asked for, by default one for each CPU that is there now."""
        return self._jobs or max(1, self._cpus())

    def _cpus(self) -> int:
        return int(self._ray.cluster_resources().get("CPU", 0))

    def start(self, order: RunOrder) -> None:
        """Hand a run to the cluster."""
        # Packed, so that a machine without Aerofed can say so.
        packed, data = self._ray.cloudpickle.dumps(order), list(self._data.items())
        self._flying[self._fly.remote(self._versions, packed, data)] = order

    def wait(self, timeout_s: float) -> dict[str, RunEnd | None]:
        """Return how runs ended, by name, within `timeout_s`; None: process or machine died.

        Raises:
            InputError: a machine has other versions.
            Exception: whatever a run raised that is no error of the application.
        """
        ready, _ = self._ray.wait(list(self._flying), timeout=timeout_s)
        ended = {}
        for ref in ready:
            order = self._flying.pop(ref)
            ended[order.name] = self._end(ref, order)
        return ended

    def _end(self, ref: Any, order: RunOrder) -> RunEnd | None:
        lost = self._ray.exceptions
        try:
            end, content = self._ray.get(ref)
        except lost.RayTaskError:
            raise
        except lost.RayError:  # its process or its machine is gone
            return None
        if not isinstance(end, RunEnd):
            self._refuse(machine=end, versions=content)
        try:
            _unpack(content, order.folder)
        except OSError as error:  # a full disk here, say: the end of this run, not of the sweep
            return failed(error, order.folder)
        found: RunEnd = end
        return found

    def _refuse(self, *, machine: str, versions: Mapping[str, str]) -> None:
        named = ", ".join(
            f"{name} {versions[name]} (here {here})"
            for name, here in self._versions.items()
            if versions[name] != here
        )
        raise InputError(
            f"engine = ray: machine {machine} has other versions: {named}; install the same on "
            "all machines of the cluster"
        )

    def close(self) -> None:
        """Cancel what is at work and leave the cluster; a Ray that was started here ends."""
        for ref in self._flying:
            self._ray.cancel(ref, force=True)
        self._flying.clear()
        self._ray.shutdown()


def _task() -> Callable[..., tuple[object, object]]:
    """Make the remote function. It is sent as code, so it can report a missing Aerofed itself."""

    def fly(wanted: dict[str, str], packed: bytes, data: Sequence[tuple[Source, Any]]) -> Any:
        import importlib.metadata
        import pickle
        import socket

        found: dict[str, str] = {}
        for name in wanted:
            try:
                found[name] = importlib.metadata.version(name)
            except importlib.metadata.PackageNotFoundError:
                found[name] = "is missing"
        if found != wanted:
            return socket.gethostname(), found
        from mission.sweep.execute.cluster import fly_there

        return fly_there(pickle.loads(packed), data)

    return fly


def fly_there(order: RunOrder, data: Sequence[tuple[Source, Any]]) -> tuple[RunEnd, bytes]:
    """Fly a run in a temporary folder on a cluster machine; return its end and its zipped folder.

    `data` are references to data sets in Ray's object store.

    Raises:
        Exception: whatever the run raised that is no error of the application.
    """
    import ray

    bring({source: ray.get(reference) for source, reference in data})
    with tempfile.TemporaryDirectory(prefix="aerofed-run-") as home:
        folder = Path(home) / order.folder.name
        end = execute(replace(order, folder=folder, working_dir=Path.cwd()))
        if end.exit_code:
            said = end.message.replace(str(folder), str(order.folder))
            end = replace(end, message=f"{said} (on machine {socket.gethostname()})")
        return end, _packed(folder)


def _packed(folder: Path) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for path in sorted(folder.rglob("*")):
            archive.write(path, path.relative_to(folder))
    return content.getvalue()


def _unpack(content: bytes, folder: Path) -> None:
    """Unpack a zipped run's folder atomically, in place of one of an earlier attempt."""
    arriving = folder.with_name(f".{folder.name}.arriving")
    shutil.rmtree(arriving, ignore_errors=True)
    arriving.mkdir(parents=True)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            archive.extractall(arriving)
        if folder.exists():  # of a try before
            shutil.rmtree(folder)
        arriving.rename(folder)
    finally:
        shutil.rmtree(arriving, ignore_errors=True)


def _data_sets(configs: Sequence[RunConfig], data_dir: Path | None) -> dict[Source, Dataset]:
    """Load the data sets of these runs that come from files or from the user's code."""
    wanted = {
        (community.task, data_dir, community.data_file)
        for config in configs
        for community in config.communities
        if needs_files(community.task)
    }
    found = {}
    for task, folder, name in wanted:
        dataset = load(task, data_dir=folder, data_file=name)
        _ = dataset.train  # read, if it was not
        found[task, folder, name] = dataset
    return found
