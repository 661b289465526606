"""docs/mavlink.md against the tables that it describes."""

import re
from pathlib import Path

from sitl_desk import Desk

from sitl.autopilot.modes import Mode
from sitl.autopilot.parameters import TABLE
from sitl.autopilot.protocol.item_rules import NAVIGATION
from sitl.autopilot.protocol.streams import DEFAULT_RATES_HZ, SERVED_RATES_HZ
from sitl.autopilot.safety.failsafe import RULES
from sitl.autopilot.safety.injection import FAILURES
from sitl.autopilot.values.enums import Command, FailureType, FailureUnit

TEXT = (Path(__file__).parents[4] / "docs" / "mavlink.md").read_text(encoding="utf-8")
UNITS = {FailureUnit.GNSS: "SENSOR_GPS", FailureUnit.MOTOR: "SYSTEM_MOTOR"}


def section(title: str) -> str:
    found = re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL)
    assert found, title
    return found.group(1)


def test_parameters() -> None:
    rows = [line for line in section("Parameters").splitlines() if line.startswith("| `")]
    assert rows == [
        f"| `{s.name}` | {s.default:g} | {s.low:g} | {s.high:g} | {s.unit} | {s.text} |"
        for s in TABLE
    ]


def test_commands_items_modes_failsafes_and_failures() -> None:
    named = set(re.findall(r"`([A-Z][A-Z_]+)`", section("Commands"))) - {"MIS_TAKEOFF_ALT"}
    known = Desk().vehicle.autopilot.commands.known
    assert named == {Command(number).name for number in known}
    items = set(re.findall(r"`([A-Z][A-Z_]+)`", section("Missions")))
    assert {command.name for command in NAVIGATION} <= items
    for mode in Mode:
        assert f"| {mode.name} | {mode.value[0]}, {mode.value[1]} |" in section("Modes")
    for rule in RULES.values():
        assert f"`{rule.parameter}`" in section("Failsafes")
    for unit, kind in FAILURES:
        row = f"| {UNITS.get(unit, f'SENSOR_{unit.name}')} | {kind.name} |"
        assert row in section("Failures")
    assert FailureType.OK.name in section("Failures")


def test_telemetry() -> None:
    rows = [line for line in section("Telemetry").splitlines() if line.startswith("| `")]
    rates = {kind: DEFAULT_RATES_HZ.get(kind) for kind in SERVED_RATES_HZ}
    assert rows == [
        f"| `{kind.name}` | {'' if run is None else f'{run:g}'} | {SERVED_RATES_HZ[kind]:g} |"
        for kind, run in sorted(rates.items(), key=lambda item: item[0].name)
    ]
