"""The fixtures that others' tests use, in a pytest of their own."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from patience import HANG_S

SURVEY = Path(__file__).parents[1] / "examples" / "survey.plan"


def ran(folder: Path, tests: str, *options: str, **env: str) -> tuple[int, str]:
    """Exit code and words of pytest on these tests, with more in the environment."""
    (folder / "test_flights.py").write_text(tests)
    command = [sys.executable, *options, "-m", "pytest", "-q", "--basetemp", str(folder / "kept")]
    ended = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=HANG_S, check=False,
        env={**os.environ, **env},
    )  # fmt: skip
    return ended.returncode, ended.stdout + ended.stderr


@pytest.mark.slow
def test_each_test_has_a_vehicle_and_a_failed_one_keeps_its_log(tmp_path: Path) -> None:
    code, words = ran(
        tmp_path,
        f"""
import pytest

@pytest.mark.aerofed(wind_mps=6, home={str(SURVEY)!r})
def test_a_survey(vehicle):
    vehicle.fly({str(SURVEY)!r})
    vehicle.compare().check(cross_track_max_m=0.1)

def test_another(vehicle):
    assert vehicle.t_s < 1.0

@pytest.mark.aerofed(seed=2)
def test_several(vehicles):
    a, b = vehicles(2)
    b.step(3)
    assert b.t_s == a.t_s > 3

@pytest.mark.aerofed({{"vehicle.aircraft.wind.speed_mps": 3}})
def test_keys_of_both(vehicles):
    vehicles(1, overrides={{"seed": 4}})
""",
    )
    assert code == 1, words
    assert "1 failed, 3 passed" in words
    assert "cross_track_max_m = " in words
    _, _, after = words.partition("flight logs")
    log = Path(after.splitlines()[1])
    assert log.is_file(), words
    assert log.name == "flight-0001.mcap"


def test_nothing_is_imported_where_nothing_flies(tmp_path: Path) -> None:
    code, words = ran(
        tmp_path,
        """
import sys

def test_imports():
    assert "pytest_aerofed" in sys.modules
    assert not {"aerofed", "mission", "numpy"} & set(sys.modules)
""",
    )
    assert code == 0, words


@pytest.mark.slow
def test_errors_are_shown_where_the_test_made_them(tmp_path: Path) -> None:
    code, words = ran(
        tmp_path,
        """
import contextlib, pytest

@pytest.mark.aerofed(wnd_mps=6)
def test_misspelt(vehicle): ...
@pytest.mark.aerofed("survey.plan")
def test_a_plan(vehicle): ...
@pytest.mark.aerofed(count=3)
def test_count(vehicle): ...
def test_called(vehicles): vehicles(2, sed=1)
def test_number(vehicles): vehicles("two")
def test_step(vehicle): vehicle.step("long")
def test_in_vain(vehicle): vehicle.until(lambda v: v.armed, timeout_s=0.2)
def test_plan(vehicle): vehicle.fly("nowhere.plan")
def test_limit(vehicle): vehicle.compare()
def test_mine(vehicle): vehicle.until(lambda v: 1 / 0)
def test_others():
    with contextlib.suppress(OSError):
        raise KeyError("theirs")
""",
        PYTEST_ADDOPTS="--tb=long",
    )
    assert code == 1, words
    assert "8 failed, 3 errors" in words
    for said in (
        "wnd_mps: unknown option; did you mean wind_mps? (known: overrides, each, source, ",
        "overrides = 'survey.plan': must be a dictionary",
        "count: unknown option (known: ",
        "sed: unknown option; did you mean seed?",
        "count = 'two': must be a whole number",
        "step('long'): simulated seconds",
        "not within 0.2 s of simulated time",
        "nowhere.plan: cannot be read",
    ):
        assert f": {said}" in words, said
    places = re.findall(r"^(\S+\.py):\d+: ", words, re.MULTILINE)
    assert set(places) == {"test_flights.py"}


@pytest.mark.slow
def test_without_a_firmware_its_tests_are_skipped_and_with_one_that_is_not_there_they_fail(
    tmp_path: Path,
) -> None:
    code, words = ran(
        tmp_path,
        "import pytest\ndef test_px4(px4): ...\ndef test_arducopter(arducopter): ...\n"
        "@pytest.mark.aerofed(firmware='arducopter')\ndef test_marked(vehicle): ...\n",
        AEROFED_PX4="nowhere/px4",
        AEROFED_ARDUCOPTER="",
        PYTEST_ADDOPTS="-rs",
    )
    assert code == 1, words
    assert "2 skipped, 1 error" in words
    assert "firmware = 'arducopter': AEROFED_ARDUCOPTER names no binary" in words
    assert "nowhere/px4: no such file" in words


@pytest.mark.real
@pytest.mark.parametrize("fixture", ["px4", "arducopter"])
def test_a_real_firmware_flies_in_a_fixture(tmp_path: Path, fixture: str) -> None:
    variable = f"AEROFED_{fixture.upper()}"
    if not os.environ.get(variable):
        pytest.skip(f"needs a real binary in {variable}")
    code, words = ran(
        tmp_path,
        f"""
import pytest

@pytest.mark.aerofed(wind_mps=3, home={str(SURVEY)!r})
def test_a_survey({fixture}):
    {fixture}.fly({str(SURVEY)!r})
    {fixture}.compare().check(straight_max_m=3)
    {fixture}.compare({str(SURVEY)!r}).check(straight_max_m=0.01)
""",
    )
    assert code == 1, words
    assert "straight_max_m = " in words
    _, _, after = words.partition("flight logs")
    assert Path(after.splitlines()[1]).is_file(), words
