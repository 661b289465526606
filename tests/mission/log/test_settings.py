"""A log's own configuration: of another kind than a configuration's it is one line."""

from pathlib import Path

import pytest
from mcap.records import Attachment
from synthetic_flight import CONFIG, fly

from mission.base.errors import InputError
from mission.cli import call
from mission.config.area import BuildingConfig
from mission.log import contents, reader
from mission.log.reader import read_log

WRONG = [
    ("mission = 3", "mission = 3: must be a table"),
    ("link = 'external'", "link = 'external': must be a table"),
    ("radio = [1]", r"radio = \[1\]: must be a table"),
    ("area = 1", "area = 1: must be a table"),
    ("vehicle = true", "vehicle = true: must be a table"),
    ("[vehicle]\naircraft = 'x'", "vehicle.aircraft = 'x': must be a table"),
    ("[vehicle.aircraft]\nwind = 4.5", "vehicle.aircraft.wind = 4.5: must be a table"),
    ("[vehicle.aircraft.wind]\nspeed_mps = '4'", "wind.speed_mps = '4': must be a number"),
    ("[vehicle.aircraft.wind]\nfrom_deg = inf", "wind.from_deg = inf: must be a finite number"),
    ("[vehicle.aircraft.wind]\ngusts = 1", "wind.gusts = 1: must be a list"),
    ("[area]\nno_fly = 'pond'", "area.no_fly = 'pond': must be a list"),
    ("[[area.no_fly]]\nname = 'x'\npolygon_m = [[0, 0], [1], [2, 2]]", "no_fly.0.polygon_m.1 = "),
    ("[[area.no_fly]]\npolygon_m = [[0, 0], [1, 0], [2, 2]]", "area.no_fly.0.name: missing"),
    ("[[area.buildings]]\nheight_m = 3", "area.buildings.0.polygon_m: missing"),
    (
        "[[area.buildings]]\nheight_m = 'x'\npolygon_m = [[0, 0], [1, 0], [2, 2]]",
        "0.height_m = 'x'",
    ),
    ("seed = ", "its config.toml is not valid TOML: "),
    ("seed = '\udcff'", "its config.toml is not valid TOML: "),
]


def with_config(log: Path, text: bytes) -> None:
    """Put another configuration into a log; its checksums are right."""
    found = contents.load(log)
    for batch in found.batches:
        if isinstance(batch, Attachment) and batch.name == "config.toml":
            batch.data = text
    log.write_bytes(contents._rewritten(found))


@pytest.mark.parametrize(("text", "words"), WRONG)
def test_a_configuration_of_wrong_kinds_is_one_line(
    tmp_path: Path, text: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    fly(tmp_path, rounds=1)
    log = tmp_path / "flight.mcap"
    with_config(log, text.encode(errors="surrogateescape"))
    with pytest.raises(InputError, match=words):
        read_log(log)
    for command in ("compare", "report"):
        assert call([command, str(log)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"aerofed: {log}: ")


@pytest.mark.parametrize("text", [CONFIG, b"", b"[area]\nof_later = 1\n[new]\nkey = 2\n"])
def test_keys_of_other_versions_are_not_read(tmp_path: Path, text: bytes) -> None:
    fly(tmp_path, rounds=1)
    with_config(tmp_path / "flight.mcap", text)
    assert call(["compare", str(tmp_path / "flight.mcap")]) == 0


def test_all_that_a_building_may_be_is_read_back() -> None:
    assert reader._Area.Building.model_fields.keys() == BuildingConfig.model_fields.keys()
