"""Other programs touch the files of a run while it writes them; a run is without its page."""

import sys
from pathlib import Path

import pytest
from small_runs import refused
from test_unflown import play

from mission.base.errors import InputError
from mission.base.record_file import RecordFile
from mission.base.run_folder import RunFolder
from mission.cli import call

pytestmark = pytest.mark.slow

# A callback: it is told of a round, and then does something to the run's folder.
MEDDLER = """
class Meddler:
    def __init__(self, context):
        self.folder = context.folder
    def round_finished(self, report):
        if report.round.round == 1:
            {deed}
    def close(self):
        pass
"""


@pytest.mark.parametrize(
    ("deed", "said"),
    [
        ('(self.folder / "uplinks.csv").unlink()', "uplinks.csv: deleted or moved"),
        ('(self.folder / "rounds.csv").write_text("")', "rounds.csv: changed by another program"),
        (
            'with open(self.folder / "learning.csv", "a") as file: print(file=file)',
            "learning.csv: changed",
        ),
        ('import os; os.truncate(self.folder / "flight.mcap", 99)', "flight.mcap: changed"),
        ("import shutil; shutil.rmtree(self.folder)", "summary.json: cannot write: No such file"),
    ],
)
def test_who_touches_a_file_of_a_run_under_way_ends_it_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    deed: str,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "meddler.py").write_text(MEDDLER.format(deed=deed))
    monkeypatch.delitem(sys.modules, "meddler", raising=False)
    callback = ("--set", 'callbacks=["meddler:Meddler"]')
    assert play(tmp_path / "out", *callback, rounds=2) == 2
    refused(capsys, said)


def test_what_is_deleted_while_figures_are_drawn_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr("mission.figures.run.draw_run", lambda path: (path / "rounds.csv").unlink())
    assert play(out) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert "rounds.csv: deleted or moved by another program" in error
    assert error.endswith(f"aerofed run --resume {out} goes on")
    assert RunFolder(out).status() == "failed"
    monkeypatch.setattr("mission.figures.run.draw_run", str)
    assert call(["run", "--resume", str(out), "--quiet"]) == 0
    assert (out / "rounds.csv").exists()


def test_a_disk_that_is_full_is_said_when_it_is_asked_for() -> None:
    file = RecordFile(Path("/dev/full"))
    assert file.write(b"a") == 1
    file.flush()
    with pytest.raises(InputError, match="/dev/full: cannot write: No space left on device"):
        file.check()
    file.close()
