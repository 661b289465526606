"""What a vehicle's parameters let it do against what a flight asks, and parameters for a flight."""

import asyncio
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import common as mav

from mission.base.errors import FlightError, LinkLostError
from mission.flight.missions.round_mission import Demand
from mission.flight.pilot.feed import BatteryWatch, VehicleClock
from mission.flight.pilot.parameters import (
    ARDUPILOT_LIMITS,
    PX4_LIMITS,
    LimitNames,
    Parameters,
    VehicleLimits,
    adjusted,
    read_limits,
)
from mission.flight.pilot.watch import Readiness

DEMAND = Demand(speed_mps=20.0, altitude_m=60.0, distance_m=500.0, acceptance_m=5.0)


class Table(Parameters):
    """A vehicle's parameters as a table; it falls silent when told to."""

    def __init__(self, **values: float) -> None:
        self.values = dict(values)
        self.silent = False
        self.lacked: list[str] = []

    async def get(self, name: str) -> float | None:
        if name not in self.values:
            self.lacked.append(name)
        return self.values.get(name)

    async def set(self, name: str, value: float) -> None:
        if self.silent:
            raise FlightError("silent")
        self.values[name] = value


def told(names: LimitNames, **values: float) -> VehicleLimits:
    return asyncio.run(read_limits(Table(**values), names))


def test_px4_flies_no_faster_than_it_may() -> None:
    limits = told(PX4_LIMITS, MPC_XY_VEL_MAX=12.0, MPC_XY_CRUISE=5.0)
    assert limits.speed_mps == 12.0
    (phrase,) = limits.shortfalls(DEMAND, adjusted=False)
    assert phrase.startswith("12 m/s at most (MPC_XY_VEL_MAX = 12), 20 asked")
    assert "link.set_parameters" in phrase
    assert limits.adjustments(DEMAND) == {"MPC_XY_VEL_MAX": (12.0, 20.0)}
    assert not limits.shortfalls(DEMAND, adjusted=True)


def test_ardupilot_counts_in_centimetres_and_cuts_its_own_corners() -> None:
    limits = told(ARDUPILOT_LIMITS, WPNAV_SPEED=1000.0, WPNAV_RADIUS=800.0)
    # An ordered speed is not held against WPNAV_SPEED.
    assert limits.speed_mps == float("inf")
    assert limits.value("cruise_mps", otherwise=0.0) == 10.0
    (phrase,) = limits.shortfalls(DEMAND, adjusted=False)
    assert phrase.startswith("corners cut by up to 8 m (WPNAV_RADIUS = 800), 5 asked")
    assert limits.adjustments(DEMAND) == {"WPNAV_RADIUS": (800.0, 500.0)}


def test_newer_names_count_in_metres() -> None:
    assert told(ARDUPILOT_LIMITS, WP_RADIUS_M=8.0).adjustments(DEMAND) == {
        "WP_RADIUS_M": (8.0, 5.0)
    }


def test_of_a_newer_version_one_older_name_is_waited_for() -> None:
    table = Table(
        WP_SPD=10.0, WP_ACC=2.5, ATC_ANGLE_MAX=30.0, WP_RADIUS_M=2.0,
        FENCE_ENABLE=0.0, FENCE_TYPE=7.0, FENCE_RADIUS=300.0, FENCE_ALT_MAX=100.0,
    )  # fmt: skip
    limits = asyncio.run(read_limits(table, ARDUPILOT_LIMITS))
    assert table.lacked == ["WPNAV_SPEED"]
    assert limits.value("tilt_deg", otherwise=0.0) == 30.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"FENCE_ENABLE": 1, "FENCE_RADIUS": 300, "FENCE_TYPE": 7}, ["300 m from home"]),
        ({"FENCE_ENABLE": 1, "FENCE_ALT_MAX": 50, "FENCE_TYPE": 1}, ["50 m above home"]),
        ({"FENCE_ENABLE": 1, "FENCE_RADIUS": 300, "FENCE_TYPE": 1}, []),
        ({"FENCE_ENABLE": 0, "FENCE_RADIUS": 300, "FENCE_TYPE": 7}, []),
        ({"FENCE_ENABLE": 1, "FENCE_RADIUS": 0, "FENCE_TYPE": 7}, []),
        ({"FENCE_ENABLE": 1, "FENCE_RADIUS": 600, "FENCE_TYPE": 7}, []),
    ],
)
def test_a_fence_in_the_way_is_named_and_never_moved(
    values: dict[str, float], words: list[str]
) -> None:
    limits = told(ARDUPILOT_LIMITS, **values)
    for set_parameters in (False, True):
        phrases = limits.shortfalls(DEMAND, adjusted=set_parameters)
        assert len(phrases) == len(words)
        assert all(word in phrase for word, phrase in zip(words, phrases, strict=True))
    assert not limits.adjustments(DEMAND)


