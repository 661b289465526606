"""The checks that every page of the documentation passes; the pages themselves: `make check`."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def faults(root: Path) -> list[str]:
    """What `docs/generate.py` finds wrong with the pages under `root`."""
    code = (
        "import sys; from pathlib import Path; from pages import checks;"
        "print('\\n'.join(checks.faults(Path(sys.argv[1]))))"
    )
    command = [sys.executable, "-c", code, str(root)]
    done = subprocess.run(command, cwd=ROOT / "docs", capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


@pytest.mark.slow
def test_links_lead_somewhere_and_examples_are_taken() -> None:
    assert [line for line in faults(ROOT) if line] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[x](nowhere.md)", "README.md: the link to nowhere.md leads nowhere"),
        ("![x](docs/none.png)", "docs/none.png leads nowhere"),
        ("# Some heading\n[x](#some-headin)", "#some-headin: no such heading"),
        ("```toml\n[mission]\nstep = 3\n```", "mission.step: unknown key; did you mean steps?"),
        (
            "    aerofed run --steps 8",
            "refused: aerofed run --steps 8: Unknown option",
        ),
    ],
)
def test_what_is_wrong_is_found(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text(f"# Aerofed\n[fine](#aerofed)\n{text}\n")
    assert words in faults(tmp_path)[0]
