"""Configuration: what is accepted, what is refused, and in which words."""

import itertools
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from mission.base.errors import InputError
from mission.base.explain import tables
from mission.config.link import checked_url
from mission.config.loading import builtin_config, load_config, parse_override
from mission.config.models import RunConfig
from mission.config.preflight import load_data

BASE = """
[[communities]]
name = "a"
task = "digits"
devices = 2
"""


@pytest.fixture
def write(tmp_path: Path):
    def _write(text: str) -> Path:
        path = tmp_path / "c.toml"
        path.write_text(text)
        return path

    return _write


@pytest.mark.parametrize(
    ("name", "steps"), [("quickstart.toml", 10), ("paper.toml", 3), ("paper-sweep.toml", 3)]
)
def test_built_in_configurations_load(name: str, steps: int) -> None:
    config = load_config(builtin_config(name))
    mission = config.mission
    assert (mission.altitude_m, mission.speed_mps, mission.path_budget_m) == (60.0, 20.0, 800.0)
    assert (mission.steps, mission.devices_per_step) == (steps, 3)
    assert [c.devices for c in config.communities] == [6, 6]


def test_resolved_configuration_reads_back_equal() -> None:
    config = load_config(builtin_config("paper.toml"), {"mission.rounds": 7})
    assert RunConfig.model_validate(tomllib.loads(config.to_toml())) == config


