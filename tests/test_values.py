"""Values are frozen: who is handed one may keep it, as nobody changes it behind their back."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("aerofed", "fl", "flightdyn", "mission", "native", "pytest_aerofed", "sitl")
# Classes of state that has a lifetime, of whose fields some change in it.
CHANGE = """
    Battery BuiltInFlyer Cockpit Contents Experiment ExternalFlyer Failsafes FirmwareFlyer Fleet
    FlownExperiment FolderRecorder IdealExperiment LogRows Outcome Outing PathProgress PlanFlight
    RunTotals UnflownFlyer WorldFleet _Compiler _Download _Ending _Flights _Leg _Part _Proof
    _Repeated _Search _Upload
"""
DATACLASS = re.compile(r"^@dataclass\b(.*)\n(?:@.*\n)*class (\w+)", re.MULTILINE)


def test_all_dataclasses_but_those_of_state_are_frozen() -> None:
    found = [
        one.groups()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        for one in DATACLASS.finditer(path.read_text(encoding="utf-8"))
    ]
    assert sorted(name for how, name in found if "frozen=True" not in how) == CHANGE.split()
    assert len(found) > 200
