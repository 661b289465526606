"""What a newcomer meets at the prompt: init, shipped names, JSON, completion, messages."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mission.cli import call
from mission.commands.options import print_json
from mission.commands.usage import spread
from mission.config.loading import SHIPPED, builtin_config, load_config

QUICK = (
    "--rounds", "1", "--set", "mission.flight=none", "learning.local_epochs=1",
    "communities.0.subset=0.2", "communities.1.subset=0.2",
)  # fmt: skip


def refused(capsys: pytest.CaptureFixture[str], *tokens: str, code: int = 2) -> str:
    assert call(list(tokens)) == code
    err = capsys.readouterr().err
    assert err.startswith("aerofed: ")
    assert err.count("\n") == 1, "one line"
    return err


def printed(capsys: pytest.CaptureFixture[str], *tokens: str, code: int = 0):
    capsys.readouterr()
    assert call(list(tokens)) == code
    out = capsys.readouterr().out
    return json.loads(out, parse_constant=pytest.fail)


@pytest.mark.parametrize("name", SHIPPED)
def test_init_writes_what_runs_by_that_name(name: str, tmp_path: Path, capsys) -> None:
    assert call(["init", name, "--out", str(tmp_path / "mine")]) == 0
    written = tmp_path / "mine" / f"{name}.toml"
    assert load_config(written) == load_config(Path(name))
    text = written.read_text()
    assert text.count("#") > 8, "commented"
    assert f"{written}" in capsys.readouterr().out
    assert "exists already" in refused(capsys, "init", name, "--out", str(tmp_path / "mine"))
    assert written.read_text() == text


def test_init_begins_with_the_quick_start_here(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert call(["init"]) == 0
    assert "next: aerofed run quickstart.toml" in capsys.readouterr().out
    assert Path("quickstart.toml").read_bytes() == builtin_config("quickstart.toml").read_bytes()


def test_init_that_cannot_write_says_so(tmp_path: Path, capsys) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "x"):
        said = refused(capsys, "init", "--out", str(path))
        assert f"{path}: not a folder; give another by --out" in said


def test_shipped_names_work_in_every_command(capsys) -> None:
    assert call(["plan", "quickstart"]) == 0
    assert call(["link-budget", "paper"]) == 0
    said = refused(capsys, "run", "papre")
    assert "no such configuration file; shipped are" in said
    assert "did you mean paper?" in said
    assert "paper-sweep" in refused(capsys, "sweep", "papersweep")


def test_a_file_of_that_name_comes_first(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("paper").write_text('name = "mine"\n[[communities]]\nname = "a"\ntask = "digits"\n')
    assert load_config(Path("paper")).name == "mine"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("json") / "run"
    assert call(["run", *QUICK, "--out", str(folder), "--quiet"]) == 0
    return folder


def test_a_run_writes_its_page_unless_told_not_to(run: Path, tmp_path: Path) -> None:
    page = (run / "report.html").read_text()
    assert "not finished" not in page
    assert ">finished<" in page
    bare = tmp_path / "bare"
    assert call(["run", *QUICK, "--out", str(bare), "--quiet", "--no-report"]) == 0
    assert not (bare / "report.html").exists()


def test_run_tells_its_summary_as_json(tmp_path: Path, capsys) -> None:
    folder = tmp_path / "run"
    told = printed(capsys, "run", *QUICK, "--out", str(folder), "--json", "--no-report")
    assert told == {"folder": str(folder), **json.loads((folder / "summary.json").read_text())}
    assert told["status"] == "finished"
    assert call(["run", *QUICK, "--out", str(folder), "--json"]) == 2
    assert capsys.readouterr().out == ""  # not what the run before it said
    again = printed(capsys, "run", "--resume", str(folder), "--json")
    assert again["status"] == "finished"


def test_plan_and_link_budget_tell_json(tmp_path: Path, capsys) -> None:
    out = tmp_path / "plans.json"
    told = printed(capsys, "plan", "--json", "--out", str(out), "--method", "sqp")
    assert told == json.loads(out.read_text())
    assert told["round-1"]["upper_bound"] is None
    budget = printed(capsys, "link-budget", "--json")
    assert budget["preset"] == "suburban"
    assert len(budget["per"]) == len(budget["distance_m"])
    assert budget["served_radius_m"] > 100
    assert budget["warning"] is None


def test_log_commands_tell_json(run: Path, tmp_path: Path, capsys) -> None:
    info = printed(capsys, "log", "info", str(run), "--json")
    assert {"name", "schema", "messages", "rate_hz"} <= set(info["topics"][0])
    assert info["messages"] == sum(topic["messages"] for topic in info["topics"])
    assert printed(capsys, "log", "check", str(run), "--json")["sound"] is True
    same = printed(capsys, "log", "diff", str(run), str(run), "--json")
    assert same == {"same": True, "differences": []}
    other = tmp_path / "other"
    assert call(["run", *QUICK, "--seed", "2", "--out", str(other), "--quiet", "--no-report"]) == 0
    assert not printed(capsys, "log", "diff", str(run), str(other), "--json", code=7)["same"]
    files = printed(capsys, "log", "export", str(run), str(tmp_path / "t"), "--to", "csv", "--json")
    assert all(Path(file).is_file() for file in files)
    saved = printed(capsys, "log", "recover", str(run), str(tmp_path / "r.mcap"), "--json")
    assert saved["messages"] == info["messages"]


def test_data_commands_tell_json(tmp_path: Path, capsys) -> None:
    (tmp_path / "mnist").mkdir()
    (tmp_path / "mnist" / "train-images-idx3-ubyte").write_bytes(b"x")
    found = printed(capsys, "data", "check", str(tmp_path), "--json", code=2)
    assert {item["task"] for item in found} == {"mnist", "fashion-mnist", "cifar10"}


@pytest.mark.slow
def test_a_sweep_tells_its_results_as_json_and_writes_its_page(tmp_path: Path, capsys) -> None:
    out = tmp_path / "sweep"
    tokens = ["sweep", "quickstart", "--strategies", "cov", "--seeds", "1", *QUICK, "--jobs", "1"]
    told = printed(capsys, *tokens, "--out", str(out), "--json")
    assert [row["strategy"] for row in told["runs"]] == ["cov"]
    assert told["missing"] == []
    assert (out / "report.html").is_file()


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_knows_the_commands(shell: str, capsys) -> None:
    assert call(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert "aerofed" in script
    if shell == "bash":
        check = (
            script + "\nCOMP_WORDS=(aerofed ru); COMP_CWORD=1; COMP_LINE='aerofed ru'; "
            "COMP_POINT=10; _aerofed; echo ${COMPREPLY[@]}"
        )
        path = f"{Path(sys.executable).parent}:/usr/bin:/bin"
        done = subprocess.run(
            ["bash", "-c", check], capture_output=True, text=True, check=True, env={"PATH": path}
        )
        assert done.stdout.split() == ["run"]


def test_a_terminal_that_knows_ascii_only_is_told_all_the_same() -> None:
    program = "import mission.cli as c; c.call = lambda _: print('1 \u00b1 2') or 0; c.main([])"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert done.stdout == "1 \\xb1 2\n"


def test_json_is_such_in_any_encoding(capsys) -> None:
    print_json({"name": "Zürich", "value": 0.1, "none": math.nan})
    assert capsys.readouterr().out == (
        '{\n  "name": "Z\\u00fcrich",\n  "value": 0.1,\n  "none": null\n}\n'
    )


MESSAGES = {
    ("sweep",): "CONFIG is missing: TOML file, or quickstart, paper",
    ("log", "info"): "LOG is missing: A complete, sound log, or its run's folder",
    ("run", "paper", "b"): "aerofed run: did not expect 'b'; see aerofed run --help",
    ("log", "info", "a", "b"): "aerofed log info: did not expect 'b'; see aerofed log info --help",
    ("log", "export", "a", "b"): "--to is missing:",
    ("sitl", "--home", "100,0,0"): "--home: latitude 100.0: must be less than or equal to 85",
    ("run", "--set", "mission.round_energy_j=0"): "must be greater than 0",
    ("plan", "--problem"): "--problem needs a value: JSON file with a list of problems",
    ("sitl", "--speed", "abc"): '--speed abc: must be a number or "max"',
    ("sitl", "--speed", "1000.1"): '--speed 1000.1: more than 0 and at most 1000, or "max"',
    ("sitl", "--speed", "0"): "--speed 0: more than 0",
    ("sitl", "--speed", "1000", "--home", "100,0,0"): "--home: latitude 100.0: must be less than",
    ("world", "--px4", "--speed", "1000.1"): "--speed 1000.1: more than 0 and at most 1000, or",
    ("world", "--px4", "--speed", "1000", "--port", "0"): "--port 0: must be from 1 to 65535",
    ("world", "--px4", "--port", "65536"): "--port 65536: must be from 1 to 65535",
    ("world", "--px4", "--port", "65535", "--wind", "99"): "--wind 99.0: must be less than",
    ("world", "--px4", "--port", "1", "--wind", "99"): "--wind 99.0: must be less than",
    ("world", "--px4", "--px4", "--port", "7"): "--port 7: for one vehicle alone",
    ("world", "--px4", "--built-in", "--port", "7"): "--port 7: for one vehicle alone",
    ("world",): "aerofed world: --px4 or --ardupilot is missing",
    ("run", "--live-port", "65536"): "--live-port 65536: must be from 0 to 65535",
    ("run", "--live-port", "-1"): "--live-port -1: must be from 0 to 65535",
    ("run", "--rounds", "abc"): "--rounds abc: must be a whole number",
    ("completion", "tcsh"): 'aerofed: SHELL tcsh: must be one of "bash", "zsh", "fish"',
    ("firmware", "fetch", "betaflight"): 'aerofed: FIRMWARE betaflight: must be "arducopter"',
    ("plan", "--method", "foo"): '--method foo: must be one of "certified", "sqp", "paper"',
    ("plan", "--gap", "7"): "--gap 7.0: must be less than 1",
    ("run", "--rounds", "0"): "--rounds 0: must be greater than or equal to 1",
    ("run", "--seed=-1"): "--seed -1: must be greater than or equal to 0",
    ("world", "--px4", "--wind", "99"): "--wind 99.0: must be less than or equal to 25",
    ("run", "--vehicle", "foo"): "--vehicle foo: no address of a vehicle; it must be udpin://",
    ("run", "--set", "seed=-1"): "command line: seed = -1: must be greater than or equal to 0",
    ("run", "--set", "mission.path_budget_m=0"): "path_budget_m = 0: must be greater than 0",
    ("data", "check", "nowhere"): "no such folder; aerofed data fetch nowhere makes it",
    ("data", "check", "."): "holds none of the data sets; aerofed data fetch . downloads them",
    ("run", "--set", "communities.0.task=npz"): "task = 'npz' needs data_file",
    ("run", "--set", "communities.0.data_file=x"): "data_file is for task = 'npz' only",
    ("plan", "--set", "planner.kind=import", "planner.factory=builtins:object"): (
        "gives an object without plan"
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("command", "option"),
    [
        (["run"], "--seed"),
        (["run"], "--rounds"),
        (["run"], "--live-port"),
        (["sweep", "quickstart"], "--seeds"),
        (["sweep", "quickstart"], "--jobs"),
        (["sitl"], "--count"),
        (["world", "--px4"], "--port"),
    ],
)
@pytest.mark.parametrize("value", ["1.5", "2.0"])
def test_whole_numbers_are_not_rounded(command: list[str], option: str, value: str, capsys) -> None:
    # The wrong key ends the command also where the fraction is taken.
    said = refused(capsys, *command, option, value, "--set", "mission.rounds=0")
    assert f"{option} {value}: must be a whole number" in said


@pytest.mark.parametrize("tokens", MESSAGES)
def test_messages_say_the_way_out(tokens, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert MESSAGES[tokens] in refused(capsys, *tokens)


@pytest.mark.parametrize(
    ("folder", "words"),
    [
        ((), "give their folder (--data-dir FOLDER"),
        (("--data-dir", "."), "get it by: aerofed data fetch . --task cifar10"),
    ],
)
def test_each_missing_data_set_has_a_line(folder, words, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert call(["run", "paper", *folder]) == 2
    cifar10, mnist = capsys.readouterr().err.splitlines()
    assert words in cifar10
    assert "--task mnist" in mnist


TWICE = "--vehicle udpin://0.0.0.0:1 --vehicle udpin://0.0.0.0:2"
SEVERAL = "aerofed sitl --count N and aerofed.vehicles(N) serve several"


@pytest.mark.parametrize(
    "line",
    [
        "run --count 3", "run --count=3", "run --vehicles 3", "run --drones 3", "run --instance 1",
        "run --num-vehicles 3", "run --swarm", "fly a.plan --count 3", "sweep town --count 3",
        "plan town --fleet 2", "world --px4 --count 2", f"run {TWICE}", f"fly a.plan {TWICE}",
        "run --set vehicle.count=3",
        "run --set mission.vehicles=3", "fly a.plan --set vehicle.count=3", "run fleet.toml",
        "run table.toml", "sitl --vehicles 3",
    ],
)  # fmt: skip
def test_who_asks_for_several_aircraft_is_told_what_there_is(
    line: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    town = builtin_config("town.toml").read_text().split("[mission]")
    Path("fleet.toml").write_text("[mission]\nvehicles = 3".join(town))
    Path("table.toml").write_text("[[vehicle]]\nsystem_id = 2\n" + "[mission]".join(town))
    said = refused(capsys, *line.split())
    assert SEVERAL in said
    assert "Did you mean" not in said


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("run a.plan", "a.plan: not a configuration; aerofed fly flies it"),
        ("plan a.waypoints", "a.waypoints: not a configuration; aerofed fly flies it"),
        ("sweep a.plan", "a.plan: not a configuration; aerofed fly flies it"),
        ("fly a.plan a.ulg", "a.ulg: not a configuration; aerofed compare reads it"),
        ("run a.mcap", "a.mcap: not a configuration; aerofed compare reads it"),
        ("fly a.toml", "(.waypoints, .txt, .mission); aerofed run flies it"),
        ("fly a.tlog", "(.waypoints, .txt, .mission); aerofed compare reads it"),
        ("log info a.ulg", "a.ulg: not an MCAP file; aerofed compare reads it"),
        ("log info a.mcap", "a.mcap: not an MCAP file"),
        ("compare a.plan", "a.plan: not an MCAP file; aerofed fly flies it; what is read: "),
        ("report junk.txt", "junk.txt: not an MCAP file; what is read: folders of runs, .mcap"),
        ("compare junk", ".ulg of PX4, .bin of ArduPilot, .tlog of ground stations"),
    ],
)
def test_a_file_that_another_command_takes_names_it(
    line: str, words: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    for word in line.split():
        Path(word).write_text("junk")
    line = line.replace("fly a.plan a.ulg", "fly a.plan --config a.ulg")
    said = refused(capsys, *line.split())
    assert words in said
    if words.endswith("MCAP file"):
        assert said.rstrip().endswith(words)


def npz(path: Path, **changes: Any) -> None:
    images = np.zeros((60, 8, 8), dtype=np.uint8)
    arrays: dict[str, Any] = {"images": images, "labels": np.arange(60) % 3, **changes}
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})


NPZ = """
[[communities]]
name = "mine"
task = "npz"
data_file = "mine.npz"
devices = 2
partition = "iid"
"""


def test_data_of_ones_own_are_no_lesser_copy_of_official_ones(tmp_path: Path, capsys) -> None:
    npz(tmp_path / "mine.npz")
    (tmp_path / "c.toml").write_text(NPZ)
    tokens = ["run", str(tmp_path / "c.toml"), "--data-dir", str(tmp_path), *QUICK[:4]]
    assert call([*tokens, "--out", str(tmp_path / "o"), "--no-report"]) == 0
    said = capsys.readouterr()
    assert "official" not in said.out + said.err


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"images": None, "pictures": np.zeros(3)}, "holds the arrays labels, pictures; wanted"),
        ({"labels": np.arange(7)}, "60 images, but 7 labels"),
    ],
)
def test_wrong_arrays_are_not_called_damaged(changes, words: str, tmp_path: Path, capsys) -> None:
    npz(tmp_path / "mine.npz", **changes)
    (tmp_path / "c.toml").write_text(NPZ)
    said = refused(capsys, "run", str(tmp_path / "c.toml"), "--data-dir", str(tmp_path))
    assert words in said
    assert "damaged" not in said


@pytest.mark.parametrize(
    ("given", "read"),
    [
        ("run --set a=1 my.toml", "run --set a=1 my.toml"),
        (
            "sweep --set a=1 b=2,3 my.toml --seeds 2",
            "sweep --set a=1 --set b=2,3 my.toml --seeds 2",
        ),
        ("run my.toml --set a=1 b=2 --json c=3", "run my.toml --set a=1 --set b=2 --json c=3"),
        ("run --set a=1 --set b=2", "run --set a=1 --set b=2"),
        ("run --set nothing my.toml", "run --set nothing my.toml"),
        ("run --set", "run --set"),
        ("fly a=b.plan", "fly a=b.plan"),
        ("run --set=a=1 b.0=2 my.toml", "run --set=a=1 --set b.0=2 my.toml"),
        ("run --set a=1 runs/gap=1/my.toml", "run --set a=1 runs/gap=1/my.toml"),
    ],
)
def test_set_takes_what_has_an_equals_sign(given: str, read: str) -> None:
    assert spread(given.split()) == read.split()


def test_a_configuration_may_follow_what_is_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "my.toml").write_text("[mission]\nstepz = 1\n")
    assert call(["run", "--set", "mission.rounds=1", str(tmp_path / "my.toml")]) == 2
    assert f"{tmp_path / 'my.toml'}: mission.stepz: unknown key" in capsys.readouterr().err


def test_a_key_set_twice_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["plan", "--set", "mission.steps=4", "--set", "mission.steps=5"]) == 2
    said = "aerofed: --set mission.steps: given twice; leave one of them out\n"
    assert capsys.readouterr().err == said


@pytest.mark.parametrize(
    ("command", "option", "key"),
    [
        ("plan --gap 0.1", "--gap", "planner.gap=0.2"),
        ("plan --method sqp", "--method", "planner.kind=paper"),
        ("run --seed 3", "--seed", "seed=3"),
        ("run --rounds 1", "--rounds", "mission.rounds=2"),
        ("run --vehicle udpin://0.0.0.0:14540", "--vehicle", "link.kind=external"),
        ("sitl --home 47.4,8.5,488", "--home", "area.home_lon_deg=8.5"),
        ("world --px4 --wind 3", "--wind", "vehicle.aircraft.wind.speed_mps=4"),
    ],
)
def test_a_key_that_an_option_sets_too_is_refused(
    capsys: pytest.CaptureFixture[str], command: str, option: str, key: str
) -> None:
    assert call([*command.split(), "--set", key]) == 2
    name = key.partition("=")[0]
    said = f"aerofed: --set {name}: {option} sets it too; leave one of them out\n"
    assert capsys.readouterr().err == said


@pytest.mark.parametrize("command", ["run", "sweep", "log info", "data fetch", "sitl"])
def test_help_wraps_at_the_terminal_and_tells_only_defaults_that_say_something(
    capsys: pytest.CaptureFixture[str], command: str
) -> None:
    assert call([*command.split(), "--help"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "[default: False]" not in said
    assert "default: (" not in said
    if command == "run":
        assert "[default: 8765]" in said
    if command == "sitl":
        assert "[default: 14540, 14550]" in said


def test_help_breaks_lines_where_the_terminal_ends(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert call(["run", "--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (line,) = (line for line in lines if "once for each station." in line)
    assert "once for each station. udpout://127.0.0.1:14550" in line
