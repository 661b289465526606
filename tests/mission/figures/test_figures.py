"""The pictures of a run: what their descriptions promise, and that they become files."""

import itertools
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import Mock
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from described import axes, described, keys, layers, rows, tables
from drawing import drawn
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_flight import AREA, Fixed, devices, fly

from aerofed import first_problem, plan
from fl.radio.city import Building
from fl.radio.place import RadioMap
from mission.analysis.compare import compare_run
from mission.analysis.load import LoadedRun, flown, load_run
from mission.base.airspace import thin
from mission.base.arrays import Floats
from mission.base.errors import AerofedError, InputError
from mission.cli import call
from mission.figures import render
from mission.figures.charts import DotRow, Series, bar_chart, dot_rows, line_chart, ticks
from mission.figures.conditions import along_chart
from mission.figures.frame import MapFrame
from mission.figures.learning import learning_charts, radio_charts
from mission.figures.maps import overview, round_map, round_maps
from mission.figures.plan import plan_picture
from mission.figures.radio import gain_picture, plan_errors
from mission.figures.render import save, save_all, stacked
from mission.figures.run import comparison_figure, draw_run
from mission.figures.style import SOFT
from mission.figures.words import Drawn, Look, Word, words
from mission.log.records import RoundRecord, UplinkRecord
from mission.log.tables import Table
from mission.log.values import LearningRecord, Zone
from mission.log.writer import FlightLog

PNG = b"\x89PNG\r\n"


Made = Callable[[int], tuple[Fixed, LoadedRun]]


