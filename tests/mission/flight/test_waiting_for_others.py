"""A vehicle that stands still because another one's pilot is waited for has not fallen silent."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from mission.base.errors import LinkLostError
from mission.flight.pilot.pilot import Pilot
from mission.flight.pilot.watch import Watch
from sitl.pace import Simulation


def silent_for(seconds: float, monkeypatch: pytest.MonkeyPatch) -> Watch:
    """The watch of a vehicle that has said nothing new for so long."""
    clock = SimpleNamespace(time=lambda: 0.0)
    loop = SimpleNamespace(get_running_loop=lambda: clock)
    monkeypatch.setattr("mission.flight.pilot.watch.asyncio", loop)
    monkeypatch.setattr("mission.flight.pilot.watch.TelemetryAsync", Mock())
    watch = Watch(Mock())
    clock.time = lambda: seconds
    return watch


@pytest.mark.parametrize(("others_move", "fails"), [(False, False), (True, True)])
def test_who_stands_still_for_others_is_not_silent(
    others_move: bool, fails: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    vehicle, other = Mock(moving=True), Mock(moving=others_move)
    world: Any = SimpleNamespace(piloted={vehicle, other})
    pilot: Any = SimpleNamespace(
        watch=silent_for(31.0, monkeypatch),
        waits=lambda: Simulation.waits(world, vehicle),
        _stall_timeout_s=30.0,
    )
    if fails:
        with pytest.raises(LinkLostError, match="no sign of the vehicle for 31 s"):
            Pilot._check_alive(pilot, "finish the mission")
    else:
        Pilot._check_alive(pilot, "finish the mission")
    other.moving = True  # and from then on time counts again
    assert pilot.watch.silence_s == (31.0 if fails else 0.0)


def test_who_is_waited_for_may_fall_silent() -> None:
    vehicle = Mock(moving=False)
    world: Any = SimpleNamespace(piloted={vehicle, Mock(moving=True)})
    assert not Simulation.waits(world, vehicle)