@pytest.mark.parametrize("kinds", range(8))
def test_bits_say_which_of_arducopters_fences_are_meant(kinds: int) -> None:
    """FENCE_TYPE, by its documentation: 1 the greatest height, 2 the circle, 4 areas."""
    limits = told(
        ARDUPILOT_LIMITS, FENCE_ENABLE=1, FENCE_ALT_MAX=50, FENCE_RADIUS=300, FENCE_TYPE=kinds
    )
    phrases = limits.shortfalls(DEMAND, adjusted=False)
    assert sum("50 m above home" in phrase for phrase in phrases) == (kinds & 1 > 0)
    assert sum("300 m from home" in phrase for phrase in phrases) == (kinds & 2 > 0)


def flown(table: Table, say: Callable[[str], None], end: BaseException | None) -> None:
    async def run() -> None:
        async with adjusted(table, {"MPC_XY_VEL_MAX": (12.0, 20.0)}, say=say):
            assert table.values["MPC_XY_VEL_MAX"] == 20.0
            if isinstance(end, LinkLostError):
                table.silent = True
            if end is not None:
                raise end

    asyncio.run(run())


@pytest.mark.parametrize("end", [None, FlightError("crashed"), KeyboardInterrupt()])
def test_parameters_are_set_back_however_a_flight_ends(end: BaseException | None) -> None:
    table, said = Table(MPC_XY_VEL_MAX=12.0), list[str]()
    if end is None:
        flown(table, said.append, end)
    else:
        with pytest.raises(type(end)):
            flown(table, said.append, end)
    assert table.values == {"MPC_XY_VEL_MAX": 12.0}
    assert said == []


def test_a_lost_link_names_what_stays_as_it_was_set() -> None:
    table = Table(MPC_XY_VEL_MAX=12.0)
    with pytest.raises(LinkLostError) as lost:
        flown(table, print, LinkLostError("no sign of the vehicle for 30 s"))
    assert str(lost.value) == (
        "no sign of the vehicle for 30 s; the vehicle keeps what was set for the flight: "
        "MPC_XY_VEL_MAX = 20 (was 12)"
    )


def test_a_position_is_believed_when_everything_says_so() -> None:
    readiness = Readiness("EKF_STATUS_REPORT")
    assert readiness.missing == "no word of its GPS, no word of its estimator, no home position"
    readiness._take_fix({"fix_type": 1})
    readiness._take_flags({"flags": 1024})
    readiness._take_home({"latitude": 0, "longitude": 0})
    assert readiness.missing.startswith("no 3D GPS fix, estimator without attitude and")
    readiness._take_fix({"fix_type": 3})
    readiness._take_flags({"flags": 831 - 16})  # ArduCopter's on the ground, less one
    readiness._take_home({"latitude": 436145000, "longitude": 70715000})
    assert readiness.missing == "estimator without horizontal position"
    readiness._take_flags({"flags": 831})
    assert readiness.missing == ""


def test_each_flag_of_an_estimator_has_its_words() -> None:
    readiness = Readiness("ESTIMATOR_STATUS")
    readiness._take_fix({"fix_type": 3})
    readiness._take_home({"latitude": 436145000, "longitude": 70715000})
    found = {}
    for bit in range(12):
        readiness._take_flags({"flags": 831 ^ 1 << bit})
        found[1 << bit] = readiness.missing
    assert {flag: words for flag, words in found.items() if words} == {
        mav.ESTIMATOR_ATTITUDE: "estimator without attitude",
        mav.ESTIMATOR_VELOCITY_HORIZ: "estimator without horizontal velocity",
        mav.ESTIMATOR_VELOCITY_VERT: "estimator without vertical velocity",
        mav.ESTIMATOR_POS_HORIZ_ABS: "estimator without horizontal position",
        mav.ESTIMATOR_POS_VERT_ABS: "estimator without height",
        mav.ESTIMATOR_GPS_GLITCH: "estimator not started, or misled by GPS",
    }


def test_a_vehicle_that_cannot_tell_of_its_estimator_is_believed_without() -> None:
    readiness = Readiness("EKF_STATUS_REPORT")
    readiness._take_fix({"fix_type": 3})
    readiness._take_home({"latitude": 436145000, "longitude": 70715000})
    assert readiness.missing == "no word of its estimator"
    readiness.estimator_promised = False
    assert readiness.missing == ""


def test_the_clock_goes_on_when_the_vehicle_starts_anew() -> None:
    clock = VehicleClock()
    assert [clock.t_ns(ms) for ms in (40_000, 41_000, 40_500)] == [0, 10**9, 5 * 10**8]
    # A new battery: the vehicle's own time begins again.
    assert [clock.t_ns(ms) for ms in (2_000, 3_000)] == [10**9, 2 * 10**9]
    assert clock.restarts == 1


def test_a_battery_that_no_flight_changes_is_doubted() -> None:
    watch = BatteryWatch()
    assert watch.doubt == "the vehicle does not say how full its battery is"
    for t_s in range(400):
        watch.read(t_s * 10**9, 0.5, flying=False)
    assert watch.doubt == ""
    for t_s in range(400, 519):
        watch.read(t_s * 10**9, 0.5, flying=True)
        assert watch.doubt == ""
    for t_s in range(519, 531):
        watch.read(t_s * 10**9, 0.5, flying=True)
    assert watch.doubt == "the vehicle's battery has read 50 % through 130 s of flight"
    watch.read(531 * 10**9, 0.49, flying=True)
    assert watch.doubt == ""
