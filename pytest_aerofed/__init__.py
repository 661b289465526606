"""Fixtures of simulated vehicles for pytest; Aerofed is imported where one is used.

    @pytest.mark.aerofed(home="survey.plan")
    def test_a_survey(vehicle):
        vehicle.fly("survey.plan")
        vehicle.compare().check(cross_track_max_m=3)

A package of its own, so that pytest loads this file and nothing else where no test flies.
"""

from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from mission.api.simulated_vehicle import SimulatedVehicle

_MARKER = "aerofed(overrides, **options): what aerofed.vehicle takes, for `vehicle` and `vehicles`"
_LOGS = pytest.StashKey[Path]()


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker `aerofed`."""
    config.addinivalue_line("markers", _MARKER)


@pytest.fixture
def vehicle(vehicles: "Callable[..., list[SimulatedVehicle]]") -> "SimulatedVehicle":
    """A vehicle of this test's own, on the ground, as @pytest.mark.aerofed(wind_mps=6) has it."""
    (one,) = vehicles(1)
    return one


@pytest.fixture
def vehicles(
    request: pytest.FixtureRequest, tmp_path: Path
) -> "Iterator[Callable[..., list[SimulatedVehicle]]]":
    """`vehicles(3, wind_mps=6)`: several, side by side, with the marker's options and these; the
    test is skipped where they name a firmware that is not there."""
    import aerofed
    from mission.api.vehicles import NoFirmwareError

    marker = request.node.get_closest_marker("aerofed")
    request.node.stash[_LOGS] = logs = tmp_path / "flights"
    with ExitStack() as opened:

        def made(count: int, **options: Any) -> "list[SimulatedVehicle]":
            first, marked = ((), {}) if marker is None else (marker.args, dict(marker.kwargs))
            keys = *first, marked.pop("overrides", None), options.pop("overrides", None)
            overrides = {key: value for some in keys for key, value in dict(some or {}).items()}
            given = {"logs": logs, **marked, **options}
            try:
                return opened.enter_context(aerofed.vehicles(count, overrides, **given))
            except NoFirmwareError as error:
                pytest.skip(str(error))

        yield made


@pytest.fixture
def px4(vehicles: "Callable[..., list[SimulatedVehicle]]") -> "SimulatedVehicle":
    """As `vehicle`, flown by the PX4 that AEROFED_PX4 names; without one the test is skipped."""
    (one,) = vehicles(1, firmware="px4")
    return one


@pytest.fixture
def arducopter(vehicles: "Callable[..., list[SimulatedVehicle]]") -> "SimulatedVehicle":
    """As `vehicle`, flown by the ArduCopter that AEROFED_ARDUCOPTER names; else skipped."""
    (one,) = vehicles(1, firmware="arducopter")
    return one


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the paths of the flight logs to the report of a failed test."""
    report = yield
    if report.failed and _LOGS in item.stash:
        found = sorted(item.stash[_LOGS].rglob("*.mcap"))
        if found:
            report.sections.append(("flight logs", "\n".join(map(str, found))))
    return report