@pytest.fixture(scope="module")
def made_run(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Made-up runs of so many rounds: one of each for all tests, which only read it."""

    @cache
    def made(rounds: int) -> tuple[Fixed, LoadedRun]:
        folder = tmp_path_factory.mktemp(f"of-{rounds}-rounds")
        return fly(folder, rounds=rounds), load_run(folder)

    return made


def size_of(png: bytes) -> tuple[int, int]:
    return int.from_bytes(png[16:20], "big"), int.from_bytes(png[20:24], "big")


def written(spec: dict[str, Any]) -> set[str]:
    """The words beside the marks of a map."""
    return {row["word"] for table in tables(spec, "word") for row in table}


@pytest.mark.slow
def test_a_run_gets_its_three_pictures_the_same_each_time(tmp_path: Path) -> None:
    fly(tmp_path, rounds=2)
    with drawn():
        files = draw_run(tmp_path)
        first = [file.read_bytes() for file in files]
        assert [file.read_bytes() for file in draw_run(tmp_path)] == first
    assert [file.name for file in files] == ["map.png", "rounds.png", "learning.png"]
    assert all(content.startswith(PNG) and min(size_of(content)) > 800 for content in first)


@pytest.mark.slow
def test_every_picture_says_which_run_and_seed_it_is_of(tmp_path: Path) -> None:
    fly(tmp_path, rounds=2)
    (tmp_path / "summary.json").write_text('{"strategy": "cov", "status": "finished"}')
    run = load_run(tmp_path)
    assert run.about == f"{tmp_path.name} · strategy cov · seed 1"  # the seed: its configuration
    for picture in (overview(run.data, run.about), round_maps(run.data, run.about)):
        assert described(picture)["title"]["subtitle"] == run.about
    whole = stacked(learning_charts(run.data), title="What was learnt", about=run.about)
    assert described(whole)["title"]["subtitle"] == run.about


def test_maps_show_the_planned_and_the_true_path_to_scale(made_run: Made) -> None:
    run = made_run(2)[1].data
    spec = described(round_map(run, run.plans[:1]))
    path = rows(spec, "kind", "part")
    planned = np.array([(row["x"], row["y"]) for row in path if row["kind"] == "planned"])
    np.testing.assert_allclose(planned, run.plans[0].waypoints_m, rtol=1e-5)
    drawn = np.array([(row["x"], row["y"]) for row in path if row["kind"] == "flown"])
    track = flown(run, run.rounds[0]).pos_m[:, :2]
    np.testing.assert_allclose(drawn[[0, -1]], track[[0, -1]], rtol=1e-5)
    wide, high = (
        np.ptp(next(iter(layers(spec)))["encoding"][axis]["scale"]["domain"]) for axis in "xy"
    )
    assert spec["height"] / spec["width"] == pytest.approx(high / wide)
    assert axes(spec) == {"east (m)", "north (m)"}


def test_a_map_explains_its_lines_sizes_colours_and_what_became_of_updates(made_run: Made) -> None:
    made, read = made_run(2)
    run = read.data
    spec = described(round_map(run, run.plans[:1]))
    found = keys(spec)
    assert found["stroke"] == ["area", "planned", "flown"]
    assert found["fill"] == ["digits", "colour-shapes"]
    assert found["shape"] == ["delivered", "lost", "not served"]
    sizes = [layer["encoding"]["size"] for layer in layers(spec) if "size" in layer["encoding"]]
    assert sizes[0]["legend"]["title"] == "importance"
    assert sizes[0]["scale"]["domain"] == [0.0, pytest.approx(0.25)]
    served = {u.device: u.delivered for u in made.uplinks if u.round == 1}
    for row in rows(spec, "device", "outcome"):
        state = {True: "delivered", False: "lost", None: "not served"}[served.get(row["device"])]
        assert row["outcome"] == state
    assert {str(device) for device in range(len(run.devices.community))} <= written(spec)


def test_areas_that_must_not_be_flown_have_their_names_on_the_map(made_run: Made) -> None:
    ring = np.array([[100.0, 100.0], [200.0, 100.0], [150.0, 220.0]])
    text = f"[[area.no_fly]]\nname = 'pond'\npolygon_m = {ring.tolist()}\n"
    text += "[[area.no_fly]]\nname = 'overhead'\nto_m = 40\npolygon_m = [[0, 0], [1, 0], [0, 1]]\n"
    run = replace(
        made_run(1)[1].data, fence=(Zone(ring, keep_in=False),),
        attachments={"config.toml": text.encode()},
    )  # fmt: skip
    spec = described(round_map(run, run.plans[:1]))
    marks = [layer["mark"] for layer in layers(spec)]
    at = {
        row["word"]: (layer["mark"]["dx"], layer["mark"]["dy"])
        for layer in layers(spec)
        if layer["mark"].get("color") == SOFT
        for row in spec["datasets"][layer["data"]["name"]]
    }
    assert set(at) == {"home", "start", "pond", "overhead up to 40 m"}
    assert at["pond"] == (0.0, 0.0)
    assert at["overhead up to 40 m"] != (0.0, 0.0), "it has no room for its name"
    assert [
        mark["strokeDash"] for mark in marks if mark.get("stroke") == SOFT and "strokeDash" in mark
    ] == [[3, 3]]


def test_the_map_of_all_rounds_tells_their_order_and_direction(made_run: Made) -> None:
    run = made_run(3)[1].data
    spec = described(overview(run, "run"))
    ends = {word for word in written(spec) if "end" in word}
    assert sorted(re.findall(r"\d+", " ".join(ends))) == ["1", "2", "3"]
    arrows = rows(spec, "heading")
    assert [row["round"] for row in arrows] == [1, 2, 3]
    for row in arrows:
        ahead = np.array([np.sin(np.radians(row["heading"])), np.cos(np.radians(row["heading"]))])
        record = run.rounds[row["round"] - 1]
        track = flown(run, record).pos_m[:, :2]
        nearest = int(np.linalg.norm(track - (row["x"], row["y"]), axis=1).argmin())
        later = track[nearest + 5] - track[nearest - 5]
        assert later @ ahead > 0.9 * np.linalg.norm(later)
    # Planned paths lie above the flown ones, and later rounds are thinner than those before.
    kinds = [layer["mark"] for layer in layers(spec)]
    dashed = next(index for index, mark in enumerate(kinds) if mark.get("strokeDash"))
    ((index, width),) = [
        (index, layer["transform"][0])
        for index, layer in enumerate(layers(spec))
        if layer["encoding"].get("strokeWidth", {}).get("field") == "width"
    ]
    assert index < dashed
    assert width == {"as": "width", "calculate": "2.6 + 1.1 * (3 - datum.round)"}


@pytest.mark.slow
def test_one_key_says_what_fence_and_areas_look_like(tmp_path: Path, made_run: Made) -> None:
    ring = np.array([[10.0, 10.0], [60.0, 10.0], [60.0, 60.0]])
    run = replace(made_run(2)[1].data, fence=(Zone(ring, keep_in=False),))
    save(overview(run, ""), tmp_path / "map.svg")
    drawn = [text.text for text in ET.parse(tmp_path / "map.svg").iter() if text.text]
    assert drawn.count("no-fly area") == 1


@pytest.mark.slow
def test_rounds_that_are_many_are_coloured_alone(made_run: Made) -> None:
    spec = described(overview(made_run(13)[1].data, "run"))
    assert not tables(spec, "heading")
    assert not any("end" in word for word in written(spec))


@pytest.mark.parametrize("count", [2, 12, 24])
def test_words_cover_neither_each_other_nor_dots_where_there_is_room(count: int) -> None:
    """By the boxes of their letters, as Vega places them."""
    frame = MapFrame(np.zeros(2), np.full(2, 500.0), 500.0)
    rng = np.random.default_rng(count)
    grid = np.stack(np.meshgrid(np.arange(1.0, 9.0), np.arange(1.0, 9.0)), axis=-1).reshape(-1, 2)
    # Pairs that stand so near that the usual side would cover the other's dot.
    places = 55.0 * rng.permutation(grid)[: count // 2]
    at_m = np.vstack((places, places + np.array([14.0, 9.0])))
    dots = np.column_stack((at_m, np.full(len(at_m), 6.0)))
    items = [Word(str(k), tuple(at)) for k, at in enumerate(at_m)]
    charts = words(frame, [(Look(), items)], Drawn(dots, []))
    boxes = []
    for chart in charts[len(charts) // 2 :]:  # over the rims
        mark = chart.to_dict()["mark"]
        for row in chart.data["values"]:
            wide, high = 0.56 * mark["fontSize"] * len(row["word"]), 0.7 * mark["fontSize"]
            left = row["x"] + mark["dx"]
            left -= {"left": 0.0, "center": wide / 2.0, "right": wide}[mark["align"]]
            middle = 500.0 - row["y"] + mark["dy"]
            boxes.append((left, middle - high / 2.0, left + wide, middle + high / 2.0))
    assert len(boxes) == len(items)
    for one, other in itertools.combinations(boxes, 2):
        assert one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
    for box in boxes:
        for x, y in at_m:
            near = np.clip((x, 500.0 - y), box[:2], box[2:])
            assert np.hypot(*(near - (x, 500.0 - y))) > 5.0


def test_a_word_leaves_the_line_that_runs_through_its_usual_side() -> None:
    frame = MapFrame(np.zeros(2), np.full(2, 500.0), 500.0)

    def side(lines: list[tuple[int, Floats]], number: int = 0) -> tuple[float, float]:
        drawn = Drawn(np.empty((0, 3)), lines)
        chart = words(frame, [(Look(), [Word("start", (250.0, 250.0), number)])], drawn)[-1]
        mark = chart.to_dict()["mark"]
        return mark["dx"], mark["dy"]

    north_east = np.array([[250.0, 250.0], [350.0, 290.0]])
    dx, dy = side([])
    assert dx > 0.0 > dy
    assert side([(1, north_east)]) != (dx, dy)
    # A line of another round is never seen with it.
    assert side([(1, north_east)], 2) == (dx, dy)


def test_a_plan_s_devices_have_their_communities_colours() -> None:
    problem = first_problem("quickstart", {"mission.steps": 3})
    made = plan(problem)
    names = ["a"] * 6 + ["b"] * 6
    spec = described(plan_picture(problem, made, title="t", communities=names))
    assert keys(spec)["fill"] == ["a", "b"]
    assert [row["community"] for row in rows(spec, "community")] == names
    assert {"start", "0", "11"} <= written(spec)
    assert "fill" not in keys(described(plan_picture(problem, made, title="t")))
    assert not any("aircraft" in word for word in written(spec)), "alone it needs no name"


@pytest.mark.slow
def test_a_plan_shows_its_area_and_names_what_must_not_be_flown(tmp_path: Path) -> None:
    no_fly = [{"name": "pond", "polygon_m": [[10.0, 10.0], [60.0, 10.0], [60.0, 60.0]]}]
    fence = [[-90, -90], [1900, -90], [-90, 1900]]
    settings = {"mission.steps": 3, "area.no_fly": no_fly, "area.fence_m": fence}
    problem = first_problem("quickstart", settings)
    size_m = (800.0, 800.0)
    picture = plan_picture(problem, plan(problem), title="t", size_m=size_m, no_fly=no_fly)
    spec = described(picture)
    assert "pond" in written(spec)
    lines = [row for table in tables(spec, "kind") for row in table]
    edge = [(row["x"], row["y"]) for row in lines if row["kind"] == "area"]
    assert edge == [(0, 0), (800, 0), (800, 800), (0, 800), (0, 0)]
    save(picture, tmp_path / "plan.svg")
    drawn = [text.text for text in ET.parse(tmp_path / "plan.svg").iter() if text.text]
    assert [drawn.count(word) for word in ("area", "fence", "no-fly area")] == [1, 1, 1]


@pytest.mark.parametrize("away_m", [0.0, 5000.0])
def test_small_maps_of_rounds_name_the_areas_on_them(away_m: float, made_run: Made) -> None:
    ring = away_m + np.array([[10.0, 10.0], [60.0, 10.0], [60.0, 60.0]])
    name = "the pond of the village"
    text = f"[[area.no_fly]]\nname = '{name}'\npolygon_m = {ring.tolist()}\nfrom_m = 500.0\n"
    run = replace(made_run(1)[1].data, attachments={"config.toml": text.encode()})
    drawn = written(described(round_map(run, run.plans[:1], width=300.0)))
    assert (f"{name} from 500 m" in drawn) == (away_m == 0.0)


def test_the_map_of_several_rounds_says_that_importance_is_their_mean(made_run: Made) -> None:
    run = made_run(3)[1].data

    def title(plans: int) -> str:
        spec = described(overview(replace(run, plans=run.plans[:plans]), ""))
        sizes = (layer["encoding"].get("size", {}) for layer in layers(spec))
        (found,) = (size["legend"]["title"] for size in sizes if "legend" in size)
        return str(found)

    assert (title(1), title(3)) == ("importance", "mean importance")


def test_dots_are_as_large_as_the_most_important_device_of_all_rounds_allows(
    made_run: Made,
) -> None:
    run = made_run(3)[1].data
    plans = [
        replace(item, importance=share * item.importance)
        for item, share in zip(run.plans, (1.0, 3.0, 2.0), strict=True)
    ]
    spec = described(round_map(replace(run, plans=tuple(plans)), plans))
    most = 3.0 * max(float(item.importance.max()) for item in run.plans)
    sizes = [layer["encoding"].get("size", {}) for layer in layers(spec)]
    assert {size["scale"]["domain"][1] for size in sizes if "legend" in size} == {most}


def test_each_name_has_its_own_colour() -> None:
    looks = {"first": "#111111", "second": "#222222", "third": "#333333"}
    x, y = np.arange(3.0), np.arange(3.0)
    made = (
        dot_rows("", [DotRow(n, c, (1.0, 2.0), 1.5, (1.0, 2.0)) for n, c in looks.items()], x=""),
        line_chart("", [Series(n, c, x, y) for n, c in looks.items()], x="", y=""),
        bar_chart("", [Series(n, c, x, y) for n, c in looks.items()], x="", y=""),
    )
    for chart in made:
        coloured = [layer["encoding"].get("color", {}) for layer in layers(described(chart))]
        scales = [colour["scale"] for colour in coloured if "scale" in colour]
        assert scales
        for scale in scales:
            assert dict(zip(scale["domain"], scale["range"], strict=True)) == looks


@pytest.mark.parametrize("zero", [False, True])
@pytest.mark.parametrize("ends", [None, (1.0, 2.0)])
def test_dots_lie_over_their_bar_and_that_over_the_line_of_zero(
    zero: bool, ends: tuple[float, float] | None
) -> None:
    row = DotRow("a", "#111111", (1.0, 2.0), 1.5, ends)
    marks = [layer["mark"] for layer in layers(described(dot_rows("", [row], x="", zero=zero)))]
    bars = [mark.get("strokeWidth") for mark in marks if mark["type"] == "rule"]
    assert bars == [*([None] if zero else []), *([5] if ends else [])]
    assert [mark.get("filled") for mark in marks[len(bars) :]] == [False, True]


@pytest.mark.slow
def test_a_page_chooses_a_round_by_a_parameter(made_run: Made) -> None:
    read = made_run(3)[1]
    run = read.data
    for chart in (round_map(run, run.plans), along_chart(compare_run(read))):
        spec = described(chart)
        assert {"name": "shown", "value": 1} in spec["params"]
        filters = [str(layer.get("transform", "")) for layer in layers(spec)]
        assert all("datum.round == shown" in item for item in filters[2:])
    assert {row["round"] for row in rows(described(round_map(run, run.plans)), "outcome")} == {
        1, 2, 3,
    }  # fmt: skip


@pytest.mark.slow
def test_many_rounds_are_thinned_to_twelve_maps_with_first_and_last(made_run: Made) -> None:
    spec = described(round_maps(made_run(13)[1].data, "run"))
    titles = [panel["title"]["text"] for panel in spec["concat"]]
    assert len(titles) == 12
    assert titles[0].startswith("round 1 ")
    assert titles[-1].startswith("round 13 ")
    assert "12 of 13 rounds" in spec["title"]["subtitle"]


@pytest.mark.slow
def test_a_picture_of_one_round_is_as_wide_as_its_keys(tmp_path: Path, made_run: Made) -> None:
    """Vega makes room for axes, titles and keys around what is described."""
    picture = round_maps(made_run(1)[1].data, "run")
    save(picture, tmp_path / "one.svg")
    root = ET.parse(tmp_path / "one.svg").getroot()
    described_width = described(picture)["concat"][0]["width"]
    assert float(root.attrib["width"]) > described_width
    texts = {"".join(node.itertext()) for node in root.iter() if node.tag.endswith("text")}
    assert {"planned", "flown", "delivered", "lost", "not served", "importance"} <= texts


def test_keys_fit_the_narrowest_place() -> None:
    for names in (["a"], ["a", "b"], ["a long name of a strategy, with settings"] * 5, ["x"] * 30):
        series = [Series(f"{name}{k}", "#000000", [1], [1]) for k, name in enumerate(names)]
        spec = described(line_chart("t", series, x="x", y="y"))
        legend = next(layers(spec))["encoding"]["color"]["legend"]
        widest = 32 + 6.2 * max(len(item.label) for item in series)
        assert legend["columns"] == 1 or legend["columns"] * widest <= 300


def test_curves_are_percent_and_cov_by_round(made_run: Made) -> None:
    made, read = made_run(3)
    run = read.data
    accuracy, cov, updates = map(described, learning_charts(run))

    def values(spec: dict, name: str) -> list[float]:  # type: ignore[type-arg]
        return [row["y"] for row in rows(spec, "series", "y") if row["series"] == name]

    for name in made.rounds[0].accuracy:
        np.testing.assert_allclose(
            values(accuracy, name), [100 * r.accuracy[name] for r in made.rounds], rtol=1e-5
        )
        np.testing.assert_allclose(values(cov, name), [r.cov[name] for r in made.rounds], rtol=1e-5)
    # It holds until it is computed again.
    lines = [layer["mark"] for layer in layers(cov) if layer["mark"]["type"] == "line"]
    assert [line["interpolate"] for line in lines] == ["step-after"]
    assert values(updates, "delivered") == [r.delivered for r in made.rounds]
    # Another aircraft of the same rounds, which serves others.
    other = replace(run, uplinks=tuple(replace(u, device=u.device + 100) for u in run.uplinks))
    of_two = described(learning_charts(run, [other])[2])
    for name in ("scheduled", "delivered"):
        sent = [
            {
                u.device
                for u in run.uplinks
                if u.round == r.round and (name == "scheduled" or u.delivered)
            }
            for r in made.rounds
        ]
        assert values(of_two, name) == [2 * len(of) for of in sent]
    assert axes(accuracy) == {"round", "accuracy (%)"}


def test_accuracy_begins_with_the_untrained_models_where_the_log_has_them(made_run: Made) -> None:
    run = made_run(2)[1].data
    names = run.devices.communities
    untrained = tuple(LearningRecord(0, 0, name, 0.1, 1.0, 2.0) for name in names)
    begun = replace(run, learning=(*untrained, *run.learning))
    accuracy, _, _ = map(described, learning_charts(begun))
    found = [row for row in rows(accuracy, "series", "y") if row["series"] == "digits"]
    assert [row["x"] for row in found] == [0, 1, 2]
    assert next(layers(accuracy))["encoding"]["x"]["axis"]["values"] == [0, 1, 2]
    assert found[0]["y"] == 10.0


@pytest.mark.slow
def test_runs_side_by_side(tmp_path: Path) -> None:
    runs = []
    for name, seed in (("one", 1), ("two", 2)):
        (tmp_path / name).mkdir()
        fly(tmp_path / name, rounds=1, seed=seed)
        runs.append(compare_run(load_run(tmp_path / name)))
    spec = described(comparison_figure(runs))
    assert keys(spec)["color"] == ["one · seed 1", "two · seed 1"]
    assert axes(spec) == {
        "round",
        "distance (m)",
        "delay (s)",
        "importance times success",
        "updates",
    }
    panel = spec["vconcat"][2]
    name = (panel if "data" in panel else next(layers(panel)))["data"]["name"]
    for run, label in zip(runs, keys(spec)["color"], strict=True):
        drawn = [row["y"] for row in spec["datasets"][name] if row["series"] == label]
        np.testing.assert_allclose(drawn, [r.true_objective for r in run.rounds], rtol=1e-5)
    moved = replace(runs[1].run, path=tmp_path / "other" / "one")
    alike = described(comparison_figure([runs[0], replace(runs[1], run=moved)]))
    assert keys(alike)["color"] == [f"{tmp_path.name}/one", "other/one"]
    with pytest.raises(InputError, match="not a kind of picture"):
        save(comparison_figure(runs), tmp_path / "c.txt")
    with pytest.raises(InputError, match="cannot write"):
        save(comparison_figure(runs), tmp_path / "no" / "c.png")


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
    wanted = r"not a run folder: it has no flight.mcap, nor another flight log$"
    with pytest.raises(InputError, match=wanted):
        draw_run(tmp_path)


def test_an_engine_that_dies_is_one_error_and_leaves_the_old_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As V8 does where it finds no memory: it ends its process, which is not ours."""
    chart = line_chart("t", [Series("a", "#000000", [1, 2], [1, 2])], x="x (m)", y="y (m)")
    (old := tmp_path / "a.png").write_bytes(b"old")
    dying = tmp_path / "engine.py"
    dying.write_text(
        "import os, sys\nsys.stdin.read()\n"
        "print('# Fatal process out of memory', file=sys.stderr, flush=True)\nos.abort()\n"
    )
    monkeypatch.setattr(render, "_ENGINE", dying)
    with (
        drawn(),
        pytest.raises(AerofedError, match="ended with code -6: Fatal process out of memory"),
    ):
        save_all({"a.png": chart}, tmp_path)
    assert old.read_bytes() == b"old"


@pytest.mark.slow
def test_nothing_that_draws_is_loaded_before_something_is_drawn() -> None:
    code = (
        "import sys, mission.cli, mission.run.session, mission.run.plan_flight\n"
        "sys.exit(bool({'altair', 'vl_convert', 'matplotlib.pyplot', 'jinja2'} & {*sys.modules}))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
def test_compare_draws_where_it_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], made_run: Made
) -> None:
    made = made_run(2)[0]
    target = tmp_path / "both.svg"
    assert call(["compare", str(made.log), str(made.log), "--figure", str(target)]) == 0
    assert "Runs side by side" in capsys.readouterr().out
    assert ET.parse(target).getroot().tag.endswith("svg")
    assert call(["compare", str(made.log), "--figure", str(tmp_path / "no.xyz")]) == 2
    assert "not a kind of picture" in capsys.readouterr().err


