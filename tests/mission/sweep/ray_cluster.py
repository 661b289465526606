"""A Ray cluster whose machines see no folder of the sweep: processes with their own namespaces."""

import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from patience import until

RAY = Path(sys.executable).with_name("ray")


def can_hide() -> bool:
    """Whether this user may have a file system of their own, where a folder is covered."""
    tried = subprocess.run(
        ["unshare", "--map-root-user", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"],
        capture_output=True, check=False,
    ) if shutil.which("unshare") else None  # fmt: skip
    return tried is not None and tried.returncode == 0


@dataclass
class Machine:
    """One of the cluster: its processes, and the temporary folder that only they use."""

    process: "subprocess.Popen[bytes]"
    temporary: Path

    def flies(self, run: str) -> bool:
        """Whether it has a run at work."""
        return any(self.temporary.glob(f"aerofed-run-*/{run}/rounds.csv"))

    def die(self) -> None:
        """Everything on it at once, as in a power cut."""
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


@dataclass
class Cluster:
    """A head that flies nothing, and machines of one CPU for which `hidden` is an empty folder
    that nothing can be written into."""

    hidden: Path
    # Short: the names of sockets must fit into 107 bytes.
    top: Path = field(default_factory=lambda: Path(tempfile.mkdtemp(prefix="ray-")))
    machines: list[Machine] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.environment = {
            **os.environ,
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN": secrets.token_hex(32),
            "RAY_USAGE_STATS_ENABLED": "0",
            # How soon a machine that is gone is taken for dead: 5 tries, 1 s apart.
            "RAY_health_check_initial_delay_ms": "1000",
            "RAY_health_check_period_ms": "1000",
        }
        head = ["--head", "--port=0", "--num-cpus=0", f"--temp-dir={self.top / 'r'}"]
        log = self._start("head", [*head, "--include-dashboard=false"]).temporary / "log"
        found = re.search("ray start --address='([^']+)", log.read_text())
        assert found is not None
        self.address = found[1]

    def add(self, name: str, **environment: str) -> Machine:
        """One more machine. Two that begin at once on one computer would take the same names."""
        options = [f"--address={self.address}", "--num-cpus=1"]
        return self._start(name, options, hide=True, **environment)

    def _start(
        self, name: str, options: list[str], *, hide: bool = False, **environment: str
    ) -> Machine:
        command = [str(RAY), "start", *options, "--block"]
        if hide:
            # And what Ray keeps of a machine in files is that machine's.
            cover = (
                f"mount -t tmpfs -o ro,size=4k none '{self.hidden}' && "
                f"mount -t tmpfs none '{self.top / 'r'}' && exec \"$@\""
            )
            command = [
                "unshare", "--map-root-user", "--mount", "sh", "-c", cover, "sh", *command,
            ]  # fmt: skip
        temporary = self.top / name
        temporary.mkdir()
        with (temporary / "log").open("wb") as log:
            process = subprocess.Popen(
                command, stdout=log, stderr=log, start_new_session=True, cwd=temporary,
                env={**self.environment, "TMPDIR": str(temporary), **environment},
            )  # fmt: skip
        self.machines.append(Machine(process, temporary))
        said = temporary / "log"
        until(lambda: process.poll() is not None or "Ray runtime started" in said.read_text())
        assert process.poll() is None, said.read_text()
        return self.machines[-1]

    def close(self) -> None:
        """End all of it."""
        for machine in reversed(self.machines):
            if machine.process.poll() is None:
                machine.die()
        shutil.rmtree(self.top, ignore_errors=True)
