"""The pictures of a run: drawn without a display or pyplot, and with something on them."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from matplotlib.image import imread
from matplotlib.lines import Line2D
from synthetic_flight import AREA, devices, fly

from mission.analysis.compare import compare_run
from mission.analysis.load import flown, load_run
from mission.base.errors import InputError
from mission.cli import call
from mission.figures.maps import overview, round_maps
from mission.figures.run import comparison_figure, draw_comparison, draw_run, learning_curves
from mission.log.records import RoundRecord, UplinkRecord
from mission.log.tables import Table
from mission.log.write.writer import FlightLog


def heights(line: Line2D) -> np.ndarray:
    return np.asarray(line.get_ydata(), dtype=np.float64)


@pytest.mark.slow
def test_a_run_gets_its_three_pictures(tmp_path: Path) -> None:
    fly(tmp_path, rounds=2)
    files = draw_run(tmp_path)
    assert [file.name for file in files] == ["map.png", "rounds.png", "learning.png"]
    for file in files:
        image = imread(file)
        assert min(image.shape[:2]) > 600
        assert 0.01 < (image[..., :3].min(axis=2) < 0.95).mean() < 0.6  # ink, and paper


@pytest.mark.slow
def test_a_picture_has_the_bytes_that_matplotlib_itself_saves(tmp_path: Path) -> None:
    fly(tmp_path, rounds=2)
    draw_run(tmp_path)
    run = load_run(tmp_path).data
    drawn = {
        "map": overview(run),
        "rounds": round_maps(run),
        "learning": learning_curves(run.rounds),
    }
    for name, figure in drawn.items():
        figure.savefig(tmp_path / "plain.png")
        ours = tmp_path / "figures" / f"{name}.png"
        assert ours.read_bytes() == (tmp_path / "plain.png").read_bytes()


def test_maps_show_the_planned_and_the_true_path_with_equal_axes(tmp_path: Path) -> None:
    fly(tmp_path, rounds=2)
    run = load_run(tmp_path).data
    for figure in (overview(run), round_maps(run)):
        axes = figure.axes[0]
        assert axes.get_aspect() == 1.0
        drawn = [line.get_xydata() for line in axes.lines]
        track = flown(run, run.rounds[0]).pos_m[:, :2]
        assert any(np.array_equal(d, run.plans[0].waypoints_m) for d in drawn)
        assert any(np.array_equal(d, track) for d in drawn)


@pytest.mark.slow
def test_many_rounds_are_thinned_to_twelve_maps_with_first_and_last(tmp_path: Path) -> None:
    fly(tmp_path, rounds=15)
    shown = [axes for axes in round_maps(load_run(tmp_path).data).axes if axes.get_visible()]
    titles = [axes.get_title(loc="left") for axes in shown]
    assert len(titles) == 12
    assert titles[0].startswith("round 1 ")
    assert titles[-1].startswith("round 15 ")


def test_curves_are_percent_and_cov_by_round(tmp_path: Path) -> None:
    made = fly(tmp_path, rounds=3)
    accuracy, cov, _ = learning_curves(made.rounds).axes
    for name, line in zip(made.rounds[0].accuracy, accuracy.lines, strict=True):
        np.testing.assert_allclose(heights(line), [100 * r.accuracy[name] for r in made.rounds])
    for name, line in zip(made.rounds[0].cov, cov.lines, strict=True):
        np.testing.assert_allclose(heights(line), [r.cov[name] for r in made.rounds])


@pytest.mark.slow
def test_runs_side_by_side(tmp_path: Path) -> None:
    runs = []
    for name, seed in (("one", 1), ("two", 2)):
        (tmp_path / name).mkdir()
        fly(tmp_path / name, rounds=2, seed=seed)
        runs.append(compare_run(load_run(tmp_path / name)))
    figure = comparison_figure(runs)
    for run, line in zip(runs, figure.axes[2].lines, strict=True):
        np.testing.assert_allclose(heights(line), [r.true_objective for r in run.rounds])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["one", "two"]
    assert draw_comparison(runs, tmp_path / "c.png").stat().st_size > 10_000
    with pytest.raises(InputError, match="not a kind of picture"):
        draw_comparison(runs, tmp_path / "c.txt")
    with pytest.raises(InputError, match="cannot write"):
        draw_comparison(runs, tmp_path / "no" / "c.png")


def test_a_run_without_a_round_gets_no_picture(tmp_path: Path) -> None:
    world = devices(np.random.default_rng(1))
    with (
        FlightLog(tmp_path / "flight.mcap", area=AREA, devices=world),
        Table(tmp_path / "rounds.csv", RoundRecord, communities=world.communities),
        Table(tmp_path / "uplinks.csv", UplinkRecord),
    ):
        pass
    assert draw_run(tmp_path) == ()


def test_what_is_no_run_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a run folder"):
        draw_run(tmp_path)


@pytest.mark.slow
def test_pyplot_is_never_imported() -> None:
    code = "import sys, mission.figures.run; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
def test_compare_draws_where_it_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = fly(tmp_path, rounds=2)
    target = tmp_path / "both.svg"
    assert call(["compare", str(made.log), str(made.log), "--figure", str(target)]) == 0
    assert "Runs side by side" in capsys.readouterr().out
    assert ET.parse(target).getroot().tag.endswith("svg")
    assert call(["compare", str(made.log), "--figure", str(tmp_path / "no.xyz")]) == 2
    assert "not a kind of picture" in capsys.readouterr().err
