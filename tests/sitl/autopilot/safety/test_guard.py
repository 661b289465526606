"""What a flight depends on: thresholds of the charge."""

from types import SimpleNamespace
from typing import cast

import numpy as np

from flightdyn.aircraft import Aircraft
from flightdyn.state import GeodeticPoint
from sitl.autopilot.guard import CRITICAL, EMERGENCY, LOW, Guard
from sitl.autopilot.parameters import Parameters


def test_a_charge_is_low_until_it_is_two_percent_above_the_threshold() -> None:
    battery = SimpleNamespace(remaining=1.0)
    aircraft = SimpleNamespace(
        frame=SimpleNamespace(origin=GeodeticPoint(47.0, 8.0, 0.0)),
        belief=SimpleNamespace(q_frd_to_ned=np.array([1.0, 0.0, 0.0, 0.0])),
        battery=battery,
    )
    limits = {LOW: 0.15, CRITICAL: 0.07, EMERGENCY: 0.05}
    guard = Guard(cast(Aircraft, aircraft), cast(Parameters, limits))
    found = []
    for charge in (0.151, 0.149, 0.169, 0.171, 0.151, 0.069, 0.089, 0.091, 0.049, 0.069, 0.071):
        battery.remaining = charge
        below = guard.look_at_charge()
        found.append([name for name in limits if below[name]])
    assert found == [
        [], [LOW], [LOW], [], [], [LOW, CRITICAL], [LOW, CRITICAL], [LOW],
        [LOW, CRITICAL, EMERGENCY], [LOW, CRITICAL, EMERGENCY], [LOW, CRITICAL],
    ]  # fmt: skip
