"""Every field of every order that is accepted: carried out, neutral, or refused.

Held against MAVLink's own definitions, as pymavlink has them. That a field is carried out is shown
by two values of it that lead to two outcomes.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item
from sitl_mavsdk import HOME

from flightdyn.frames import LocalFrame
from sitl.autopilot.codec.orders import bare_name
from sitl.autopilot.protocol.order_rules import (
    ABSENT,
    COMMAND_RULES,
    ITEM_RULES,
    UNUSED,
    Rule,
)

NAN = math.nan
OK, DENIED = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_DENIED
FENCE, RALLY = mav.MAV_MISSION_TYPE_FENCE, mav.MAV_MISSION_TYPE_RALLY
AEROPLANE = "for aeroplanes; PX4's multicopters pass over it, too"
ONE_SPEED = "air and ground speed are one to a multirotor that measures neither"
NAMES_NONE = "for messages that name a receiver, which none of this vehicle's does"
OTHER_PART = "for something else than this autopilot: only what leaves that alone is taken"
# Fields with more values than one and no effect, by command and number of the parameter: why.
SAME = {
    ("NAV_TAKEOFF", 1): AEROPLANE,
    ("NAV_LAND", 1): AEROPLANE,
    ("NAV_LOITER_UNLIM", 3): AEROPLANE,
    ("NAV_LOITER_TIME", 3): AEROPLANE,
    ("NAV_LOITER_TO_ALT", 1): AEROPLANE,
    ("NAV_LOITER_TO_ALT", 2): AEROPLANE,
    ("NAV_LOITER_TO_ALT", 4): AEROPLANE,
    ("DO_REPOSITION", 3): AEROPLANE,
    ("DO_CHANGE_SPEED", 1): ONE_SPEED,
    ("DO_CHANGE_SPEED", 3): "throttle: only what leaves it alone is taken",
    ("DO_SET_ROI", 1): "each of its values is a row of its own",
    ("REQUEST_MESSAGE", 7): NAMES_NONE,
    ("SET_MESSAGE_INTERVAL", 7): NAMES_NONE,
    ("PREFLIGHT_STORAGE", 2): OTHER_PART,
    ("PREFLIGHT_REBOOT_SHUTDOWN", 1): "anything but a reboot is refused",
    ("PREFLIGHT_REBOOT_SHUTDOWN", 7): OTHER_PART,
    ("NAV_DELAY", 2): "a time of day is refused by parameter 1",
    ("NAV_DELAY", 3): "a time of day is refused by parameter 1",
    ("NAV_DELAY", 4): "a time of day is refused by parameter 1",
}


def place(north: float, east: float, height_m: float = 30.0) -> tuple[float, float, float]:
    """Latitude, longitude (deg) and altitude above mean sea level (m) of a place about home."""
    at = LocalFrame(HOME).to_geodetic(np.array([north, east, 0.0]))
    return at.lat_deg, at.lon_deg, HOME.alt_msl_m + height_m


THERE = place(60.0, 40.0)


def on_the_ground(_desk: Desk) -> None:
    pass


def armed(desk: Desk) -> None:
    assert desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == OK


def in_the_air(desk: Desk) -> None:
    desk.take_off(30.0)
    assert desk.command(mav.MAV_CMD_CONDITION_YAW, 40) == OK
    desk.fly()


def looking(desk: Desk) -> None:
    in_the_air(desk)
    assert desk.command(mav.MAV_CMD_DO_SET_ROI_LOCATION, 0, 0, 0, 0, *place(0.0, 90.0)) == OK


LOOP = [
    item(0, mav.MAV_CMD_NAV_WAYPOINT, north=50.0),
    item(1, mav.MAV_CMD_NAV_WAYPOINT, north=50.0, east=50.0),
    item(2, mav.MAV_CMD_DO_JUMP, params=(0.0, 1.0, 0.0, 0.0)),
    item(3, mav.MAV_CMD_NAV_WAYPOINT, east=50.0),
]


def with_a_mission(desk: Desk) -> None:
    in_the_air(desk)
    assert desk.upload(LOOP) == mav.MAV_MISSION_ACCEPTED


def on_a_mission(desk: Desk) -> None:
    with_a_mission(desk)
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK


def after_a_jump(desk: Desk) -> None:
    on_a_mission(desk)
    while desk.vehicle.autopilot.flight.mission._jumps_left[2]:
        desk.fly(seconds=1.0)
    desk.fly(seconds=8.0)
    assert desk.command(mav.MAV_CMD_DO_PAUSE_CONTINUE, 0) == OK


def with_storage(desk: Desk) -> None:
    desk.vehicle.autopilot.parameters.set("MPC_XY_CRUISE", 7.0)


Setup = Callable[[Desk], None]
# Command, what was before it, parameters that are accepted, and other values by their number.
CASES: Sequence[tuple[str, Setup, tuple[float, ...], dict[int, float]]] = (
    ("COMPONENT_ARM_DISARM", on_the_ground, (1, 0), {1: 0}),
    ("COMPONENT_ARM_DISARM", in_the_air, (0, 0), {2: 21196}),
    ("NAV_TAKEOFF", armed, (0, 0, 0, NAN, *THERE), {4: 90, 5: NAN, 6: NAN, 7: THERE[2] + 10}),
    ("NAV_LAND", in_the_air, (0, 0, 0, NAN, *THERE), {4: 90, 5: NAN, 6: NAN, 7: THERE[2] + 10}),
    ("NAV_LOITER_UNLIM", in_the_air, (0, 0, 0, NAN, *THERE), {4: 90, 5: NAN, 6: NAN}),
    ("NAV_LOITER_UNLIM", in_the_air, (0, 0, 0, NAN, *THERE), {7: THERE[2] + 10}),
    ("DO_REPOSITION", in_the_air, (-1, 1, 0, 1, *THERE), {1: 3, 2: 3, 4: 2, 5: NAN, 6: NAN}),
    ("DO_REPOSITION", in_the_air, (-1, 1, 0, 1, *THERE), {7: THERE[2] + 10}),
    ("DO_CHANGE_ALTITUDE", in_the_air, (510, 0), {1: 540, 2: 3}),
    ("DO_SET_ROI_LOCATION", in_the_air, (0, 0, 0, 0, *THERE), {5: HOME.lat_deg, 6: HOME.lon_deg}),
    ("DO_SET_ROI_LOCATION", in_the_air, (0, 0, 0, 0, *THERE), {7: THERE[2] + 10}),
    ("DO_SET_ROI", looking, (3, 0, 0, 0, *THERE), {5: HOME.lat_deg, 6: HOME.lon_deg, 7: 600}),
    ("DO_SET_ROI", looking, (0, 0, 0, 0, 0, 0, 0), {1: 3}),
    ("DO_CHANGE_SPEED", on_a_mission, (1, 4, -1), {2: 3}),
    ("CONDITION_YAW", in_the_air, (350, 20, 1, 0), {1: 90, 2: 40, 3: -1, 4: 1}),
    ("DO_SET_MODE", with_a_mission, (1, 4, 4), {1: 0, 2: 99, 3: 6}),
    ("MISSION_START", with_a_mission, (0, 0), {1: 3, 2: 1}),
    ("DO_PAUSE_CONTINUE", with_a_mission, (0,), {1: 1}),
    ("DO_SET_MISSION_CURRENT", after_a_jump, (0, 0), {1: 3, 2: 1}),
    ("DO_SET_HOME", in_the_air, (0, 0, 0, 0, *THERE), {5: HOME.lat_deg, 6: HOME.lon_deg, 7: 500}),
    ("DO_SET_HOME", in_the_air, (1, 0, 0, 0, 0, 0, 0), {1: 0}),
    ("DO_FLIGHTTERMINATION", in_the_air, (1,), {1: 0}),
    ("DO_ORBIT", in_the_air, (20, 3, 0, 0, *THERE), {1: 25, 2: 2, 3: 1, 4: 1, 5: NAN, 6: NAN}),
    ("DO_ORBIT", in_the_air, (20, 3, 0, 0, *THERE), {7: THERE[2] + 10}),
    ("DO_FENCE_ENABLE", on_the_ground, (1,), {1: 0}),
    ("PREFLIGHT_STORAGE", with_storage, (2,), {1: 0}),
    ("INJECT_FAILURE", in_the_air, (101, 1, 1), {1: 4, 2: 0, 3: 2}),
    ("REQUEST_AUTOPILOT_CAPABILITIES", on_the_ground, (1,), {1: 0}),
    ("REQUEST_MESSAGE", on_the_ground, (148,), {1: 242}),
    ("REQUEST_MESSAGE", on_the_ground, (244, 30), {2: 31}),
    ("SET_MESSAGE_INTERVAL", on_the_ground, (30, 20_000), {1: 31, 2: 40_000}),
    ("GET_MESSAGE_INTERVAL", on_the_ground, (30,), {1: 31}),
)
# Items of missions likewise; 5, 6 and 7 are the place.
ITEMS: Sequence[tuple[str, tuple[float, ...], dict[int, float]]] = (
    ("NAV_WAYPOINT", (5, 2, 0, 90), {1: 10, 2: 40, 4: 180, 5: 90, 6: 90, 7: 50}),
    ("NAV_LOITER_UNLIM", (0, 0, 0, 90), {4: 180, 5: 90, 6: 90, 7: 50}),
    ("NAV_LOITER_TIME", (5, 0, 0, 90), {1: 10, 4: 180, 5: 90, 6: 90, 7: 50}),
    ("NAV_LOITER_TO_ALT", (0, 0, 0, 0), {5: 90, 6: 90, 7: 50}),
    ("NAV_LOITER_TURNS", (1, 0, 20, NAN), {1: 2, 3: -20, 4: 90, 5: 90, 6: 90, 7: 50}),
    ("NAV_TAKEOFF", (0, 0, 0, 90), {4: 180, 5: 90, 6: 90, 7: 50}),
    ("NAV_LAND", (0, 0, 0, 90), {4: 180, 5: 90, 6: 90, 7: 50}),
    ("NAV_DELAY", (5, -1, -1, -1), {1: 10}),
    ("CONDITION_DELAY", (5, 0, 0, 0), {1: 10}),
    ("CONDITION_YAW", (350, 20, 1, 0), {1: 90, 2: 40, 3: -1, 4: 1}),
    ("DO_CHANGE_SPEED", (1, 4, -1, 0), {2: 3}),
    ("DO_JUMP", (1, 1, 0, 0), {1: 0, 2: 2}),
    ("DO_SET_ROI_LOCATION", (0, 0, 0, 0), {5: 90, 6: 90, 7: 50}),
    ("DO_SET_ROI", (3, 0, 0, 0), {5: 90, 6: 90, 7: 50}),
)


def outcome(desk: Desk, *, result: int, since: int) -> object:
    """What an observer can tell the difference by, a minute after an order."""
    vehicle, mass = desk.vehicle.autopilot, desk.mass
    track = []
    for _ in range(60):
        desk.fly(seconds=1.0)
        track.append((*mass.pos_ned_m.round(2), round(mass.yaw_rad, 3), vehicle.mode.name))
    kinds = [m.get_type() for m in desk.heard[since:] if m.get_type() != "COMMAND_ACK"]
    told = [m for m in desk.heard[since:] if m.get_type() == "MESSAGE_INTERVAL"]
    intervals = [(m.message_id, m.interval_us) for m in told]
    desk.pass_wall_time(1.0, step=0.01)
    streamed = [m.get_type() for m in desk.heard[since:]]
    rates = [(kind, streamed.count(kind)) for kind in ("ATTITUDE", "ATTITUDE_QUATERNION")]
    interest = None if mass.interest_ned_m is None else tuple(mass.interest_ned_m.round(2))
    home = vehicle._guard.home
    seen = (result, track, kinds, intervals, rates, interest, home, mass.armed, mass.faults.active)
    kept = vehicle._guard.fence_enabled, vehicle.parameters.as_dict()
    return repr((*seen, *kept, [tuple(path.acceptance_m) for path in mass.paths]))


def of_command(name: str, setup: Setup, params: Sequence[float]) -> object:
    desk = Desk()
    setup(desk)
    since = len(desk.heard)
    result = desk.command(getattr(mav, f"MAV_CMD_{name}"), *params)
    if setup is after_a_jump:
        assert desk.command(mav.MAV_CMD_DO_PAUSE_CONTINUE, 1) == OK
    return outcome(desk, result=result, since=since)


def of_item(name: str, seven: Sequence[float]) -> object:
    desk = Desk()
    in_the_air(desk)
    one, two, three, four, north, east, height = seven
    number, params = getattr(mav, f"MAV_CMD_{name}"), (one, two, three, four)
    mission = [
        item(0, mav.MAV_CMD_NAV_WAYPOINT, north=20.0),
        item(1, mav.MAV_CMD_NAV_WAYPOINT, north=20.0, east=20.0),
        item(2, number, params=params, north=north, east=east, height=height),
        item(3, mav.MAV_CMD_NAV_WAYPOINT, north=60.0, east=90.0),
    ]
    result = desk.upload(mission)
    assert result == mav.MAV_MISSION_ACCEPTED
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    return outcome(desk, result=result, since=0)


@pytest.mark.parametrize(
    ("name", "setup", "params", "index", "other"),
    [(name, setup, params, i, v) for name, setup, params, o in CASES for i, v in o.items()],
)
def test_a_field_of_a_command_is_carried_out(
    name: str, setup: Setup, params: tuple[float, ...], index: int, other: float
) -> None:
    changed = [*params]
    changed[index - 1] = other
    assert of_command(name, setup, params) != of_command(name, setup, changed)


@pytest.mark.parametrize(
    ("name", "params", "index", "other"),
    [(name, params, i, v) for name, params, others in ITEMS for i, v in others.items()],
)
def test_a_field_of_an_item_is_carried_out(
    name: str, params: tuple[float, ...], index: int, other: float
) -> None:
    seven = [*params, 60.0, 40.0, 30.0]
    before = of_item(name, seven)
    seven[index - 1] = other
    assert before != of_item(name, seven)


def rules() -> list[Any]:
    """Every rule with its command, and the numbers of the parameters shown above."""
    shown: dict[tuple[str, int], set[int]] = {}
    for name, _, _, others in CASES:
        shown.setdefault((name, -1), set()).update(others)
    for name, _, others in ITEMS:
        shown.setdefault((name, mav.MAV_MISSION_TYPE_MISSION), set()).update(others)
    tables = {-1: COMMAND_RULES, **ITEM_RULES}
    return [
        pytest.param(kind, key, rule, shown.get((bare_name(number_of(key)), kind), set()),
                     id=f"{kind}-{bare_name(number_of(key))}")
        for kind, table in tables.items()
        for key, rule in table.items()
        if number_of(key) not in ABSENT
    ]  # fmt: skip


def number_of(key: int | tuple[int, float]) -> int:
    return key[0] if isinstance(key, tuple) else key


FENCES = {"fence": {1, 2, 5, 6}, "rally": {5, 6, 7}}  # shown in the tests of fence and rally points


@pytest.mark.parametrize(("kind", "key", "rule", "shown"), rules())
def test_every_field_is_used_neutral_or_refused(
    kind: int, key: int | tuple[int, float], rule: Rule, shown: set[int]
) -> None:
    number = number_of(key)
    name, definition = bare_name(number), mav.enums["MAV_CMD"][number]
    shown = shown | {FENCE: FENCES["fence"], RALLY: FENCES["rally"]}.get(kind, set())
    for index in range(1, 8):
        words = definition.param.get(index, "Empty").lower()
        allowed = rule.params[index - 1]
        if words.startswith(("empty", "reserved")) and "inclusion" not in words:
            assert allowed == UNUSED, (name, index, words)
        if allowed == UNUSED:
            refused = [
                v for v in (1.0, -1.0, 0.5, 300.0, 1e30, math.inf) if v_wrong(rule, index, v)
            ]
            assert len(refused) == 6, (name, index)
            assert not v_wrong(rule, index, 0.0)
            assert not v_wrong(rule, index, NAN)
        elif not isinstance(key, tuple):
            assert index in shown or (name, index) in SAME, (name, index, words)
    if not isinstance(key, tuple):
        assert rule.placed == definition.has_location, name


def v_wrong(rule: Rule, index: int, value: float) -> bool:
    frame = mav.MAV_FRAME_GLOBAL if rule.placed else None
    return not any(value in part for part in rule.allowed(index - 1, frame))


def test_every_command_that_is_known_has_a_rule() -> None:
    known = Desk(ready=False).vehicle.autopilot.commands.known
    assert known == {number_of(key) for key in COMMAND_RULES}


@pytest.mark.parametrize("name", sorted({name for name, *_ in CASES}))
@pytest.mark.parametrize("frame", [1, 7, 8, 9, 12, 21, 255])
def test_a_frame_that_is_not_known_is_refused(name: str, frame: int) -> None:
    desk = Desk()
    _, setup, params, _ = next(case for case in CASES if case[0] == name)
    setup(desk)
    seven = [*params, *[0.0] * (7 - len(params))]
    number = getattr(mav, f"MAV_CMD_{name}")
    x, y = (0 if math.isnan(v) else int(v) for v in seven[4:6])
    result = desk.command_int(number, frame, tuple(seven[:4]), x, y, seven[6])
    assert result == DENIED
    assert f"frame {frame}, 0, 3, 5 and 6 are supported" in "".join(desk.texts())


def test_a_refused_command_or_item_names_the_parameter_and_what_is_allowed() -> None:
    desk = Desk()
    armed(desk)
    assert desk.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 5, 0, NAN, NAN, NAN, NAN) == DENIED
    assert "NAV_TAKEOFF refused: parameter 2 = 5, 0, NaN are allowed" in "".join(desk.texts())
    by = item(0, mav.MAV_CMD_NAV_WAYPOINT, north=50.0, params=(0.0, 0.0, 5.0, NAN))
    assert desk.upload([by]) == mav.MAV_MISSION_INVALID_PARAM3
    assert "item 0 NAV_WAYPOINT (16): parameter 3 = 5, 0, NaN are" in "".join(desk.texts())


# --- what PX4 or the definitions say, to the number ---------------------------------------------


def turned(desk: Desk) -> float:
    """The heading of the vehicle (deg, 0 to 360)."""
    return math.degrees(desk.mass.yaw_rad) % 360


@pytest.mark.parametrize(
    ("params", "seconds", "heading", "passes"),
    [
        ((0, 10, 1, 0), 27.5, 0.0, 180.0),  # 90 to 0 clockwise: 270 degrees at 10 deg/s
        ((0, 10, -1, 0), 9.5, 0.0, 45.0),
        ((0, 10, 0, 0), 9.5, 0.0, 45.0),  # the shorter way
        ((350, 50, 1, 1), 7.5, 80.0, 270.0),  # relative, nearly all the way round
        ((30, 10, -1, 1), 3.5, 60.0, 75.0),
    ],
)
def test_a_turn_has_its_direction_and_rate(
    params: tuple[float, ...], seconds: float, heading: float, passes: float
) -> None:
    desk = Desk()
    in_the_air(desk)
    assert desk.command(mav.MAV_CMD_CONDITION_YAW, 90) == OK
    desk.fly()
    at = desk.vehicle.t_ns
    assert desk.command(mav.MAV_CMD_CONDITION_YAW, *params) == OK
    passed = False
    while desk.vehicle.moving:
        desk.fly(seconds=0.1)
        passed = passed or abs((turned(desk) - passes + 180) % 360 - 180) < 6.0
    assert passed
    assert (desk.vehicle.t_ns - at) * 1e-9 == pytest.approx(seconds, abs=0.6)
    assert math.cos(math.radians(turned(desk) - heading)) > math.cos(math.radians(2.1))


def test_an_arc_of_an_orbit_ends_and_what_is_open_stays_as_it_was() -> None:
    desk = Desk()
    in_the_air(desk)
    orbit = mav.MAV_CMD_DO_ORBIT
    assert desk.command(orbit, -20, 4, 3, 0, *place(30.0, 0.0)) == OK
    desk.fly(seconds=20.0)
    orbits = desk.vehicle.autopilot._orbits
    first = orbits.current
    assert first is not None
    assert math.isinf(first.turns)
    assert desk.command(orbit, NAN, NAN, NAN, math.pi, NAN, NAN, NAN) == OK
    second = orbits.current
    assert second is not None
    assert (second.radius_m, second.speed_mps, second.yaw) == (20.0, -4.0, 3)
    assert second.center_ned_m[:2] == first.center_ned_m[:2]
    assert second.turns == pytest.approx(0.5)
    at = desk.vehicle.t_ns
    desk.fly()  # comes to its end: pi rad of 20 m at 4 m/s are 15.7 s
    assert (desk.vehicle.t_ns - at) * 1e-9 == pytest.approx(math.pi * 20 / 4, abs=1.5)
    assert desk.vehicle.autopilot.mode.name == "HOLD"


def test_the_heading_of_an_item_is_held_on_the_way_and_at_the_place() -> None:
    desk = Desk()
    in_the_air(desk)
    hold = (5.0, 0.0, 0.0, 200.0)
    mission = [
        item(0, mav.MAV_CMD_NAV_WAYPOINT, north=50.0, params=(0.0, 0.0, 0.0, 90.0)),
        item(1, mav.MAV_CMD_NAV_WAYPOINT, north=100.0, params=hold),
    ]
    assert desk.upload(mission) == mav.MAV_MISSION_ACCEPTED
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    desk.fly(seconds=3.0)
    assert turned(desk) == pytest.approx(90.0)
    desk.fly(seconds=5.0)
    assert turned(desk) == pytest.approx(200.0)
    desk.fly(seconds=4.0)
    assert turned(desk) == pytest.approx(200.0)
    assert desk.mass.pos_ned_m[0] == pytest.approx(100.0, abs=0.1)


def test_a_mission_ends_after_its_last_item_and_is_whole_the_next_time() -> None:
    desk = Desk()
    with_a_mission(desk)
    assert desk.command(mav.MAV_CMD_MISSION_START, 0, 9) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert "mission has 4 items" in "".join(desk.texts())
    assert desk.command(mav.MAV_CMD_MISSION_START, 0, 0) == OK
    assert desk.command(mav.MAV_CMD_MISSION_START, 0, 1) == OK
    desk.fly()
    assert desk.vehicle.autopilot.mode.name == "HOLD"
    assert desk.mass.pos_ned_m[:2] == pytest.approx([50.0, 50.0], abs=0.1)
    assert desk.command(mav.MAV_CMD_MISSION_START, NAN, NAN) == OK
    desk.fly()
    assert desk.mass.pos_ned_m[:2] == pytest.approx([0.0, 50.0], abs=0.1)


@pytest.mark.parametrize("params", [(0, 0), (NAN, NAN)])
def test_without_autocontinue_it_waits_for_an_order(params: tuple[float, float]) -> None:
    desk = Desk()
    in_the_air(desk)
    mission = [item(seq, mav.MAV_CMD_NAV_WAYPOINT, north=50.0 * (seq + 1)) for seq in range(3)]
    mission[0].autocontinue = mission[2].autocontinue = 0
    assert desk.upload(mission) == mav.MAV_MISSION_ACCEPTED
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    for north, seq in ((50.0, 0), (150.0, 2)):
        desk.fly()
        assert desk.mass.pos_ned_m[0] == pytest.approx(north, abs=0.1)
        assert desk.vehicle.autopilot.mode.name == "MISSION"
        assert desk.vehicle.autopilot.flight.mission.current == seq
        assert desk.command(mav.MAV_CMD_MISSION_START, *params) == OK
    assert desk.vehicle.autopilot.flight.mission.complete
    assert desk.vehicle.autopilot.mode.name == "HOLD"
    assert not desk.vehicle.autopilot.flight.mission.waiting
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    desk.fly()
    assert desk.command(mav.MAV_CMD_DO_SET_MISSION_CURRENT, 2) == OK
    desk.fly()
    assert desk.mass.pos_ned_m[0] == pytest.approx(150.0, abs=0.1)


def test_a_place_to_land_at_is_flown_to_and_another_order_replaces_it() -> None:
    desk = Desk()
    in_the_air(desk)
    assert desk.command(mav.MAV_CMD_NAV_LAND, 0, 0, 0, 90, *place(60.0, 40.0, 0.0)) == OK
    desk.fly(seconds=2.0)
    assert desk.mass.pos_ned_m[2] == pytest.approx(-30.0)
    assert desk.command(mav.MAV_CMD_NAV_LAND, 0, 0, 0, NAN, *place(40.0, 0.0, 0.0)) == OK
    desk.fly()
    assert desk.mass.pos_ned_m == pytest.approx([40.0, 0.0, 0.0], abs=0.1)
    assert not desk.mass.armed


def test_land_here_is_not_passed_over_on_the_way_to_a_place() -> None:
    desk = Desk()
    in_the_air(desk)
    assert desk.command(mav.MAV_CMD_NAV_LAND, 0, 0, 0, NAN, *place(200.0, 0.0, 0.0)) == OK
    desk.fly(seconds=2.0)
    desk.mass.battery = desk.mass.battery._replace(remaining=0.04)  # lands wherever it is
    desk.fly()
    assert desk.mass.pos_ned_m[0] < 60.0
    assert not desk.mass.armed


def test_a_reposition_that_may_not_change_the_mode_is_refused_in_a_mission() -> None:
    desk = Desk()
    on_a_mission(desk)
    assert desk.command(mav.MAV_CMD_DO_REPOSITION, -1, 0, 0, NAN, *THERE) == DENIED
    assert desk.vehicle.autopilot.mode.name == "MISSION"
    assert desk.command(mav.MAV_CMD_DO_REPOSITION, -1, 1, 0, NAN, *THERE) == OK
    desk.fly(seconds=1.0)
    assert desk.command(mav.MAV_CMD_DO_REPOSITION, -1, 0, 0, NAN, *place(0.0, 0.0)) == OK
    desk.fly()
    assert desk.mass.pos_ned_m == pytest.approx([0.0, 0.0, -30.0], abs=0.5)  # 32-bit degrees


def test_a_speed_ends_with_the_mode_and_is_refused_where_it_cannot_be() -> None:
    desk = Desk()
    on_a_mission(desk)
    assert desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 4, -1) == OK
    assert desk.mass.paths[-1].speeds_mps[0] == pytest.approx(4.0)
    assert desk.command(mav.MAV_CMD_DO_PAUSE_CONTINUE, 0) == OK
    assert desk.command(mav.MAV_CMD_DO_PAUSE_CONTINUE, 1) == OK
    assert desk.mass.paths[-1].speeds_mps[0] == pytest.approx(10.0)
    assert desk.command(mav.MAV_CMD_NAV_LAND) == OK
    refused = desk.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 4, -1)
    assert refused == mav.MAV_RESULT_TEMPORARILY_REJECTED
    assert "mode LAND has a speed of its own" in "".join(desk.texts())


def test_a_mission_begins_with_the_item_that_is_marked_as_current() -> None:
    desk = Desk()
    in_the_air(desk)
    mission = [item(seq, mav.MAV_CMD_NAV_WAYPOINT, north=50.0 * (seq + 1)) for seq in range(3)]
    mission[1].current = 1
    assert desk.upload(mission) == mav.MAV_MISSION_ACCEPTED
    assert desk.vehicle.autopilot.flight.mission.current == 1
    assert desk.command(mav.MAV_CMD_MISSION_START) == OK
    desk.fly()
    assert [event.seq for event in desk.recorder.of_kind("reached")] == [1, 2]
