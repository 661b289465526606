"""Configuration: what is accepted, what is refused, and in which words."""

import tomllib
from pathlib import Path

import pytest

from mission.config import RunConfig, builtin_config, load_config, parse_override
from mission.errors import InputError

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


@pytest.mark.parametrize("name", ["quickstart.toml", "paper.toml"])
def test_built_in_configurations_load(name: str) -> None:
    config = load_config(builtin_config(name))
    mission = config.mission
    assert (mission.altitude_m, mission.speed_mps, mission.path_budget_m) == (60.0, 20.0, 800.0)
    assert (mission.steps, mission.devices_per_step) == (10, 3)
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
    ("text", "words"),
    [
        ("[mission]\nstep = 3" + BASE, ["c.toml", "mission.step", "unknown key", "mean steps?"]),
        ("[mission]\nsteps = 'many'" + BASE, ["mission.steps", "'many'", "integer"]),
        ("[mission]\naltitude_m = -3.0" + BASE, ["mission.altitude_m = -3.0", "10"]),
        ("[mission]\nstrategy = 'best'" + BASE, ["mission.strategy", "'best'", "'no_cov'"]),
        ("seed = 1", ["communities", "missing"]),
        (BASE + BASE, ["community names must differ", "'a'"]),
        ("seed = = 1", ["not valid TOML", "line 1"]),
        ("[area]\nsize_m = [800.0, 0.0]" + BASE, ["area.size_m.1 = 0.0", "greater than 0"]),
        ("[link]\nspeed = 0" + BASE, ["link.speed", "'max'"]),
        ("colour = 1" + BASE, ["colour", "unknown key"]),
        (BASE + "labels_per_devise = 2", ["communities.0.labels_per_devise", "labels_per_device?"]),
    ],
)
def test_refused_in_words_that_help(write, text: str, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        load_config(write(text))
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("text", ["mission.steps", "=3", "a..b=1"])
def test_an_override_without_key_or_value_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected KEY=VALUE"):
        parse_override(text)


def test_an_override_into_a_list_needs_an_index(write) -> None:
    with pytest.raises(InputError, match="index from 0 to 0"):
        load_config(write(BASE), {"communities.3.devices": 1})


def test_an_override_into_a_value_is_refused(write) -> None:
    with pytest.raises(InputError, match="seed is not a table"):
        load_config(write("seed = 1" + BASE), {"seed.x": 1})


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing\.toml: cannot read.*No such file"):
        load_config(tmp_path / "nothing.toml")
