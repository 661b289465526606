"""`aerofed world --ardupilot`: process after process of ArduPilot is served."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from firmware_stand_ins import ArduPilotStandIn
from patience import until
from serving import free_port

from mission.cli import call
from mission.config.loading import load_config
from mission.flight.serve.world import serve_world


@contextmanager
def world(port: int, said: list[str]) -> Iterator[None]:
    stop, config = threading.Event(), load_config(Path("quickstart"))

    def serve() -> None:
        serve_world(config, "ardupilot", port=port, speed=1.0, say=said.append, stop=stop)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def test_a_rebooted_ardupilot_is_answered_and_the_aircraft_stands_at_home_again() -> None:
    """It speaks from another port then, as after each parameter change that asks for a reboot."""
    port, said = free_port(), list[str]()
    with world(port, said):
        for _ in range(3):
            process = ArduPilotStandIn(port)
            for count in range(3):
                stamp = answered(process, count)
                assert stamp < 1.0
            process.close()
    assert [line.split(" after")[0] for line in said].count("ArduPilot has started anew") == 2


def answered(process: ArduPilotStandIn, count: int) -> float:
    """The time stamp of the answer to a request that is repeated, as ArduPilot does."""
    answers: list[float] = []

    def has_come() -> bool:
        try:
            process.ask(count)
            answers.append(process.answer()["timestamp"])
        except OSError:
            return False
        return True

    until(has_come)
    return answers[0]


def test_a_fault_after_what_nobody_tells_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    fault = 'vehicle.aircraft.faults=[{kind="gnss_off", after="take-off"}]'
    assert call(["world", "--px4", "--set", fault]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "vehicle.aircraft.faults: after = 'take-off': aerofed world is not told" in line
