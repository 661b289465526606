"""Nobody flies into a folder in which another one flies or has flown."""

import io
import json
from pathlib import Path

import pytest
from rich.console import Console
from small_runs import refused
from test_planfile import plan_document, simple

from mission.base.console import RunConsole
from mission.base.run_folder import RunFolder
from mission.cli import call
from mission.run.recorded import Around
from mission.run.session import resume_session

FINISHED = {"status": "finished"}
NOBODY = ("--vehicle", "udpout://127.0.0.1:9", "--set", "link.connect_timeout_s=0.01")
CALLBACK = ("--set", 'callbacks=["json:nothing"]')


@pytest.fixture
def plan(tmp_path: Path) -> str:
    path = tmp_path / "one.plan"
    path.write_text(json.dumps(plan_document(simple(16, 0, 3, 0, None, 47.4, 8.5, 50))))
    return str(path)


@pytest.fixture
def another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another run ends in the folder just before we are alone in it."""
    lock = RunFolder.lock

    def late(folder: RunFolder, *, chosen: bool = False) -> object:
        folder.path.mkdir(exist_ok=True)
        folder.write_summary(FINISHED)
        return lock(folder, chosen=chosen)

    monkeypatch.setattr(RunFolder, "lock", late)


@pytest.mark.usefixtures("another")
@pytest.mark.parametrize("command", ["run", "fly"])
def test_a_run_that_has_just_ended_is_kept(
    tmp_path: Path, plan: str, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    out = tmp_path / "out"
    what = {"run": ("--set", "mission.flight=none", "--rounds", "1"), "fly": (plan,)}[command]
    assert call([command, *what, "--out", str(out), "--quiet"]) == 2
    refused(capsys, f"{out}: the output folder is already used")
    assert RunFolder(out).read_summary() == FINISHED
    assert not RunFolder(out).config.exists()


@pytest.mark.usefixtures("another")
def test_what_another_one_has_just_resumed_is_finished(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.checkpoint.mkdir()
    (folder.checkpoint / "rounds.json").touch()
    said = io.StringIO()
    assert resume_session(tmp_path, Around(RunConsole(Console(file=said, width=200)))) == 0
    assert (
        said.getvalue()
        == f"{tmp_path} is finished: nothing to resume; --rounds N gives it more rounds\n"
    )


class View:
    url = "ws://somewhere"
    open = 0

    def __init__(self, **_: object) -> None:
        View.open += 1

    def close(self) -> None:
        View.open -= 1


@pytest.mark.parametrize("refused", ["callback", "vehicle", "flight"])
def test_what_is_refused_leaves_no_folder_and_no_live_view(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plan: str, refused: str
) -> None:
    monkeypatch.setattr("mission.log.live.LiveView", View)
    monkeypatch.setattr(View, "open", 0)
    out = tmp_path / "out"
    what = {
        "callback": ("run", "--set", "mission.flight=none", *CALLBACK),
        "vehicle": ("run", *NOBODY),
        "flight": ("fly", plan, *NOBODY),
    }[refused]
    assert call([*what, "--live", "--live-port", "0", "--out", str(out)]) in (2, 5)
    assert View.open == 0
    assert not out.exists()


def test_a_folder_whose_name_is_not_utf8_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(["run", "--set", "mission.flight=none", "--out", f"{tmp_path}/o\udcff"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(r"o\udcff: the output folder's name is not UTF-8")