def test_every_error_rate_and_every_update_is_on_its_chart(made_run: Made) -> None:
    made, run = made_run(2)
    comparison = compare_run(run)
    objective, rates, participation = map(described, radio_charts(run.data, comparison))
    assert axes(objective) == {"round", "importance times success"}
    drawn = rows(rates, "kind", "per")
    for device in comparison.devices:
        mine = {row["kind"]: row["per"] for row in drawn if row["device"] == device.device}
        if device.scheduled:
            assert mine["true"] == pytest.approx(device.true_per, rel=1e-5)
            assert mine["planned"] == pytest.approx(device.plan_per, rel=1e-5)
    assert len(rows(participation, "update")) == len(made.uplinks)
    assert axes(participation) == {"round", "device"}


# To a micrometre: the squares of distances far below vanish, which GEOS divides by.
METRES = st.floats(-500, 500).map(lambda at_m: round(at_m, 6))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(METRES, METRES), min_size=2, max_size=60))
def test_thinning_stays_within_its_tolerance(points: list[tuple[float, float]]) -> None:
    path = np.array(points)
    kept = thin(path, 5.0)
    np.testing.assert_array_equal(kept[[0, -1]], path[[0, -1]])
    dense = np.vstack([np.linspace(a, b, 2001) for a, b in itertools.pairwise(kept)])
    for point in path:
        assert np.linalg.norm(dense - point, axis=1).min() < 5.0 + 0.5


