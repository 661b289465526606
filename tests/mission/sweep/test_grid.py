"""Which runs a sweep consists of, and what it refuses."""

import errno
import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from mission.base.errors import InputError
from mission.base.run_folder import RunFolder
from mission.cli import call
from mission.config.loading import builtin_config, load_config
from mission.scenario.scenario import build_scenario
from mission.scenario.strategies import CustomStrategy
from mission.sweep.execute.engine import EngineChoice
from mission.sweep.folder import (
    Missing,
    SweepFolder,
    SweepState,
    points_of,
    read_manifest,
    rounds_in,
)
from mission.sweep.grid import Axis, Grid, Point, make_grid, parse_axis
from mission.sweep.results import RunResult

QUICK = builtin_config("quickstart.toml")


def grid(*, strategies: tuple[str, ...] = ("cov", "ideal"), seeds: int = 2, **more: Any) -> Grid:
    axes = [parse_axis(text) for text in more.pop("sets", ())]
    return make_grid(QUICK, strategies=strategies, seeds=seeds, axes=axes, **more)


def test_every_strategy_with_every_seed_and_value() -> None:
    found = grid(
        sets=["channel.extra_gain_db=0,3", "mission.steps=5"], common={"mission.rounds": 7}
    )
    assert [(r.strategy, r.keys["channel.extra_gain_db"], r.seed) for r in found.runs] == [
        ("cov", 0, 1), ("ideal", 0, 1), ("cov", 3, 1), ("ideal", 3, 1),
        ("cov", 0, 2), ("ideal", 0, 2), ("cov", 3, 2), ("ideal", 3, 2),
    ]  # fmt: skip
    for run in found.runs:
        mission = run.config.mission
        assert (mission.strategy, run.config.seed) == (run.strategy, run.seed)
        assert (mission.steps, mission.rounds) == (5, 7)
        assert run.config.channel.extra_gain_db == run.keys["channel.extra_gain_db"]
    # One value is common to all and tells no run from another.
    assert "mission.steps" not in found.runs[0].keys
    assert found.runs[2].name == "cov-extra_gain_db=3-seed1"


def test_names_are_unique_and_fit_for_files() -> None:
    found = grid(sets=["area.size_m=[800,800],[800, 801]", "communities.0.task=digits"], seeds=1)
    names = [run.name for run in found.runs]
    assert len(set(names)) == len(names) == 4
    assert all("/" not in name and " " not in name and len(name) < 120 for name in names)


def test_a_strategy_of_ones_own_goes_by_its_label_everywhere(tmp_path: Path) -> None:
    given = ("cov", "stale=examples.staleness:make")
    found = grid(strategies=given, seeds=1)
    assert [run.name for run in found.runs] == ["cov-seed1", "stale-seed1"]
    assert (found.runs[1].label, found.runs[1].keys["strategy"]) == ("stale", "stale")
    assert found.runs[1].config.mission.strategy == given[1]
    assert found.runs[1].config.run_name == "quickstart-stale-seed1"
    scenario = build_scenario(found.runs[1].config, data_dir=None)
    assert isinstance(scenario.strategy, CustomStrategy)
    folder = SweepFolder(tmp_path)
    folder.claim(found, data_dir=None)
    again = points_of(read_manifest(tmp_path))
    assert [point.strategy for point in again] == ["cov", "stale"]
    with pytest.raises(InputError, match="'cov' is named twice"):
        grid(strategies=("cov", "cov=examples.staleness:make"))


