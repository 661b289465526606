"""Fixtures of simulated vehicles for pytest; Aerofed is imported where one is used.

    @pytest.mark.aerofed(home="survey.plan")
    def test_a_survey(vehicle):
        vehicle.fly("survey.plan")
        vehicle.compare().check(cross_track_max_m=3)

A package of its own, so that pytest loads this file and nothing else where no test flies.
"""

import inspect
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from mission.api.fleet import Fleet
    from mission.api.simulated_vehicle import SimulatedVehicle

_MARKER = "aerofed(overrides, **options): what aerofed.vehicle takes, for `vehicle` and `vehicles`"
# What stands between a test and the place of an error; the last two are Python's.
_OURS = {__name__, "aerofed", "mission", "sitl", "flightdyn", "fl", "asyncio", "contextlib"}
_LOGS = pytest.StashKey[Path]()


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker `aerofed`."""
    config.addinivalue_line("markers", _MARKER)


@pytest.fixture
def vehicle(vehicles: "Callable[..., Fleet]") -> "SimulatedVehicle":
    """A vehicle of this test's own, on the ground, as @pytest.mark.aerofed(wind_mps=6) has it."""
    (one,) = vehicles(1)
    return one


@pytest.fixture
def vehicles(request: pytest.FixtureRequest, tmp_path: Path) -> "Iterator[Callable[..., Fleet]]":
    """`vehicles(3, wind_mps=6)`: several in one world, with the marker's options and these; the
    test is skipped where they name a firmware that is not there."""
    import aerofed
    from mission.api.vehicles import NoFirmwareError

    marker = request.node.get_closest_marker("aerofed")
    request.node.stash[_LOGS] = logs = tmp_path / "flights"
    with ExitStack() as opened:

        def made(count: "int | Sequence[str]", **options: Any) -> "Fleet":
            first, marked = ((), {}) if marker is None else (marker.args, dict(marker.kwargs))
            keys = *first, marked.pop("overrides", None), options.pop("overrides", None)
            given = {"logs": logs, **marked, **options}
            _check(keys, given)
            overrides = {key: value for some in keys for key, value in dict(some or {}).items()}
            try:
                return opened.enter_context(aerofed.vehicles(count, overrides, **given))
            except NoFirmwareError as error:
                pytest.skip(str(error))

        yield made


def _check(keys: Iterable[object], options: Iterable[str]) -> None:
    """Raise InputError at what `aerofed.vehicles` would not take beside its count."""
    import aerofed
    from mission.api.configuring import checked
    from native.errors import did_you_mean

    _, *known = inspect.signature(aerofed.vehicles).parameters
    for name in options:
        if name not in known:
            raise aerofed.InputError(
                f"aerofed's marker and vehicles(): {name}: unknown option"
                f"{did_you_mean(name, known)} (known: {', '.join(known)})"
            )
    for some in keys:
        checked("quickstart", some)


@pytest.fixture
def px4(vehicles: "Callable[..., Fleet]") -> "SimulatedVehicle":
    """As `vehicle`, flown by the PX4 that AEROFED_PX4 names; without one the test is skipped."""
    (one,) = vehicles(1, firmware="px4")
    return one


@pytest.fixture
def arducopter(vehicles: "Callable[..., Fleet]") -> "SimulatedVehicle":
    """As `vehicle`, flown by the ArduCopter that AEROFED_ARDUCOPTER names; else skipped."""
    (one,) = vehicles(1, firmware="arducopter")
    return one


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Show errors of Aerofed's from the line of the test on, without the library's own frames, and
    add the paths of the flight logs to the report of a failed test."""
    ours = getattr(sys.modules.get("mission.base.errors"), "AerofedError", None)
    if ours is not None and call.excinfo is not None and call.excinfo.errisinstance(ours):
        for name, module in tuple(sys.modules.items()):
            if name.partition(".")[0] in _OURS:
                vars(module)["__tracebackhide__"] = lambda info: info.errisinstance(ours)
    report = yield
    if report.failed and _LOGS in item.stash:
        logs = sorted(item.stash[_LOGS].rglob("*.mcap"))
        if logs:
            report.sections.append(("flight logs", "\n".join(map(str, logs))))
    return report