def test_a_straight_track_thins_to_its_ends() -> None:
    line = np.column_stack((np.linspace(0, 100, 500), np.zeros(500)))
    assert len(thin(line, 0.1)) == 2


@given(st.integers(1, 500), st.integers(1, 3))
def test_labels_of_whole_numbers_are_few_and_round(count: int, first: int) -> None:
    found = ticks(range(first, first + count))
    assert found[0] == first
    assert len(found) <= 14
    assert found == sorted(set(found))


@pytest.fixture
def bundled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], str]:
    """What makes the libraries as a new process does, which has only the cache folder."""
    monkeypatch.setattr(render, "engine", lambda _: Mock(poll=lambda: None))
    monkeypatch.setattr(render, "_begun", [])
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def as_anew() -> str:
        monkeypatch.setattr(render, "libraries", cache(render.libraries.__wrapped__))
        render.begin_libraries()
        return render.libraries()

    return as_anew


def test_libraries_are_made_again_where_they_failed_before(
    bundled: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where Ctrl-C ended their process, in a notebook that goes on."""
    results = Mock(side_effect=[AerofedError("no memory"), [b"script"]])
    monkeypatch.setattr(render, "_results", results)
    with pytest.raises(AerofedError, match="no memory"):
        bundled()
    assert render.libraries() == "script"


def test_libraries_are_kept_and_damaged_ones_made_again(
    bundled: Callable[[], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = "script\n" * 99
    results = Mock(side_effect=lambda *_: [script.encode()])
    monkeypatch.setattr(render, "_results", results)
    assert [bundled() for _ in range(3)] == [script] * 3
    assert results.call_count == 1
    (kept,) = (tmp_path / "cache" / "aerofed" / "pages").iterdir()
    whole = kept.read_bytes()
    for damaged in (b"", whole[:-1], whole.replace(b"t\ns", b"t\nS"), whole + b"more"):
        kept.write_bytes(damaged)
        assert [bundled(), bundled()] == [script] * 2
        assert kept.read_bytes() == whole
    assert results.call_count == 5
    monkeypatch.setattr(render, "_VERSION", "9.9")  # a newer one is another file
    script = "newer"
    assert [bundled(), bundled()] == ["newer"] * 2
    assert results.call_count == 6


@pytest.mark.parametrize("why", ["a file is there", "nobody's home"])
def test_libraries_are_made_each_time_where_they_cannot_be_kept(
    bundled: Callable[[], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, why: str
) -> None:
    (tmp_path / "cache").touch()
    if why == "nobody's home":
        monkeypatch.delenv("XDG_CACHE_HOME")
        monkeypatch.setattr(Path, "home", Mock(side_effect=RuntimeError))
    monkeypatch.setattr(render, "_results", results := Mock(return_value=[b"script"]))
    assert [bundled(), bundled()] == ["script"] * 2
    assert results.call_count == 2


def test_a_map_tells_the_heights_of_buildings() -> None:
    court = np.array([[5.0, 5.0], [9.0, 5.0], [9.0, 9.0]])
    house = Building((np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0]]), court), 30.0)
    hut = Building((np.array([[50.0, 0.0], [60.0, 0.0], [60.0, 20.0]]),), 4.0)
    problem = first_problem("quickstart")
    spec = described(plan_picture(problem, plan(problem), title="t", buildings=(house, hut)))
    assert keys(spec)["opacity"] == [0.0, 30.0]
    assert [row["height"] for row in rows(spec, "height")] == [30.0] * 4 + [4.0] * 4
    assert "opacity" not in keys(described(plan_picture(problem, plan(problem), title="t")))


def test_a_picture_of_gains_is_of_the_device_and_covers_the_area() -> None:
    x_m, y_m = np.arange(5.0, 400.0, 10.0), np.arange(0.5, 450.0, 1.0)
    gain_db = -np.random.default_rng(1).uniform(80.0, 120.0, (2, 2, len(y_m), len(x_m)))
    made = RadioMap(
        gain_db, np.array([50.0, 60.0]), y_m, x_m, np.array([[1.0, 2.0], [300.0, 40.0]])
    )
    wall = np.array([[100.0, 100.0], [120.0, 100.0], [120.0, 130.0]])
    spec = described(gain_picture(made, 1, [Building((wall,), 9.0)], about="a town"))
    assert spec["title"]["text"] == "Path gain from device 1 to places 50 m above home"
    cells = rows(spec, "gain")
    assert len(cells) == 40 * 150  # of three rows, one is shown
    assert cells[41]["gain"] == pytest.approx(gain_db[1, 0, 3, 1], abs=0.06)
    assert (cells[41]["x"], cells[41]["y"]) == (10.0, 3.0)
    assert min(row["x"] for row in cells) == min(row["y"] for row in cells) == 0.0
    assert max(row["x2"] for row in cells) == pytest.approx(400.0, abs=1.0)
    assert max(row["y2"] for row in cells) == pytest.approx(450.0, abs=1.0)
    assert (300.0, 40.0) in [
        (row["x"], row["y"]) for table in tables(spec, "round") for row in table
    ]
    single = RadioMap(gain_db[:, :1, :1, :1], made.height_m[:1], y_m[:1], x_m[:1], made.devices_m)
    (cell,) = rows(described(gain_picture(single, 0)), "gain")
    assert (cell["x"], cell["y"]) == (4.5, 0.0)
    assert (cell["x2"], cell["y2"]) == pytest.approx((5.5, 1.0), abs=0.01)


def test_where_the_plan_was_wrong_is_shown_where_the_truth_is_another(made_run: Made) -> None:
    run = made_run(3)[1].data
    assert not plan_errors(run)
    config = {"config.toml": b"radio.truth = 'buildings'"}
    (chart,) = plan_errors(replace(run, attachments=config))
    found = [(row["planned"], row["true"]) for row in rows(described(chart), "outcome")]
    assert np.array(found) == pytest.approx(
        np.array([(u.plan_per, u.true_per) for u in run.uplinks]), rel=1e-5
    )
