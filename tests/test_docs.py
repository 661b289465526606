"""The checks that every page of the documentation passes; the pages themselves: `make check`.

Of those that are made from the code some are looked at here, too: they have each key's default and
limits, each option, the columns of each file and each channel, which so change in two places.
"""

import importlib
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shapely import Polygon

from mission.config.loading import load_config

ROOT = Path(__file__).parents[1]


def faults(*roots: Path) -> list[list[str]]:
    """What `docs/generate.py` finds wrong with the pages under each of `roots`."""
    code = (
        "import json, sys; from pathlib import Path; from pages import checks;"
        "print(json.dumps([[*checks.faults(Path(root))] for root in sys.argv[1:]]))"
    )
    command = [sys.executable, "-c", code, *map(str, roots)]
    done = subprocess.run(command, cwd=ROOT / "docs", capture_output=True, text=True, check=True)
    found: list[list[str]] = json.loads(done.stdout)
    return found


def test_the_site_has_every_page_and_all_that_pages_lead_to() -> None:
    """Whose builder, mkdocs, the tests do not need: `make docs` fails where this does."""
    site, nav = (ROOT / "docs" / "site.py").read_text(), (ROOT / "mkdocs.yml").read_text()
    outside = dict(re.findall(r'^    "(\S+\.md)": "(\S+\.md)",$', site, re.MULTILINE))
    pages = {path.name: path.read_text() for path in (ROOT / "docs").glob("*.md")}
    assert set(re.findall(r": (\S+\.md)$", nav, re.MULTILINE)) == {*pages, *outside}
    links = {link for text in pages.values() for link in re.findall(r"\]\(\.\./([^)#]+)", text)}
    assert links <= {*outside.values(), "README.md"}


@pytest.mark.parametrize("name", ["channels", "commands", "configuration", "file-formats"])
def test_pages_that_the_code_makes_are_current(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs")
    pages = importlib.import_module("generate").PAGES
    page = f"{name}.md"
    assert pages[page]() == (ROOT / "docs" / page).read_text(encoding="utf-8")


@pytest.mark.slow
def test_links_lead_somewhere_and_examples_are_taken() -> None:
    assert faults(ROOT) == [[]]


@pytest.mark.slow
def test_what_is_wrong_is_found(tmp_path: Path) -> None:
    wrong = {
        "[x](nowhere.md)": "README.md: the link to nowhere.md leads nowhere",
        "![x](docs/none.png)": "docs/none.png leads nowhere",
        "# Some heading\n[x](#some-headin)": "#some-headin: no such heading",
        "```toml\n[mission]\nstep = 3\n```": "mission.step: unknown key; did you mean steps?",
        "    aerofed run --steps 8": "refused: aerofed run --steps 8: Unknown option",
    }
    roots = [tmp_path / f"{number}" for number in range(len(wrong))]
    for root, text in zip(roots, wrong, strict=True):
        (root / "docs").mkdir(parents=True)
        (root / "README.md").write_text(f"# Aerofed\n[fine](#aerofed)\n{text}\n")
    for (first, *_), words in zip(faults(*roots), wrong.values(), strict=True):
        assert words in first


def test_a_picture_of_cells_becomes_a_world(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs" / "studies")
    monkeypatch.chdir(tmp_path)
    import grid_city

    colours = {
        ".": (0, 0, 0),
        "g": (0, 255, 0),
        "Y": (255, 255, 0),
        "R": (255, 0, 0),
        "b": (0, 0, 255),
    }
    lines = ("ggg.R", "g.g..", "gggY.", "....b")
    pixels = np.zeros((4, 5, 3), dtype=np.uint8)
    for at in np.ndindex(4, 5):
        pixels[at] = colours[lines[at[0]][at[1]]]
    grid_city.write("world", pixels, 20.0, 40.0, 80.0)
    area = load_config(Path("world.toml")).area
    court, tower = area.buildings
    assert (court.height_m, tower.height_m) == (40.0, 80.0)
    assert area.size_m == (100.0, 80.0)
    assert area.home_m == (90.0, 10.0)
    (zone,) = area.no_fly
    rings = tower.polygon_m, zone.polygon_m
    found = [Polygon(court.polygon_m, court.holes_m), *map(Polygon, rings)]
    expected = [
        Polygon([(0, 20), (60, 20), (60, 80), (0, 80)], [[(20, 40), (40, 40), (40, 60), (20, 60)]]),
        Polygon([(60, 20), (80, 20), (80, 40), (60, 40)]),
        Polygon([(80, 60), (100, 60), (100, 80), (80, 80)]),
    ]
    for one, other in zip(found, expected, strict=True):
        assert one.symmetric_difference(other).area < 3.0
    assert len(court.polygon_m) == 4  # along a wall there are no corners
