"""Every kind of file that a run leaves or takes: cut short, bits flipped, swapped for another.

Whatever reads it answers in one line or does what it would have done; it never ends by a traceback,
and a run is never resumed into something else.
"""

import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from small_runs import digests
from test_run import SMALL, fly

from mission.cli import call

CHANGES = 12  # to each file; `CHANGES=500 pytest` by hand
# What report and compare open of a folder. Of other files one change each shows that they do not.
READ = ("flight.mcap", "summary.json")
WAYPOINTS = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t43.6145\t7.0715\t130\t1\n" + "".join(
    f"{n}\t0\t3\t16\t0\t5\t0\t0\t43.615{n}\t7.0715\t50\t1\n" for n in (1, 2)
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole") / "run"
    assert fly(out, rounds=1) == 0
    return out


def changed(content: bytes, others: list[bytes], r: random.Random) -> bytes:
    """Cut short, lengthened, altered here and there, filled with noise, or another file."""
    match r.randrange(6):
        case 0:
            return content[: r.randrange(len(content))]
        case 1:
            return content + r.randbytes(r.randrange(1, 40))
        case 2 | 3:
            data = bytearray(content)
            for _ in range(r.choice((1, 1, 1, 3, 30))):
                data[r.randrange(len(data))] ^= 1 << r.randrange(8)
            return bytes(data)
        case 4:
            first = r.randrange(len(content))
            return content[:first] + r.randbytes(r.randrange(1, 200)) + content[first + 20 :]
        case _:
            return r.choice(others)


def spoilt(folder: Path, seed: int) -> Iterator[tuple[Path, bytes]]:
    """Each file of the folder in turn, and what to put in its place."""
    files = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.stat().st_size]
    contents = [p.read_bytes() for p in files]
    r = random.Random(seed)
    for path, content in zip(files, contents, strict=True):
        for _ in range(CHANGES if path.name in READ else 1):
            yield path, changed(content, contents, r)


def fault(capsys: pytest.CaptureFixture[str], code: int) -> str:
    """What was wrong with an answer: a bug, or not a line each for what is wrong; else empty."""
    printed = capsys.readouterr().err
    told = code in (0, 6) or (code in (2, 4) and printed.startswith("aerofed: "))
    return "" if told and "Traceback" not in printed else f"exit code {code}: {printed}"


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        lambda run: ["report", str(run)],
        lambda run: ["log", "check", str(run / "flight.mcap")],
        lambda run: ["log", "info", str(run / "flight.mcap")],
        lambda run: ["compare", str(run)],
    ],
    ids=["report", "check", "info", "compare"],
)
def test_readers_of_a_run(
    whole: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    command: Callable[[Path], list[str]],
) -> None:
    run = tmp_path / "run"
    shutil.copytree(whole, run)
    words = command(run)
    for number, (path, content) in enumerate(spoilt(run, seed=len(words[0]))):
        if path.suffix == ".png" or (words[0] == "log" and path.name != "flight.mcap"):
            continue
        before = path.read_bytes()
        path.write_bytes(content)
        wrong = fault(capsys, call(words))
        assert not wrong, f"{words} change {number} of {path.name}"
        path.write_bytes(before)


@pytest.mark.slow
def test_resuming(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is resumed ends as it would have; what is not is refused before anything is touched."""
    stopped = tmp_path / "stopped"
    shutil.copytree(whole, stopped)
    (stopped / "summary.json").unlink()
    r = random.Random(5)
    names = ["config.toml", "checkpoint/rounds.json", "checkpoint/learning-00001.bin"]
    contents = [(stopped / name).read_bytes() for name in names]
    for name, content in zip(names, contents, strict=True):
        for number in range(CHANGES):
            run = tmp_path / "run"
            shutil.copytree(stopped, run)
            new = changed(content, [c for c in contents if c != content], r)
            (run / name).write_bytes(new)
            before = digests(run)
            code = call(["run", "--resume", str(run), "--quiet"])
            wrong = fault(capsys, code)
            assert not wrong, f"change {number} of {name}"
            if code == 0:
                assert digests(run) == digests(whole)
            else:
                assert digests(run) == before
            shutil.rmtree(run)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".waypoints", ".plan"])
def test_plans(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str
) -> None:
    contents = [WAYPOINTS.encode(), next((whole / "plans").glob("*.plan")).read_bytes()]
    content = contents[suffix == ".plan"]
    r = random.Random(suffix)
    for number in range(4 * CHANGES):
        path = tmp_path / f"mine{suffix}"
        path.write_bytes(changed(content, contents, r))
        # Refused for a plan's sake before the folder is looked at, or for the folder's.
        code = call(["fly", str(path), "--out", str(whole)])
        wrong = fault(capsys, code)
        assert not wrong, f"change {number}"
        assert code == 2


@pytest.mark.slow
def test_configurations(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = (whole / "config.toml").read_bytes()
    r = random.Random(9)
    for number in range(6 * CHANGES):
        path = tmp_path / "mine.toml"
        path.write_bytes(changed(content, [WAYPOINTS.encode()], r))
        code = call(["run", str(path), "--out", str(whole), *SMALL])
        wrong = fault(capsys, code)
        assert not wrong, f"change {number}"
        assert code == 2


@pytest.mark.parametrize("opening", ["[", "{a=", "'''", '"' + "\\u0000"])
def test_a_configuration_nested_without_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], opening: str
) -> None:
    path = tmp_path / "deep.toml"
    path.write_text("x = " + opening * 50_000)
    assert call(["run", str(path), "--out", str(tmp_path / "run")]) == 2
    assert not fault(capsys, 2), opening


@pytest.mark.parametrize("altitude", ["1e308", "-1e308", "nan", "inf", "3.5e38"])
def test_altitudes_of_plans(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], altitude: str
) -> None:
    for line in (1, 2):
        lines = WAYPOINTS.splitlines()
        cells = lines[line].split("\t")
        cells[10] = altitude
        lines[line] = "\t".join(cells)
        path = tmp_path / "high.waypoints"
        path.write_text("\n".join(lines) + "\n")
        code = call(["fly", str(path), "--out", str(tmp_path / f"run{line}")])
        wrong = fault(capsys, code)
        assert not wrong, f"line {line}"
        # A home may leave its altitude open.
        assert code == (0 if (line, altitude) == (1, "nan") else 2)
