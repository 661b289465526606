"""A minute's share of the attack; `python benchmarks/fuzz.py` goes on for as long as wanted."""

import math
from copy import copy
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, item, of
from sitl_fuzz import FLOATS, KINDS, Attack, Frames

from sitl.autopilot.flying.modes import Mode

SEVEN = st.lists(st.sampled_from(FLOATS) | st.floats(width=32), min_size=7, max_size=7)
PLACES = st.tuples(*[st.floats(-300.0, 300.0)] * 2, st.sampled_from([5.0, 30.0, 80.0, *FLOATS]))
FOUR = st.tuples(*[st.sampled_from(FLOATS)] * 4)
LISTS = {
    mav.MAV_MISSION_TYPE_MISSION: [16, 17, 19, 20, 21, 22, 93, 112, 115, 177, 178],
    mav.MAV_MISSION_TYPE_FENCE: [5001, 5002, 5003, 5004],
    mav.MAV_MISSION_TYPE_RALLY: [5100],
}
COMMANDS = sorted(Desk(ready=False).vehicle.autopilot.commands.known)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_frames_of_any_kind(seed: int) -> None:
    attack = Attack(seed)
    attack.run(1500)  # raises where an oracle is broken
    assert attack.sent >= 1500


@pytest.mark.parametrize("mode", [(4, 5), (4, 6), (6, 0)])
def test_a_mode_chosen_on_the_ground_is_no_broken_vehicle(mode: tuple[int, int]) -> None:
    """One that keeps it from being armed is left before its last mission is flown."""
    attack = Attack(1)
    assert attack.desk.command(mav.MAV_CMD_DO_SET_MODE, 1, *mode) == mav.MAV_RESULT_ACCEPTED
    attack.fly_a_mission()


def test_the_same_seed_is_the_same_attack() -> None:
    first, second = Attack(3), Attack(3)
    for attack in (first, second):
        for _ in range(300):
            attack.step()
    assert first.desk.vehicle.t_ns == second.desk.vehicle.t_ns
    assert (first.desk.mass.pos_ned_m == second.desk.mass.pos_ned_m).all()
    assert first.desk.texts() == second.desk.texts()


@pytest.mark.slow
def test_frames_cover_the_dialect() -> None:
    """Every kind is drawn, in both versions of the protocol, signed and not."""
    ears, kinds, versions, signed = mav.MAVLink(None), set(), set(), set()
    ears.robust_parsing = True
    for _, frame in zip(range(30_000), Frames(1), strict=False):
        for message in ears.parse_buffer(frame) or ():
            if message.get_type() != "BAD_DATA":
                kinds.add(message.get_msgId())
                versions.add(message.get_msgbuf()[0])
                signed.add(bool(message.get_header().incompat_flags & 1))
    assert versions == {0xFE, 0xFD}
    assert signed == {True, False}
    assert kinds >= set(mav.mavlink_map)
    assert len(KINDS) == 301


class Station(RuleBasedStateMachine):
    """A ground station that does anything, in any order, with any numbers."""

    @initialize()
    def begin(self) -> None:
        self.desk = Desk()

    @rule(
        kind=st.sampled_from(sorted(LISTS)),
        drawn=st.lists(
            st.tuples(st.integers(0, 10), PLACES, FOUR, st.sampled_from([0, 2, 3, 5, 6])),
            max_size=6,
        ),
    )
    def upload(
        self,
        kind: int,
        drawn: list[tuple[int, tuple[float, ...], Any, int]],
    ) -> None:
        commands = LISTS[kind]
        items = [
            item(seq, commands[pick % len(commands)], north=n, east=e, height=up,
                 params=params, frame=frame, mission_type=kind)
            for seq, (pick, (n, e, up), params, frame) in enumerate(drawn)
        ]  # fmt: skip
        if items:
            self.desk.upload(items, kind)

    @rule(number=st.sampled_from(COMMANDS), params=SEVEN)
    def command(self, number: int, params: list[float]) -> None:
        # Rebooting and ending the flight would leave little to look at.
        if number not in (mav.MAV_CMD_DO_FLIGHTTERMINATION, mav.MAV_CMD_INJECT_FAILURE):
            self.desk.command(number, *params)

    @rule(name=st.sampled_from(["MPC_XY_CRUISE", "NAV_ACC_RAD", "MIS_DIST_1WP"]), value=SEVEN)
    def set_parameter(self, name: str, value: list[float]) -> None:
        self.desk.send(mav.MAVLink_param_set_message(1, 1, name.encode(), value[0], 9))

    @rule(seq=st.integers(0, 8))
    def set_current(self, seq: int) -> None:
        self.desk.send(mav.MAVLink_mission_set_current_message(1, 1, seq))

    @rule(seconds=st.sampled_from([0.1, 3.0, 30.0]))
    def fly(self, seconds: float) -> None:
        self.desk.fly(seconds=seconds)

    @rule(seconds=st.sampled_from([0.3, 20.0]))
    def wait(self, seconds: float) -> None:
        self.desk.now += seconds
        self.desk.exchange()

    @rule()
    def take_off(self) -> None:
        self.desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0)
        self.desk.command(mav.MAV_CMD_NAV_TAKEOFF)

    @rule(command=st.sampled_from([mav.MAV_CMD_MISSION_START, mav.MAV_CMD_DO_PAUSE_CONTINUE]))
    def what_is_acknowledged_happens(self, command: int) -> None:
        flight = self.desk.vehicle.autopilot.flight
        if self.desk.command(command, *([1.0] if command == 193 else [])) == 0:
            assert flight.mode is Mode.MISSION
            assert flight.mission.items

    @invariant()
    def nothing_went_wrong_inside(self) -> None:
        if hasattr(self, "desk"):
            assert "Internal error" not in "".join(self.desk.texts())
            assert all(map(math.isfinite, (*self.desk.mass.pos_ned_m, *self.desk.mass.vel_ned_mps)))
            assert self.desk.mass.armed or self.desk.mass.vel_ned_mps[2] >= 0.0

    @invariant()
    def what_was_accepted_can_be_flown_from_every_item(self) -> None:
        if hasattr(self, "desk"):
            flight = self.desk.vehicle.autopilot.flight
            for seq in range(len(flight.mission.items)):
                rewound = copy(flight.mission)
                rewound.rewind(seq)
                flight._stages(rewound)

    def teardown(self) -> None:
        if hasattr(self, "desk"):
            heard = self.desk.pass_wall_time(1.1)
            assert of(heard, "HEARTBEAT")


TestStation = Station.TestCase
pytest.mark.slow(TestStation)
TestStation.settings = settings(max_examples=40, stateful_step_count=30, deadline=None)
