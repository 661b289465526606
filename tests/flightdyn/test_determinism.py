"""The same configuration and seed give the same bits, wherever and however often."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from flights import BREEZE, legs, make, path_along, run

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
    path = f"{root}:{Path(__file__).parent}"
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": "7"},
        timeout=900,
    )
    assert result.stdout.strip() == digest(5)


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
