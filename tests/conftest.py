"""What several areas of the tests share."""

import gc
import os
import signal
import sys
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path

# Before NumPy and torch are imported: tests run beside each other, and threads that wait for each
# other on a busy processor spend several times what they compute.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import hypothesis
import pytest

# Hundreds of processes load the same modules: they are compiled once, also where the environment
# asks for no trace, as that of an image of Docker may.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# No test depends on how fast the machine is.
hypothesis.settings.register_profile("aerofed", deadline=None)
hypothesis.settings.load_profile("aerofed")

# A background job of a shell starts with SIGINT ignored, one of nohup with SIGHUP, and hands that
# down; the tests of interruptions need processes that hear them. xdist's workers inherit it from
# the controlling process.
for _number, _heard in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _heard)


# As the program has it; and what is loaded with the tests is not looked through for garbage at all.
gc.set_threshold(20_000, 20, 50)


def pytest_collection_finish() -> None:
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Each of several processes begins at another file: in a fresh clone it finds those compiled,
    asserts and all, that another has begun with."""
    report = yield
    if isinstance(collector, pytest.Directory) and report.result:
        number = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
        count = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
        first = len(report.result) * number // count
        report.result = report.result[first:] + report.result[:first]
    return report


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whatever reads the real data sets is `real`. Files with many slow tests come first, and of
    those with none the ones with many tests, so that at the end no process waits for one that has
    just begun such a file."""
    for item in items:
        if "shared_data" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.real)
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    every = Counter(item.path for item in items)
    items.sort(key=lambda item: (-slow[item.path], -every[item.path], item.path))


@pytest.fixture(scope="session", autouse=True)
def _undrawn() -> Iterator[None]:
    """Tests that look at pictures say `with drawn()`, or `with outlined()`."""
    from drawing import undrawn  # the process that only hands tests out does without Aerofed

    with undrawn():
        yield


@pytest.fixture(scope="session", autouse=True)
def _unsynced() -> Iterator[None]:
    """No power fails while tests run: what they write waits for no disk. Programs that they start
    do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", os.fstat)  # which takes what is open only, too
        yield


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real MNIST and CIFAR-10 files that may lie beside the checkout."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"needs the real data sets in {folder}")
    return folder


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans within limits are improved by a tenth of the usual changes: for tests that ask what a
    plan keeps to, and what its bound is, not how good it is."""
    monkeypatch.setattr("mission.planner.improving._CHANGES", 4000)
