"""The truth of the last while, as it is asked for afterwards."""

import numpy as np
import pytest
from firmware_stand_ins import plant

from flightdyn.plant import Plant
from sitl.firmware.native.library import Hil, Stepped
from sitl.firmware.together import TruthHistory

INTERVAL_NS = 20_000_000


def flown(aircraft: Plant, *motors: float) -> Stepped:
    """An aircraft that is stepped as a bridge does it, with these motors."""
    assert aircraft.sensors is not None
    return Stepped(aircraft, aircraft.sensors.imu, Hil(motors=motors))


def falling(intervals: int) -> tuple[TruthHistory, list[float]]:
    """A climb at full power, and the heights at the ends of its intervals."""
    aircraft = plant()
    link, heights = flown(aircraft, 0.9, 0.9, 0.9, 0.9), [aircraft.truth.alt_rel_m]
    past = TruthHistory(aircraft, link.truths)
    for _ in range(intervals):
        for _ in range(aircraft.interval):
            link.hil_tick()
        heights.append(aircraft.truth.alt_rel_m)
    return past, heights


def test_what_was_kept_is_what_was() -> None:
    aircraft = plant()
    link = flown(aircraft, 0.9, 0.8, 0.9, 0.8)
    past = TruthHistory(aircraft, link.truths)
    for _ in range(50 * aircraft.interval):
        link.hil_tick()
        past.keep_battery()
    truth, newest = aircraft.truth, past.newest
    for kinematics in (newest.kinematics, past.at(aircraft.t_ns).kinematics):
        assert kinematics.t_ns == truth.t_ns
        for name in ("pos_ned_m", "vel_ned_mps", "q_frd_to_ned", "omega_frd_radps"):
            np.testing.assert_array_equal(getattr(kinematics, name), getattr(truth, name))
    np.testing.assert_array_equal(newest.wind_ned_mps, aircraft.wind_ned_mps)
    assert newest.battery == aircraft.battery
    assert past.motors(aircraft.t_ns) == [0.9, 0.8, 0.9, 0.8]


def test_between_two_it_lies_between_and_beyond_them_it_goes_on() -> None:
    past, heights = falling(100)
    for k in (10, 50, 98):
        between = past.at(k * INTERVAL_NS + INTERVAL_NS // 4).kinematics
        assert between.alt_rel_m == pytest.approx(0.75 * heights[k] + 0.25 * heights[k + 1])
        assert between.t_ns == k * INTERVAL_NS + INTERVAL_NS // 4
    newest = past.newest.kinematics
    later = past.at(newest.t_ns + INTERVAL_NS).kinematics
    climb = -float(newest.vel_ned_mps[2])
    assert later.alt_rel_m == pytest.approx(heights[-1] + climb * 0.02)
    assert past.at(-INTERVAL_NS).kinematics.alt_rel_m == pytest.approx(heights[0], abs=1e-3)


def test_only_the_newest_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sitl.firmware.native.library.KEPT", 32)
    past, heights = falling(100)
    assert past.at(90 * INTERVAL_NS).kinematics.alt_rel_m == pytest.approx(heights[90])
    # What is gone is told by the oldest that is left, by its velocity.
    oldest = past.at(76 * INTERVAL_NS).kinematics
    assert oldest.alt_rel_m == pytest.approx(heights[76])
    gone = past.at(70 * INTERVAL_NS).kinematics
    climb = -float(oldest.vel_ned_mps[2])
    assert gone.alt_rel_m == pytest.approx(heights[76] - 6 * 0.02 * climb)


def test_attitudes_are_the_nearer_ones_and_batteries_each_fifth() -> None:
    """Of the two intervals about it; of each fifth the newest before it."""
    aircraft = plant()
    link = flown(aircraft, 0.9, 0.5, 0.8, 0.7)
    past, batteries = TruthHistory(aircraft, link.truths), [aircraft.battery]
    for number in range(1, 25):
        for _ in range(aircraft.interval):
            link.hil_tick()
        past.keep_battery()
        if number % 5 == 0:
            batteries.append(aircraft.battery)
    assert len(set(batteries)) == 5
    turned = [past.at(n * INTERVAL_NS).kinematics for n in range(25)]
    for n in range(5, 24):
        for share, nearer in ((0.25, n), (0.5, n), (0.55, n + 1), (0.9, n + 1)):
            moment = past.at(n * INTERVAL_NS + round(share * INTERVAL_NS))
            for name in ("q_frd_to_ned", "omega_frd_radps"):
                told, kept = (getattr(k, name) for k in (moment.kinematics, turned[nearer]))
                np.testing.assert_array_equal(told, kept)
            assert moment.battery == batteries[nearer // 5]
    aircraft.exchange_battery()
    past.keep_battery(exchanged=True)
    assert past.newest.battery == aircraft.battery != batteries[-1]