@pytest.mark.parametrize(
    ("text", "parsed"),
    [
        ("mission.steps=8", ("mission.steps", 8)),
        ("mission.strategy=no_cov", ("mission.strategy", "no_cov")),
        ('name = "x"', ("name", "x")),
        ("area.size_m=[100, 200.5]", ("area.size_m", [100, 200.5])),
        ("communities.1.devices=3", ("communities.1.devices", 3)),
    ],
)
def test_overrides(text: str, parsed: tuple[str, object]) -> None:
    assert parse_override(text) == parsed


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[mission]\nsteps = 'many'",
            "mission.steps = 'many': must be a whole number",
        ),
        ("[mission]\nsteps = '8'", "mission.steps = '8': must be a whole number"),
        ("[mission]\nsteps = true", "mission.steps = true: must be a whole number"),
        (
            "[mission]\naltitude_m = nan",
            "mission.altitude_m = nan: must be less than or equal to 500, or a list",
        ),
        (
            "[mission]\naltitude_m = [60]",
            "mission.altitude_m.1: missing, and it has no default",
        ),
        (
            "[mission]\naltitude_m = [5, 120]",
            "mission.altitude_m.0 = 5: must be greater than or equal to 10",
        ),
        (
            "[mission]\naltitude_m = [40, 900]",
            "mission.altitude_m.1 = 900: must be less than or equal to 500",
        ),
        (
            "[mission]\naltitude_m = [120.0, 40.0]",
            "mission.altitude_m = [120.0, 40.0]: the lowest altitude must be below the highest, "
            "not 120 and 40; for a fixed altitude give one number",
        ),
        (
            "[mission]\naltitude_m = [60, 60]",
            "mission.altitude_m = [60, 60]: the lowest altitude must be below the highest, not 60",
        ),
        ("mission = 3", "mission = 3: must be a table"),
        (
            "[area]\nsize_m = [800.0, 0.0]",
            "area.size_m.1 = 0.0: must be greater than 0",
        ),
        (
            "[area]\nsize_m = [800.0]",
            "area.size_m.1: missing, and it has no default",
        ),
        (
            "[area]\nhome_m = [inf, 0.0]",
            "area.home_m.0 = inf: must be less than or equal to 100000",
        ),
        ("[link]\nspeed = 0", "link.speed = 0: must be 'max', or greater than 0"),
        (
            "[planner]\nkind = 'certifed'",
            "planner.kind = 'certifed': must be 'certified', 'sqp', 'paper', "
            "'paper_literal' or 'import'; did you mean certified?",
        ),
        (
            "[vehicle.aircraft.faults]\nkind = 'gnss_off'",
            "vehicle.aircraft.faults = {'kind': 'gnss_off'}: must be a list",
        ),
        (
            "[[vehicle.aircraft.faults]]\nat_s = 3",
            "vehicle.aircraft.faults.0.kind: missing; it says which kind of table this is",
        ),
        (
            "[[vehicle.aircraft.faults]]\nkind = 'wind'",
            "vehicle.aircraft.faults.0.kind = 'wind': must be one of 'gnss_off', 'gnss_jump', "
            "'motor_loss', 'imu_bias', 'wind_burst', 'link_off'",
        ),
        (
            "[[vehicle.aircraft.faults]]\nkind = 'gnss_jump'\nnorth_m = 'far'",
            "vehicle.aircraft.faults.0.north_m = 'far': must be a number",
        ),
        (
            "[[vehicle.aircraft.wind.gusts]]\neast_mps = 3",
            "vehicle.aircraft.wind.gusts.0.start_s: missing, and it has no default",
        ),
        (
            "[vehicle.parameters]\nRTL_RETURN_ALT = 'high'",
            "vehicle.parameters.RTL_RETURN_ALT = 'high': must be a number",
        ),
        ("name = 'a b'", "name = 'a b': must match pattern '^[A-Za-z0-9._-]{1,64}$'"),
    ],
)
def test_what_is_wrong_with_a_value(write, text: str, said: str) -> None:
    path = write(text + BASE)
    with pytest.raises(InputError) as caught:
        load_config(path)
    assert str(caught.value).startswith(f"{path}: {said}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[mission]\nstep = 3" + BASE, ["c.toml", "mission.step", "unknown key", "mean steps?"]),
        ("[mission]\nspedd = 3" + BASE, ["mission.spedd", "unknown key", "mean speed_mps?"]),
        ("rounds = 3" + BASE, ["rounds", "unknown key", "did you mean mission.rounds?"]),
        (
            "[mission]\nseed = 3" + BASE,
            ["c.toml: mission.seed: unknown key; seed belongs to the top level, before the first"],
        ),
        ("[mission]\nstrategy = 'best'" + BASE, ["mission.strategy", "'best'", "'no_cov'"]),
        ("seed = 1", ["communities", "missing, and it has no default"]),
        (BASE + BASE, ["community names must differ", "'a'"]),
        ("seed = = 1", ["not valid TOML", "line 1", "'seed = = 1'"]),
        (
            "[mission]\nrounds = 3\nsteps = 4\nrounds = 5" + BASE,
            ["c.toml: not valid TOML: line 4: rounds: given twice in its table"],
        ),
        ("seed = [1,", ["not valid TOML", "'seed = [1,'"]),
        ("colour = 1" + BASE, ["colour", "unknown key"]),
        (BASE + "labels_per_devise = 2", ["communities.0.labels_per_devise", "labels_per_device?"]),
        (BASE + "labels_per_device = 11", ["communities.0.labels_per_device = 11", "10 classes"]),
        (BASE + "coverage = true", ["coverage = true", "cannot own 10 classes; give more"]),
        (BASE + "network = 'resnet'", ["communities.0.network = 'resnet'", "'lenet', 'mcmahan'"]),
        (BASE + "network = 'no_such.net:N'", ["communities.0.network", "No module named"]),
        (
            "[mission]\nstrategy = 'no_such:f'" + BASE,
            [
                "mission.strategy",
                "No module named 'no_such'; looked for in the working directory, in "
                "PYTHONPATH and among what is installed",
            ],
        ),
        (
            "[vehicle]\nparameter_file = 'no.parm'" + BASE,
            ["parameter_file = '...", "no.parm': no such"],
        ),
        (
            "[vehicle.parameters]\nFOO = 1" + BASE,
            ["vehicle.parameters.FOO = 1", "no such parameter", "known: BAT_CRIT"],
        ),
        (
            "[vehicle.parameters]\nRTL_ALT = 1" + BASE,
            ["vehicle.parameters.RTL_ALT = 1", "no such parameter; did you mean RTL_RETURN_ALT?"],
        ),
        (
            "[vehicle.parameters]\nGF_ACTION = 9" + BASE,
            ["vehicle.parameters.GF_ACTION = 9", "from 0 to 5"],
        ),
    ],
)
def test_refused_in_words_that_help(write, text: str, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        load_config(write(text))
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


# A value of every type that TOML has, and numbers beyond all limits.
STRANGE: tuple[Any, ...] = (
    "?",
    "",
    True,
    7,
    -1e300,
    1e300,
    math.nan,
    math.inf,
    [],
    [1],
    ["?"],
    [{}],
    {"q": 1},
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "key", [(*path, name) for path, kind in tables(RunConfig) for name in kind.model_fields]
)
def test_no_key_is_refused_in_the_words_of_a_library(write, key: tuple[str | int, ...]) -> None:
    for value in STRANGE:
        data: dict[str, Any] = {"communities": [{"name": "a", "task": "digits", "devices": 3}]}
        table: Any = data
        for part, following in itertools.pairwise(key):
            if isinstance(table, dict):
                table.setdefault(part, [{}] if following == 0 else {})
            table = table[part]
        table[key[-1]] = value
        path = write(tomli_w.dumps(data))
        try:
            load_config(path)
        except InputError as error:
            for line in str(error).splitlines():
                assert line.startswith(f"{path}: {key[0]}"), line
                assert not re.search(r"nput|instance|tuple|literal\[|constrained", line), line


def test_several_faults_are_said_together(write) -> None:
    with pytest.raises(InputError) as caught:
        load_config(write("seed = -1\n[mission]\nrounds = 0" + BASE))
    assert len(str(caught.value).splitlines()) == 2


def test_the_command_line_is_blamed_for_its_own(write) -> None:
    with pytest.raises(InputError, match=r"^command line: foo: unknown key"):
        load_config(write(BASE), {"foo.bar": 1})
    with pytest.raises(InputError, match=r"^command line: vehicle.parameters.FOO = 1.0: no such"):
        load_config(write(BASE), {"vehicle.parameters.FOO": 1})


def test_a_key_set_in_the_wrong_table_is_told_where_it_belongs(write) -> None:
    with pytest.raises(InputError) as caught:
        load_config(write(BASE), {"mission.seed": 3})
    said = "command line: mission.seed: unknown key; seed belongs to the top level"
    assert str(caught.value) == said
    # Of another table is link.speed.
    with pytest.raises(InputError, match=r"mission.speed: unknown key; did you mean speed_mps\? "):
        load_config(builtin_config("quickstart.toml"), {"mission.speed": 10})


def test_a_parameter_file_is_read_at_once(write, tmp_path: Path) -> None:
    (tmp_path / "mine.parm").write_text("RTL_RETURN_ALT 45\nGF_ACTION many\n")
    with pytest.raises(InputError, match=r"mine\.parm, line 2: 'GF_ACTION many'"):
        load_config(write(BASE), {"vehicle.parameter_file": str(tmp_path / "mine.parm")})


def test_a_byte_order_mark_is_no_fault(write) -> None:
    assert load_config(write("\ufeffseed = 3" + BASE)).seed == 3


@pytest.mark.parametrize("text", ["mission.steps", "=3", "a..b=1"])
def test_an_override_without_key_or_value_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected KEY=VALUE"):
        parse_override(text)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("area.size_m.0=true", "must be a number"),
        ("area.size_m.1=[]", "must be a number"),
        (
            "area.size_m.2=5",
            "area.size_m is a list of 2, so an index from 0 to 1 must follow, not '2'",
        ),
        (
            "area.size_m.x=5",
            "area.size_m is a list of 2, so an index from 0 to 1 must follow, not 'x'",
        ),
        (
            "area.size_m.-1=5",
            "area.size_m is a list of 2, so an index from 0 to 1 must follow, not '-1'",
        ),
        (
            "area.size_m.0.x=5",
            "area.size_m.0 is 9, and has nothing in it",
        ),
        (
            "communities.3.devices=1",
            "communities is a list of 1, so an index from 0 to 0 must follow, not '3'",
        ),
        (
            "communities.devices=1",
            "communities is a list of 1, so an index from 0 to 0 must follow, not 'devices'",
        ),
        ("communities.0.devices=true", "must be a whole number"),
        ("communities.0=3", "must be a table"),
        ("seed.x=1", "seed is 1, and has nothing in it"),
        ("mission.steps.x=1", "mission.steps is 3, and has nothing in it"),
        ("vehicle.parameters.GF_ACTION=true", "must be a number"),
        ("link.speed=true", "must be 'max', or a number"),
        ("mission=3", "must be a table"),
    ],
)
def test_an_override_of_another_type_is_refused(write, override: str, said: str) -> None:
    text = "seed = 1\n[mission]\nsteps = 3\n[area]\nsize_m = [9, 9]"
    key, _, value = override.partition("=")
    with pytest.raises(InputError) as caught:
        load_config(write(text + BASE), dict([parse_override(override)]))
    assert str(caught.value).startswith(f"command line: {key} = {value}: {said}")
    assert "\n" not in str(caught.value)


