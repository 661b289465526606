"""The GitHub Action: its shell steps, with pip and pytest in a double's hands."""

import subprocess
import textwrap
from pathlib import Path

import pytest
from patience import HANG_S

ROOT = Path(__file__).parents[1]
# Writes down what it is called with; asked for a virtual environment, it is that one's, too.
PYTHON = """#!/bin/bash
echo "$(basename "$0") $*" >> "$CALLS"
if [ "$2" = venv ]; then
  mkdir -p "$3/bin"
  for name in python pytest; do cp "$0" "$3/bin/$name"; done
fi
"""
PYTEST = 'echo "now $PYTEST_ADDOPTS" >> "$CALLS"; echo kept > "$AEROFED_RESULTS/own.html"; pytest'


def step(name: str) -> str:
    """The shell commands of a step of action.yml."""
    text = (ROOT / "action.yml").read_text().partition(f"- name: {name}\n")[2]
    block = text.partition("      run: |\n")[2].partition("\n    - ")[0]
    return textwrap.dedent(block)


class Job:
    """A job of a workflow: what steps leave for later ones lies in files, as the runner has it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (python := folder / "python").write_text(PYTHON)
        python.chmod(0o755)
        for name in ("GITHUB_ENV", "GITHUB_PATH", "CALLS"):
            (folder / name).touch()

    def read(self, name: str) -> list[str]:
        return (self.folder / name).read_text().splitlines()

    def run(self, name: str, **env: str) -> None:
        files = ("GITHUB_ENV", "GITHUB_PATH", "GITHUB_OUTPUT", "CALLS")
        given = {
            **{file: str(self.folder / file) for file in files},
            "RUNNER_TEMP": str(self.folder),
            "GITHUB_ACTION_PATH": "/action",
            "GITHUB_JOB": "fly",
            "PATH": ":".join(
                [*reversed(self.read("GITHUB_PATH")), str(self.folder), "/usr/bin:/bin"]
            ),
            **env,
        }
        shell = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step(name)]
        subprocess.run(shell, env=given, timeout=HANG_S, check=True)

    def use(self) -> dict[str, str]:
        """The action once; what its installation hands on."""
        (self.folder / "GITHUB_OUTPUT").unlink(missing_ok=True)
        self.run("Install Aerofed", NAME="flights", PACKAGES="-r requirements.txt six")
        told = dict(line.split("=", 1) for line in self.read("GITHUB_OUTPUT"))
        self.run("Run", COMMAND=PYTEST, AEROFED_RESULTS=told["results"], PYTEST_ADDOPTS="--mine")
        return told


@pytest.fixture
def job(tmp_path: Path) -> Job:
    return Job(tmp_path)


def test_each_use_has_an_artifact_and_a_folder_of_its_own(job: Job) -> None:
    one, two = job.use(), job.use()
    assert one["artifact"] != two["artifact"]
    assert all(told["artifact"].startswith("flights-fly-") for told in (one, two))
    for told in (one, two):
        assert (Path(told["results"]) / "own.html").read_text() == "kept\n"
        expected = (
            f"now --junitxml='{told['results']}/junit.xml' --basetemp='{told['results']}/tests'"
        )
        assert f"{expected} --mine" in job.read("CALLS")


def test_packages_are_of_the_versions_that_were_tested(job: Job) -> None:
    job.use()
    (pip,) = (call for call in job.read("CALLS") if " pip install" in call)
    words = "--constraint /action/requirements.lock /action pytest -r requirements.txt six"
    assert pip.endswith(words)


def test_later_steps_find_the_programs_and_no_options_of_pytest(job: Job) -> None:
    told = job.use()
    assert job.read("GITHUB_ENV") == []
    (path,) = job.read("GITHUB_PATH")
    assert Path(path) == Path(told["results"]).parent / "venv" / "bin"


def test_a_command_that_fails_fails_the_step(job: Job) -> None:
    told = job.use()
    with pytest.raises(subprocess.CalledProcessError):
        job.run("Run", COMMAND="false | true; echo went on", AEROFED_RESULTS=told["results"])
