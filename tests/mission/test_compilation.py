"""A command says that it compiles, once, and leaves nothing behind when that is interrupted."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from mission.cli import call
from mission.compilation import compile_kernels

COMPILE = "fl.kernels.ahead.compile_ahead"


def test_what_was_imported_is_compiled_and_that_is_said_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compiled: list[Sequence[str]] = []
    said: list[str] = []

    def compile_ahead(modules: Sequence[str], notice: Callable[[], None]) -> None:
        compiled.append(modules)
        notice()

    monkeypatch.setattr(COMPILE, compile_ahead)
    compile_kernels("no.such.kernels", __name__, say=said.append)
    assert compiled == [[__name__]]
    assert said == ["compiling the inner loops, once after an installation: some 10 s"]
    compile_kernels("no.such.kernels", say=said.append)
    assert len(compiled) == len(said) == 1


def test_a_run_that_is_interrupted_while_it_compiles_leaves_no_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def compile_ahead(_: Sequence[str], notice: Callable[[], None]) -> None:
        notice()
        raise KeyboardInterrupt

    monkeypatch.setattr(COMPILE, compile_ahead)
    assert call(["run", "--out", str(tmp_path / "out")]) == 130
    printed = capsys.readouterr()
    assert printed.out.startswith("compiling the inner loops")
    assert printed.out.count("\n") == 1
    assert not (tmp_path / "out").exists()
