"""Manoeuvres of a point mass: paths, targets, tolerances and patience, worked by hand."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_mavsdk import HOME
from sitl_point_mass import PointMass

from flightdyn.guidance.path import FlightPath
from flightdyn.state import GeodeticPoint
from sitl.autopilot.flying import manoeuvres as do
from sitl.autopilot.flying.navigator import Navigator
from sitl.autopilot.flying.orbit import Orbit
from sitl.autopilot.guard import Guard
from sitl.autopilot.parameters import Parameters

NAN, S = math.nan, 1_000_000_000
TERMS = do.LandingTerms(
    ground_down_m=-4.0, descent_mps=2.5, landing_mps=0.5, landing_height_m=6.0, settle_s=1.5
)


def mass_at(north: float = 0.0, east: float = 0.0, down: float = -20.0, yaw: float = 0.0) -> Any:
    mass = PointMass(HOME)
    mass.pos_ned_m, mass.yaw_rad, mass.t_ns = np.array([north, east, down]), yaw, 7 * S
    return mass


def lasts_s(mass: Any, manoeuvre: do.Manoeuvre, *, most_s: float = 400.0) -> float:
    """After how long, in tenths of a second, it is done."""
    begin_ns = mass.t_ns
    while not manoeuvre.tick():
        mass.t_ns += S // 10
        assert mass.t_ns - begin_ns < most_s * S
    return round((mass.t_ns - begin_ns) / S, 1)


def stuck_after_s(mass: Any, manoeuvre: do.Manoeuvre, words: str) -> float:
    begin_ns = mass.t_ns
    with pytest.raises(do.StuckError, match=words):
        lasts_s(mass, manoeuvre, most_s=1e4)
    return round((mass.t_ns - begin_ns) / S, 1)


def test_what_is_waited_for_at_most() -> None:
    mass = mass_at()
    assert lasts_s(mass, do.pause(mass, 2.5)) == 2.5
    assert lasts_s(mass, do.pause(mass, 0.0)) == 0.1  # a nanosecond at least
    mass._ready_ns = mass.t_ns + 3 * S
    assert lasts_s(mass, do.settle(mass)) == 3.0
    mass._ready_ns = mass.t_ns + 900 * S
    assert lasts_s(mass, do.settle(mass)) == 120.0
    assert lasts_s(mass, do.fall(mass)) == 120.0
    mass.pos_ned_m = np.zeros(3)
    assert lasts_s(mass, do.fall(mass)) == 0.0


@pytest.mark.parametrize(
    ("off_deg", "there"), [(1.99, True), (-1.99, True), (2.01, False), (-2.01, False)]
)
def test_a_turn_ends_within_two_degrees_or_after_half_a_minute(off_deg: float, there: bool) -> None:
    mass = mass_at(yaw=3.0)
    mass.interest_ned_m = np.zeros(3)
    turn = do.Turn(mass, pos_ned_m=np.array([1.0, 2.0, -20.0]), by_rad=1.0)
    assert mass.interest_ned_m is None
    assert mass.yaw_rad == pytest.approx(4.0 - math.tau)
    assert mass.paths[-1].points_ned_m[-1].tolist() == [1.0, 2.0, -20.0]
    mass.yaw_rad = 4.0 + math.radians(off_deg)
    assert lasts_s(mass, turn) == (0.0 if there else 30.0)


@pytest.mark.parametrize("by_rad", [2.0, -2.0])
def test_a_turn_at_a_rate_orders_a_heading_that_moves(by_rad: float) -> None:
    mass = mass_at(yaw=3.0)
    turn = do.Turn(mass, pos_ned_m=np.array([1.0, 2.0, -20.0]), by_rad=by_rad, rate_radps=0.5)
    sign = math.copysign(1.0, by_rad)
    for passed_s in (0.0, 1.0, 3.9):
        mass.t_ns = 7 * S + round(passed_s * S)
        assert not turn.tick()
        target = mass.target
        assert target.pos == (1.0, 2.0, -20.0)
        assert target.yaw == pytest.approx(math.remainder(3.0 + sign * 0.5 * passed_s, math.tau))
        assert target.yaw_rate == sign * 0.5
    mass.t_ns = 11 * S
    assert not turn.tick()
    assert mass.target is None
    assert mass.yaw_rad == pytest.approx(math.remainder(3.0 + by_rad, math.tau))
    mass.yaw_rad = 0.0
    assert lasts_s(mass, turn) == 30.0  # which counts from the end of its 4 s


def test_a_path_tells_its_points_once_and_gives_up_where_it_stalls() -> None:
    mass, told = mass_at(), list[int]()
    path = FlightPath(np.array([[0, 0, -20.0], [9, 0, -20], [9, 9, -20]]), np.ones(2), np.ones(3))
    follow = do.Follow(mass, path, told.append)
    assert not follow.patient
    assert not follow.tick()
    assert (told, follow.patient) == ([0], True)
    mass.progress.passed = 3
    assert not follow.patient
    assert not follow.tick()
    assert told == [0, 1, 2]
    mass.progress.finished = True
    assert follow.tick()
    mass.progress.stalled = True
    with pytest.raises(do.StuckError, match="does not follow its path"):
        follow.tick()


def test_a_take_off_ends_at_its_height_or_is_stuck() -> None:
    mass = mass_at()
    path = FlightPath(np.array([[0, 0, -20.0], [0, 0, -30]]), np.ones(1), np.ones(2))
    climb = do.Climb(mass, path)
    mass.progress.missed_m = 2.1
    assert not climb.tick()
    mass.progress.finished, mass.progress.missed_m = True, 2.0
    assert climb.tick()
    mass.progress.missed_m = 7.6
    with pytest.raises(do.StuckError, match="take-off ended 8 m from its height"):
        climb.tick()


def test_a_stop_is_held_where_braking_ends() -> None:
    mass = mass_at(10.0, 20.0, yaw=0.5)
    mass.vel_ned_mps = np.array([3.0, -4.0, 0.0])
    brake = do.Brake(mass, deceleration_mps2=2.0)
    # 5 m/s take 25 / 4 m.
    assert mass.paths[-1].points_ned_m[-1].tolist() == pytest.approx([13.75, 15.0, -20.0])
    assert mass.yaw_rad == pytest.approx(0.5)
    assert not brake.tick()
    mass.progress.finished = True
    assert brake.tick()
    mass.progress.stalled = True
    with pytest.raises(do.StuckError, match="does not stop"):
        brake.tick()


@pytest.mark.parametrize(
    ("from_down_m", "downs_m"),
    [(-30.0, (-30.0, -10.0, -1.0)), (-7.0, (-7.0, -7.0, -1.0)), (2.0, (2.0, 2.0, 5.0))],
)
def test_a_landing_sinks_fast_then_slowly_to_below_the_ground(
    from_down_m: float, downs_m: tuple[float, float, float]
) -> None:
    """The ground 4 m up, slowly from 6 m above it, to 3 m below."""
    mass = mass_at(1.0, 2.0, from_down_m, yaw=0.25)
    landing = do.Descend(mass, TERMS, start_ned_m=mass.pos_ned_m)
    (path,) = mass.paths
    assert path.points_ned_m.tolist() == [[1.0, 2.0, down] for down in downs_m]
    assert path.speeds_mps.tolist() == [2.5, 0.5]
    assert path.acceptance_m.tolist() == [1.0, 1.0, 1.0]
    mass.pos_ned_m = np.array([1.0, 2.0, -3.0])
    assert landing.landing
    assert not landing.tick()
    assert mass.target is None
    mass.progress.finished = True  # the ground is lower: it sinks on
    assert not landing.tick()
    blind: Any = mass.target
    assert (blind.vel, blind.drifting) == ((0.0, 0.0, 0.5), False)
    assert blind.yaw == pytest.approx(0.25)
    mass.pos_ned_m = np.array([1.0, 2.0, 0.0])
    assert lasts_s(mass, landing) == 1.5


def test_a_landing_without_end_is_stuck() -> None:
    """After two minutes and four times what 26 m take at 0.5 m/s; below the ground, two."""
    for down_m, patience_s in ((-30.0, 120.0 + 4.0 * 26.0 / 0.5), (-4.0, 120.0), (-0.5, 120.0)):
        mass = mass_at(down=down_m)
        landing = do.Descend(mass, TERMS, start_ned_m=mass.pos_ned_m)
        mass.pos_ned_m = np.array([0.0, 0.0, -1.0])
        assert stuck_after_s(mass, landing, "does not come to the ground") == patience_s


def test_a_landing_that_does_not_know_where_it_is_keeps_no_place() -> None:
    mass = mass_at(down=-10.01, yaw=0.25)
    landing = do.DescendUnsure(mass, TERMS)
    fast = mass.target
    assert fast.vel == (0.0, 0.0, 2.5)
    assert fast.yaw == pytest.approx(0.25)
    assert fast.drifting
    assert not landing.tick()
    assert mass.target is fast
    mass.pos_ned_m = np.array([0.0, 0.0, -9.99])
    assert not landing.tick()
    slow = mass.target
    assert (slow.vel, slow.drifting) == ((0.0, 0.0, 0.5), True)
    mass.pos_ned_m = np.array([0.0, 0.0, -10.5])
    assert not landing.tick()
    assert mass.target is slow


def test_a_pilot_is_asked_in_time_and_has_landed_after_a_flight() -> None:
    mass, asked = mass_at(down=0.0), list[int]()
    piloted = do.Piloted(mass, lambda: asked.append(mass.t_ns - 7 * S), every_s=0.3, settle_s=1.5)
    for _ in range(30):
        assert not piloted.tick()  # on the ground, before a flight, for 3 s
        mass.t_ns += S // 10
    assert asked == [0, *(n * 3 * S // 10 for n in range(1, 10))]
    mass.pos_ned_m = np.array([0.0, 0.0, -1.0])
    assert not piloted.tick()
    mass.pos_ned_m = np.zeros(3)
    assert lasts_s(mass, piloted) == 1.5
    alone, asked[:] = do.Piloted(mass, settle_s=1.0), []
    assert not alone.tick()
    assert not asked


@pytest.mark.parametrize(
    ("keys", "turning", "heading"),
    [
        ({"yaw": mav.ORBIT_YAW_BEHAVIOUR_HOLD_FRONT_TO_CIRCLE_CENTER}, 1.0, math.pi),
        ({"yaw": mav.ORBIT_YAW_BEHAVIOUR_HOLD_INITIAL_HEADING}, 0.0, 0.75),
        ({"yaw": mav.ORBIT_YAW_BEHAVIOUR_UNCONTROLLED}, 0.0, NAN),
        ({"yaw": 0, "heading_rad": 0.25}, 0.0, 0.25),
    ],
)
@pytest.mark.parametrize("speed_mps", [4.0, -4.0])
def test_a_circle_is_flown_by_place_velocity_and_acceleration(
    keys: dict[str, Any], turning: float, heading: float, speed_mps: float
) -> None:
    mass = mass_at(yaw=0.75)
    orbit = Orbit((10.0, -20.0, -30.0), 8.0, speed_mps, turns=0.5, **keys)
    circle = do.Circle(mass, orbit, phase_rad=0.5)
    mass.yaw_rad = 0.0
    mass.t_ns += 2 * S
    assert not circle.tick()
    phase = 0.5 + speed_mps / 8.0 * 2.0
    c, s = math.cos(phase), math.sin(phase)
    target = mass.target
    assert target.pos == pytest.approx((10.0 + 8.0 * c, -20.0 + 8.0 * s, -30.0))
    assert target.vel == pytest.approx((-speed_mps * s, speed_mps * c, 0.0))
    assert target.acc == pytest.approx((-2.0 * c, -2.0 * s, 0.0))
    assert target.yaw == pytest.approx(turning * phase + heading, nan_ok=True)
    mass.t_ns += 4_280_000_000  # just short of half a turn, 6.283 s
    assert not circle.tick()
    mass.yaw_rad = 0.3
    mass.t_ns += 10_000_000
    assert circle.tick()
    phase = 0.5 + speed_mps / 8.0 * 6.29
    at_rest = mass.paths[-1].points_ned_m[-1].tolist()
    assert at_rest == pytest.approx(orbit.point(phase).tolist())
    assert mass.yaw_rad == pytest.approx(0.3)


def test_a_circle_is_flown_with_the_nose_ahead_or_at_a_place() -> None:
    for speed_mps in (4.0, -4.0):
        mass = mass_at(1.0, 2.0)
        tangent = mav.ORBIT_YAW_BEHAVIOUR_HOLD_FRONT_TANGENT_TO_CIRCLE
        circle = do.Circle(mass, Orbit((0.0, 0.0, -30.0), 8.0, speed_mps, tangent), phase_rad=0.5)
        assert not circle.tick()
        assert mass.target.yaw == pytest.approx(0.5 + math.copysign(math.pi / 2, speed_mps))
        mass.interest_ned_m = np.array([4.0, -2.0, 0.0])
        assert not circle.tick()
        assert mass.target.yaw == pytest.approx(math.atan2(-4.0, 3.0))


# --- what the navigator makes of parameters -------------------------------------------------------


class Ground:
    """A navigator 30 m over the origin; home is 5 m over that."""

    def __init__(self, down: float = -30.0, **parameters: float) -> None:
        self.mass = mass_at(down=down)
        values = Parameters()
        for name, value in {"NAV_ACC_RAD": 6.0, "MPC_XY_CRUISE": 8.0, **parameters}.items():
            assert values.set(name, value)
        guard = Guard(self.mass, values)
        guard.home = GeodeticPoint(HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m + 5.0)
        self.navigator = Navigator(self.mass, values, guard)

    def flown(self) -> tuple[list[list[float]], list[float]]:
        path = self.mass.paths[-1]
        assert set(path.acceptance_m) in ({6.0}, {1.0})
        return np.round(path.points_ned_m, 6).tolist(), path.speeds_mps.tolist()


def test_a_climb_goes_up_then_across() -> None:
    ground = Ground(MPC_TKO_SPEED=2.0)
    start, goal = np.array([0.0, 0.0, -5.0]), np.array([3.0, 4.0, -30.0])
    ground.mass.interest_ned_m = goal
    climb = ground.navigator.climb(start, goal, speed_mps=None, yaw_rad=NAN)
    assert ground.flown() == ([[0.0, 0.0, -5.0], [0.0, 0.0, -30.0]], [2.0])
    assert ground.mass.interest_ned_m is goal
    ground.mass.progress.finished = True
    assert not climb.tick()
    assert ground.flown() == ([[0.0, 0.0, -30.0], [3.0, 4.0, -30.0]], [8.0])
    ground.mass.progress.finished = True
    assert climb.tick()
    up = np.array([0.0, 0.0, -30.0])
    climb = ground.navigator.climb(start, up, speed_mps=3.0, yaw_rad=0.5)
    assert (ground.mass.interest_ned_m, ground.mass.yaw_rad) == (None, 0.5)
    ground.mass.progress.finished = True
    assert climb.tick()


@pytest.mark.parametrize(
    ("start", "goal", "down"),
    [
        ((60.0, 80.0, -20.0), (0.0, 0.0, -5.0), -35.0),  # 30 m over home
        ((60.0, 80.0, -50.0), (0.0, 0.0, -5.0), -50.0),
        ((60.0, 80.0, -20.0), (0.0, 0.0, -60.0), -60.0),
        ((6.0, 7.9, -20.0), (0.0, 0.0, -5.0), -20.0),  # nearer than 10 m
        ((6.0, 8.1, -20.0), (0.0, 0.0, -5.0), -35.0),
    ],
)
def test_a_return_climbs_first_if_it_is_far(
    start: tuple[float, ...], goal: tuple[float, ...], down: float
) -> None:
    ground = Ground()
    ground.navigator.return_to(np.array(start), np.array(goal), speed_mps=7.0)
    points, speeds = ground.flown()
    assert points == [[*start], [*start[:2], down], [*goal[:2], down]]
    assert speeds[1] == 7.0
    assert speeds[0] == (4.0 if down < start[2] else 7.0)


@pytest.mark.parametrize(("sure", "slow_m", "slow_mps"), [(True, 6.0, 0.5), (False, 18.0, 0.35)])
def test_a_landing_slows_down_above_home(sure: bool, slow_m: float, slow_mps: float) -> None:
    parameters = {"MPC_Z_VEL_MAX_DN": 2.5, "MPC_LAND_SPEED": 0.5, "MPC_LAND_ALT2": 6.0}
    ground = Ground(**parameters, COM_DISARM_LAND=1.5)
    mass = ground.mass
    landing = ground.navigator.land(np.array([0.0, 0.0, -30.0]), sure=sure, heading_rad=0.5)
    if sure:
        points = [[0.0, 0.0, down] for down in (-30.0, -5.0 - slow_m, -2.0)]
        assert ground.flown() == (points, [2.5, slow_mps])
        assert mass.yaw_rad == 0.5
    else:
        assert mass.target.vel == (0.0, 0.0, 2.5)
        for down, speed_mps in ((-5.0 - slow_m - 0.01, 2.5), (-5.0 - slow_m + 0.01, slow_mps)):
            mass.pos_ned_m = np.array([0.0, 0.0, down])
            assert not landing.tick()
            assert mass.target.vel == pytest.approx((0.0, 0.0, speed_mps))
    mass.pos_ned_m = np.zeros(3)
    assert lasts_s(mass, landing) == 1.5


def test_a_landing_elsewhere_flies_over_it_first() -> None:
    ground = Ground()
    start, goal = np.array([0.0, 0.0, -30.0]), np.array([3.0, 4.0, -12.0])
    ground.navigator.land_at(start, goal, speed_mps=None, yaw_rad=0.5)
    assert ground.flown() == ([[0.0, 0.0, -30.0], [3.0, 4.0, -30.0]], [8.0])
    assert ground.mass.yaw_rad == 0.5
    ground.navigator.land_at(start, np.array([0.0, 0.0, 0.0]), speed_mps=None, yaw_rad=NAN)
    assert len(ground.flown()[1]) == 2  # at once, as it is there
    ground.navigator.land_at(start, np.array([0.0, 0.0, -40.0]), speed_mps=3.0, yaw_rad=NAN)
    assert ground.flown() == ([[0.0, 0.0, -30.0], [0.0, 0.0, -40.0]], [3.0])


@pytest.mark.parametrize(
    ("held", "resting", "expected_north"),
    [
        ((1.9, 0.0, -30.0), True, 1.9), ((2.1, 0.0, -30.0), True, 0.0),
        ((1.9, 0.0, -30.0), False, 0.0), (None, True, 0.0),
    ],
)  # fmt: skip
def test_paths_begin_at_the_point_held_or_where_it_is(
    held: tuple[float, ...] | None, resting: bool, expected_north: float
) -> None:
    ground = Ground()
    ground.mass.cmd_pos_ned_m = None if held is None else np.array(held)
    assert ground.navigator.here(resting=resting)[0] == expected_north
    ground = Ground(down=0.0)
    ground.mass.cmd_pos_ned_m = np.array([1.0, 0.0, 0.0])
    assert ground.navigator.here(resting=True)[0] == 0.0  # on the ground nothing is held


def test_a_stop_and_a_way_end_with_a_heading() -> None:
    ground = Ground(MPC_ACC_HOR=2.0)
    mass = ground.mass
    mass.vel_ned_mps = np.array([4.0, 0.0, 0.0])
    stop = ground.navigator.stop(1.0)
    assert ground.flown()[0][-1] == [4.0, 0.0, -30.0]
    assert mass.yaw_rad == 0.0
    for way in (
        stop,
        ground.navigator.go_to(mass.pos_ned_m, np.zeros(3), speed_mps=2.0, yaw_rad=1.0),
    ):
        mass.progress.finished = True
        assert not way.tick()
        assert mass.yaw_rad == pytest.approx(1.0)
        assert way.tick()
        mass.yaw_rad = 0.0
