"""The same configuration and seed give the same bits, wherever and however often."""

import hashlib
import itertools
import os
import subprocess
import sys
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
from flights import BREEZE, legs, make, path_along, run, take_off
from patience import HANG_S

from flightdyn.config import SensorsConfig


def digest(seed: int, *, noise_between: bool = False) -> str:
    """Of truth and belief at every 5th tick of a short windy flight."""
    aircraft = make(seed=seed, wind=BREEZE, sensors=SensorsConfig())
    other = make(seed=99, wind=BREEZE) if noise_between else None
    total = hashlib.sha256()
    aircraft.arm()
    aircraft.hold(np.array([0.0, 0.0, -20.0]), 0.0)
    run(aircraft, 10.0)
    aircraft.follow(path_along(legs(aircraft.belief.pos_ned_m, (0.0, 120.0), 60.0)))
    for tick in range(2500):
        aircraft.step()
        if other is not None:
            other.step()
        if tick % 5 == 0:
            for k in (aircraft.truth, aircraft.belief):
                total.update(k.pos_ned_m.tobytes() + k.q_frd_to_ned.tobytes())
    return total.hexdigest()


def test_twice_in_one_process_interleaved_with_another_aircraft() -> None:
    assert digest(5) == digest(5, noise_between=True)


@pytest.mark.slow
def test_in_another_process() -> None:
    code = "from test_determinism import digest; print(digest(5))"
    root = Path(__file__).parents[2]
    path = f"{root}:{root}/tests:{Path(__file__).parent}"
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": "7"},
        timeout=HANG_S,
    )
    assert result.stdout.strip() == digest(5)


def in_strides(*strides: int, gnss: bool) -> tuple[bytes, list[tuple[object, ...]]]:
    """Where a windy flight round corners ends that is flown in strides of so many ticks at most,
    and when its progress became another one.
    """
    aircraft = make(seed=4, wind=BREEZE, sensors=SensorsConfig())
    take_off(aircraft, 20.0)
    assert aircraft.sensors is not None
    aircraft.sensors.receiver.on = gnss
    turns = (0.0, 120.0, 100.0, -60.0, 90.0, -130.0, 60.0, 110.0, 170.0)
    aircraft.follow(path_along(legs(aircraft.belief.pos_ned_m, turns, 30.0)))
    lengths = itertools.cycle(strides)
    progress = [(aircraft.t_ns, *astuple(aircraft.progress))]
    while (left := 60 * 250 - aircraft.t_ns // aircraft.dt_ns) > 0:
        aircraft.advance(min(left, next(lengths)))
        now = astuple(aircraft.progress)
        if progress[-1][1:] != now:
            progress.append((aircraft.t_ns, *now))
    states = (aircraft.truth, aircraft.belief)
    return b"".join(part.tobytes() for state in states for part in state[1:]), progress


@pytest.mark.slow
@pytest.mark.parametrize("gnss", [True, False])
def test_strides_and_single_ticks_are_the_same_flight(gnss: bool) -> None:
    one_by_one = in_strides(1, gnss=gnss)
    assert [seen[1] for seen in one_by_one[1]] == list(range(1, 11))
    assert in_strides(250, gnss=gnss) == one_by_one
    assert in_strides(3, 250, 17, 64, gnss=gnss) == one_by_one


def test_another_seed_is_another_flight() -> None:
    assert digest(5) != digest(6)


def test_looking_does_not_change_the_flight() -> None:
    """Truth, belief and battery may be read at any tick, or never."""

    def flight(look: bool) -> bytes:
        aircraft = make(seed=3, wind=BREEZE, sensors=SensorsConfig())
        aircraft.arm()
        aircraft.hold(np.array([0.0, 0.0, -10.0]), 0.0)
        for _ in range(2000):
            aircraft.step()
            if look:
                assert aircraft.truth.t_ns == aircraft.belief.t_ns
                _ = aircraft.battery, aircraft.cmd_pos_ned_m, aircraft.progress, aircraft.ready
        return aircraft.truth.pos_ned_m.tobytes()

    assert flight(True) == flight(False)