@pytest.mark.parametrize(
    ("point", "name"),
    [
        (
            Point("no_cov", 2, (("channel.preset", "suburban+10dB"),)),
            "no_cov-preset=suburban+10dB-seed2",
        ),
        (Point("examples.staleness:make", 1, ()), "examples.staleness-make-seed1-1be82c90"),
    ],
)
def test_names_are_as_documented(point: Point, name: str) -> None:
    assert point.name == name


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a.b=1,2.5", (1, 2.5)),
        ("a=no_cov,cov", ("no_cov", "cov")),
        ("a=[1,2],[3,4]", ([1, 2], [3, 4])),
        ('a="x,y",z', ("x,y", "z")),
        ("a=true", (True,)),
    ],
)
def test_values_are_separated_by_commas(text: str, values: tuple[object, ...]) -> None:
    assert parse_axis(text) == Axis(text.split("=")[0], values)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"sets": ["mission.strategy=cov,ideal"]}, ["mission.strategy", "strategies"]),
        ({"sets": ["seed=1,2"]}, ["seed", "seeds"]),
        ({"sets": ["mission.steps=5,5"]}, ["mission.steps", "5", "twice"]),
        ({"sets": ["mission.steps=5", "mission.steps=6"]}, ["mission.steps", "twice"]),
        ({"sets": ["mission.steps=5,0"]}, ["mission.steps = 0", "equal to 1"]),
        ({"sets": ["mission.steps=5,"]}, ["mission.steps=5,", "KEY=VALUE,VALUE"]),
        ({"sets": ["mission.steps"]}, ["mission.steps", "KEY=VALUE"]),
        ({"strategies": ("cov", "cov")}, ["strategies", "'cov'", "twice"]),
        ({"strategies": ("best",)}, ["mission.strategy", "'best'"]),
        ({"sets": ["link.kind=udp"]}, ["link.kind = 'udp'", "in_process"]),
        ({"seeds": 0}, ["seeds = 0", "at least 1"]),
        ({"common": {"mission.rounds": 0}}, ["mission.rounds = 0"]),
    ],
)
def test_refused_in_words_that_help(more: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        grid(**more)
    for word in words:
        assert word in str(caught.value)


def started(path: Path, first: Grid) -> SweepFolder:
    folder = SweepFolder(path)
    folder.check(first, data_dir=None)
    with folder.lock():
        folder.claim(first, data_dir=None)
    return folder


def test_a_sweep_may_grow(tmp_path: Path) -> None:
    folder = started(tmp_path / "s", grid(sets=["mission.steps=5,6"]))
    more = grid(strategies=("no_cov", "cov", "ideal"), seeds=3, sets=["mission.steps=5,6,7"])
    folder.check(more, data_dir=None)
    with folder.lock():
        folder.claim(more, data_dir=None)
    folder.check(more, data_dir=None)
    with pytest.raises(
        InputError, match="seed 3 is there too, so give --seeds 3"
    ):  # it is the larger one from now on
        folder.check(grid(sets=["mission.steps=5,6,7"], strategies=more.strategies), data_dir=None)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"common": {"mission.rounds": 9}}, ["mission.rounds was 6, is 9"]),
        ({"sets": ["learning.mu=0.5"]}, ["learning.mu was 0.1, is 0.5"]),
        ({"sets": ["communities.1.devices=3"]}, ["communities.1.devices was 6, is 3"]),
        ({"sets": ["mission.steps=5,6"]}, ["mission.steps was not swept"]),
        ({"strategies": ("cov",)}, ["strategy ideal is there too, so give --strategies cov,ideal"]),
        ({"seeds": 1}, ["more runs than are asked for: seed 2 is there too, so give --seeds 2"]),
    ],
)
def test_a_changed_sweep_is_refused_by_name(
    tmp_path: Path, more: dict[str, Any], words: list[str]
) -> None:
    folder = started(tmp_path / "s", grid())
    with pytest.raises(InputError) as caught:
        folder.check(grid(**more), data_dir=None)
    for word in (str(folder.path), "give a new folder", *words):
        assert word in str(caught.value)


def test_values_that_are_left_out_are_named_as_they_are_given(tmp_path: Path) -> None:
    folder = started(tmp_path / "s", grid(sets=["channel.preset=urban,suburban,dense-urban"]))
    with pytest.raises(InputError) as caught:
        folder.check(grid(sets=["channel.preset=urban,suburban"]), data_dir=None)
    wanted = "--set channel.preset=urban,suburban,dense-urban"
    assert f"channel.preset dense-urban is there too, so give {wanted}" in str(caught.value)
    assert "another configuration" not in str(caught.value)