def test_one_element_of_a_list_is_overridden(write) -> None:
    path = write("[area]\nsize_m = [800.0, 800.0]" + BASE)
    assert load_config(path, {"area.size_m.1": 500}).area.size_m == (800.0, 500.0)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("area.home_m.1=5", "area.home_m = {'1': 5}: must be a list"),
        ("planner.kind.x=3", "planner.kind = {'x': 3}: must be 'certified', 'sqp', 'paper', 'p"),
        ("vehicle.aircraft.faults.0.at_s=3", "vehicle.aircraft.faults = {'0': {'at_s': 3}}: must"),
    ],
)
def test_what_has_no_parts_in_the_file_is_given_as_a_whole(write, override: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        load_config(write(BASE), dict([parse_override(override)]))
    assert str(caught.value).startswith(f"command line: {said}")


def test_a_built_in_file_that_is_missing() -> None:
    assert builtin_config("quickstart.toml").is_file()
    with pytest.raises(InputError, match=r"configuration nope\.toml is missing from the inst"):
        builtin_config("nope.toml")


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing\.toml: cannot be read: No such file"):
        load_config(tmp_path / "nothing.toml")


def _missing(tasks: list[tuple[str, str | None]], data_dir: Path | None = None) -> str:
    """How a run with these tasks and data files is refused."""
    communities = [
        {"name": str(i), "task": task, "devices": 2, "data_file": file}
        for i, (task, file) in enumerate(tasks)
    ]
    with pytest.raises(InputError) as caught:
        load_data(RunConfig.model_validate({"communities": communities}), data_dir)
    return str(caught.value)


@pytest.mark.parametrize(
    ("tasks", "needed"),
    [
        (
            [("cifar10", None), ("digits", None), ("mnist", None)],
            ["aerofed data fetch FOLDER --task cifar10", "aerofed data fetch FOLDER --task mnist"],
        ),
        (
            [("npz", "a.npz"), ("npz", "b.npz"), ("npz", "a.npz"), ("mnist", None)],
            ["the file a.npz (communities.data_file)", "the file b.npz (communities.data_file)",
             "aerofed data fetch FOLDER --task mnist"],
        ),
    ],
)  # fmt: skip
def test_all_data_sets_that_are_missing_are_named(
    tasks: list[tuple[str, str | None]], needed: list[str]
) -> None:
    lines = _missing(tasks).splitlines()
    assert len(lines) == len(needed)
    for line, end in zip(lines, needed, strict=True):
        assert ": needs files: give their folder (--data-dir FOLDER, in Python data_dir)" in line
        assert line.endswith(end)


def test_a_data_file_elsewhere_needs_no_data_folder(tmp_path: Path) -> None:
    path = tmp_path / "mine.npz"
    said = f"npz: not found in {tmp_path}; looked for the file {path} (communities.data_file)"
    for data_dir in (None, tmp_path / "other"):
        assert _missing([("npz", str(path))], data_dir) == said


@pytest.mark.parametrize(
    "url",
    [
        "udpin://0.0.0.0:14540", "udpout://host:1", "tcpin://host:65535", "tcpout://[::1]:5760",
        "serial:///dev/ttyACM0:57600", "serial:///dev/ttyACM0:10000000",
    ],
)  # fmt: skip
def test_addresses_that_mavsdk_takes(url: str) -> None:
    assert checked_url(url) == url


@pytest.mark.parametrize(
    "url",
    [
        "udpin://host:0", "udpin://host:65536", "tcpout://host:-1", "udpin://host:1.5",
        "udpin://host:", "udpin://host", "udpin://:14540", "udp://host:14540", "14540",
        "http://here", "serial:///dev/ttyACM0", "serial:///dev/ttyACM0:0",
        "serial:///dev/ttyACM0:10000001",
    ],
)  # fmt: skip
def test_addresses_that_it_does_not_take(url: str) -> None:
    with pytest.raises(
        ValueError, match=r"it must be udpin://HOST:PORT or .* or serial:///DEVICE:"
    ):
        checked_url(url)
