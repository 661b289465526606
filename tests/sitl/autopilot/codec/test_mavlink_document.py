"""docs/mavlink.md against the tables that it describes."""

import re
from pathlib import Path

from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk

from sitl.autopilot.codec.orders import bare_name
from sitl.autopilot.failsafe import RULES
from sitl.autopilot.flying.modes import Mode
from sitl.autopilot.injection import FAILURES
from sitl.autopilot.parameters import TABLE
from sitl.autopilot.protocol.order_rules import COMMANDS
from sitl.autopilot.protocol.streams import DEFAULT_RATES_HZ, SERVED_RATES_HZ

TEXT = (Path(__file__).parents[4] / "docs" / "mavlink.md").read_text(encoding="utf-8")


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
    assert named == set(map(bare_name, known))
    items = set(re.findall(r"`([A-Z][A-Z_]+)`", section("Missions")))
    assert set(map(bare_name, COMMANDS)) <= items
    for mode in Mode:
        assert f"| {mode.name} | {mode.value[0]}, {mode.value[1]} |" in section("Modes")
    for rule in RULES.values():
        assert f"`{rule.parameter}`" in section("Failsafes")
    for unit, kind in FAILURES:
        failing = mav.enums["FAILURE_UNIT"][unit].name.removeprefix("FAILURE_UNIT_")
        how = mav.enums["FAILURE_TYPE"][kind].name.removeprefix("FAILURE_TYPE_")
        assert f"| {failing} | {how} |" in section("Failures")
    assert "OK" in section("Failures")


def test_telemetry() -> None:
    rows = [line for line in section("Telemetry").splitlines() if line.startswith("| `")]
    rates = [
        (mav.mavlink_map[kind].msgname, DEFAULT_RATES_HZ.get(kind), served)
        for kind, served in SERVED_RATES_HZ.items()
    ]
    assert rows == [
        f"| `{name}` | {'' if run is None else f'{run:g}'} | {served:g} |"
        for name, run, served in sorted(rates, key=lambda row: row[0])
    ]