@pytest.mark.parametrize(
    ("lacks", "told"), [(0, ""), (6, ""), (7, " and 1 more"), (9, " and 3 more")]
)
def test_six_runs_that_are_missing_are_named(lacks: int, told: str) -> None:
    done = RunResult(Point("cov", 1, ()), {}, (), {})
    missing = tuple(Missing(f"run-{n}", "cov" if n < 2 else "ideal", "why") for n in range(lacks))
    state = SweepState({}, (done, done), missing)
    assert state.planned == 2 + lacks
    if not lacks:
        assert (state.progress, state.seeds("cov")) == ("All 2 runs are done.", "2")
        return
    named = ", ".join(f"run-{n}" for n in range(min(6, lacks)))
    assert state.progress == f"2 of {2 + lacks} runs are done; missing: {named}{told}."
    assert (state.seeds("cov"), state.seeds("ideal")) == ("2 of 4", f"0 of {lacks - 2}")


def test_eight_changes_are_named_and_several_values_that_are_left_out(tmp_path: Path) -> None:
    folder = started(tmp_path / "s", grid(seeds=3, sets=["mission.steps=5,6,7"]))
    with pytest.raises(
        InputError, match=r"seed 2, 3 are there too, so give --seeds 3; mission\.st"
    ):
        folder.check(grid(seeds=1, sets=["mission.steps=5,6"]), data_dir=None)
    keys = ("local_epochs", "batch_size", "mu", "momentum", "learning_rate")
    other = {f"learning.{key}": 0.5 if n > 1 else 7 for n, key in enumerate(keys)}
    other |= {
        f"communities.{c}.{key}": 5 for c in (0, 1) for key in ("devices", "labels_per_device")
    }
    other |= {"mission.rounds": 9}
    with pytest.raises(InputError) as caught:
        folder.check(grid(common=other, seeds=3, sets=["mission.steps=5,6,7"]), data_dir=None)
    assert str(caught.value).count(", is ") == 8


def test_a_manifest_of_another_version_is_none_of_a_sweep(tmp_path: Path) -> None:
    folder = started(tmp_path / "s", grid())
    whole = json.loads(folder.manifest.read_text())
    assert [p.name for p in points_of(read_manifest(folder.path))] == [r.name for r in grid().runs]
    changes: list[dict[str, Any]] = [
        {"format": 2}, {"axes": []}, {"axes": {"seed": [1], "strategy": ["cov"]}},
        {"axes": {**whole["axes"], "mission.steps": 5}},
    ]  # fmt: skip
    for change in changes:
        folder.manifest.write_text(json.dumps({**whole, **change}))
        with pytest.raises(InputError, match="not written by a sweep of this version"):
            read_manifest(folder.path)


def test_another_data_folder_is_refused(tmp_path: Path) -> None:
    folder = started(tmp_path / "s", grid())
    with pytest.raises(InputError, match="data folder was None"):
        folder.check(grid(), data_dir=tmp_path)


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match=r"not by a sweep.*mine\.txt"):
        SweepFolder(tmp_path).check(grid(), data_dir=None)


def test_one_sweep_at_a_time(tmp_path: Path) -> None:
    folder = SweepFolder(tmp_path / "s")
    with (
        folder.lock(),
        pytest.raises(InputError, match=r"another sweep is at work.*or name another"),
        folder.lock(),
    ):
        pass


def test_a_file_is_no_folder_of_a_sweep(tmp_path: Path) -> None:
    (tmp_path / "s").write_text("mine")
    with pytest.raises(InputError, match=r"s: cannot write the output folder: File exists"):
        SweepFolder(tmp_path / "s").lock().__enter__()


def test_what_fails_under_the_lock_is_not_blamed_on_the_folder(tmp_path: Path) -> None:
    failure = OSError(errno.EMFILE, "Too many open files")
    with (
        pytest.raises(OSError, match="Too many open files") as caught,
        SweepFolder(tmp_path / "s").lock(),
    ):
        raise failure
    assert caught.value is failure


