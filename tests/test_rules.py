"""Rules of the product's code that no other tool checks."""

import re
from collections import Counter
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
# Where one of what is paired may be longer: neighbours, and what is known of as many as there are.
OF_ANY_LENGTH = {
    "fl/training/torch_module.py": 1,
    "mission/base/geo_file.py": 1,
    "mission/figures/told.py": 1,
    "mission/flight/logs/dataflash.py": 1,
    "mission/log/inspection.py": 1,
    "mission/log/values.py": 2,
    "mission/run/recorder.py": 1,
    "mission/scenario/radio_maps.py": 1,
    "sitl/autopilot/flying/route.py": 1,
}


def product() -> dict[str, str]:
    """The text of each file, by its path."""
    return {
        str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    }


def test_all_dataclasses_but_those_of_state_are_frozen() -> None:
    """Who is handed a value may keep it, as nobody changes it behind their back."""
    found = [one.groups() for text in product().values() for one in DATACLASS.finditer(text)]
    assert sorted(name for how, name in found if "frozen=True" not in how) == CHANGE.split()
    assert len(found) > 200


def test_what_is_paired_is_of_one_length_but_in_a_few_places() -> None:
    """Ruff sees to it that each zip() says which; a mistake of lengths is loud."""
    found = {path: Counter(re.findall(r"strict=\w+", text)) for path, text in product().items()}
    loose = {path: each["strict=False"] for path, each in found.items() if each["strict=False"]}
    assert loose == OF_ANY_LENGTH
    assert sum(each["strict=True"] for each in found.values()) > 150