def test_each_autopilot_of_a_sweep_has_the_binary_that_the_environment_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("AEROFED_PX4", "bin/px4")
    monkeypatch.setenv("AEROFED_ARDUCOPTER", "/opt/arducopter")
    swept = [Axis("vehicle.autopilot", ("built-in", "px4", "ardupilot"))]
    found = make_grid(builtin_config("quickstart.toml"), strategies=["cov"], seeds=1, axes=swept)
    paths = [run.config.vehicle.firmware.path for run in found.runs]
    assert paths == [None, tmp_path / "bin" / "px4", Path("/opt/arducopter")]
    # As the resolved configuration of a run says, whatever the environment does later.
    monkeypatch.setenv("AEROFED_PX4", "elsewhere")
    assert load_config(found.runs[1].config).vehicle.firmware.path == paths[1]


def test_what_all_runs_have_is_set_together_with_what_one_has(tmp_path: Path) -> None:
    """A file of `common` and another of a run's own: the second replaces the first."""
    rings = [[[7.07, 43.61], [7.071, 43.61], [7.071, 43.611], [7.07, 43.61]]]
    for name in ("one", "other"):
        geometry = {"type": "Polygon", "coordinates": rings}
        (tmp_path / f"{name}.geojson").write_text(json.dumps(geometry))
    one, other = (str(tmp_path / f"{name}.geojson") for name in ("one", "other"))
    swept = [Axis("area.no_fly_file", (one, other))]
    found = make_grid(
        builtin_config("paper.toml"),
        strategies=["cov"],
        seeds=1,
        axes=swept,
        common={"area.no_fly_file": one, "mission.flight": "none"},
    )
    assert [len(run.config.area.no_fly) for run in found.runs] == [1, 1]


@pytest.mark.parametrize(("length", "cut"), [(94, False), (95, True), (140, True)])
def test_names_of_folders_have_a_hundred_characters_and_a_hash_at_most(
    length: int, cut: bool
) -> None:
    whole = "x" * length + "-seed1"
    digest = hashlib.sha256(whole.encode()).hexdigest()
    name = Point("x" * length, 1, ()).name
    assert name == (f"{whole[:100]}-{digest[:8]}" if cut else whole)
    assert len(name) == (109 if cut else 100)


def test_the_command_flies_three_seeds_of_all_strategies_with_pictures_and_a_page(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[tuple[Grid, Path, dict[str, Any]]] = []

    def sweep(grid: Grid, path: Path, **more: Any) -> int:
        asked.append((grid, path, more))
        return 3

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mission.sweep.sweep.sweep", sweep)
    assert call(["sweep", "quickstart"]) == 3
    assert call(
        ["sweep", "quickstart", "--strategies", "cov, ideal", "--seeds", "1", "--rounds", "7",
         "--jobs", "1", "--out", "here", "--no-run-figures", "--no-report", "--json"],
    ) == 3  # fmt: skip
    (first, path, usual), (second, here, other) = asked
    assert first.seeds == (1, 2, 3)
    assert first.strategies == ("cov", "no_cov", "barycenter", "rectangular", "ideal")
    assert path == Path("runs/sweep-quickstart")
    assert (usual["engine"], usual["data_dir"]) == (EngineChoice(), None)
    assert usual["run_figures"] is True
    assert usual["page"] is not None
    assert (usual["console"].quiet, usual["console"].width) == (False, 160)
    assert (second.seeds, second.strategies, here) == ((1,), ("cov", "ideal"), Path("here"))
    assert {run.config.mission.rounds for run in second.runs} == {7}
    assert (other["engine"].jobs, other["run_figures"], other["page"]) == (1, False, None)
    assert other["console"].quiet
    assert capsys.readouterr().out == ""


def test_rounds_are_the_lines_below_the_head(tmp_path: Path) -> None:
    kept = RunFolder(tmp_path)
    assert rounds_in(kept) == 0
    for text, rounds in (("", 0), ("head\n", 0), ("head\n1\n", 1), ("head\n1\n2\n3", 2)):
        kept.rounds.write_text(text)
        assert rounds_in(kept) == rounds
