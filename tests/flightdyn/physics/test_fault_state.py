"""When faults begin and end, and what they do together."""

from typing import Any
from unittest.mock import Mock

import pytest

from flightdyn.faults import Fault, GnssJump, GnssOff, ImuBias, MotorLoss, WindBurst
from flightdyn.physics.fault_state import FaultState
from native.errors import FaultError

S = 1_000_000_000


def test_a_fault_counts_from_what_it_comes_after_when_that_first_happens() -> None:
    at_once = WindBurst(at_s=1.0, north_mps=1.0, duration_s=1.0)
    armed = WindBurst(after="arming", at_s=2.0, north_mps=2.0, duration_s=1.0)
    third = WindBurst(after=3, north_mps=4.0, duration_s=1.0)
    clock = Mock(t_ns=0)
    state = FaultState([third, armed, at_once], Mock(), clock, receiver=None, imu=None)
    begun: dict[int, float] = {}
    happens: dict[int, str | int] = {10: "arming", 11: "take-off", 20: 3, 30: "arming", 40: 3}
    for t_s in range(50):
        clock.t_ns = t_s * S
        if t_s in happens:
            state.happened(happens[t_s])
        state.update()
        if north_mps := state.burst_ned_mps[0]:
            begun[t_s] = north_mps
    assert begun == {1: 1.0, 12: 2.0, 20: 4.0}
    words = {1: "begins", 2: "ends", 12: "begins", 13: "ends", 20: "begins", 21: "ends"}
    assert state.news == [(t_s * S, f"Fault {word}: wind_burst") for t_s, word in words.items()]


def test_a_fault_begun_twice_is_told_once() -> None:
    burst = WindBurst(north_mps=1.0)
    clock = Mock(t_ns=0)
    state = FaultState([], Mock(), clock, receiver=None, imu=None)
    calls = (
        (state.begin, burst), (state.begin, burst), (state.begin, WindBurst(north_mps=2.0)),
        (state.end, burst),
    )  # fmt: skip
    for clock.t_ns, (call, fault) in enumerate(calls, start=1):
        call(fault)
    words = ["begins", "begins", "ends", "ends"]
    assert [(t, text.split()[1].rstrip(":")) for t, text in state.news] == list(
        zip([1, 3, 4, 4], words, strict=True)
    )


def healths(vehicle: Mock) -> list[tuple[int, float]]:
    """Motor and share of each call."""
    return [each.args for each in vehicle.set_motor_health.call_args_list]


def test_overlapping_faults_add_up_and_of_a_motor_the_least_share_counts() -> None:
    vehicle, receiver, imu = Mock(), Mock(), Mock()
    state = FaultState([], vehicle, Mock(t_ns=0), receiver=receiver, imu=imu)
    faults: list[Fault] = [
        GnssJump(north_m=1.0, east_m=2.0, down_m=3.0), GnssJump(north_m=10.0, down_m=-5.0),
        WindBurst(north_mps=1.0, east_mps=2.0, down_mps=3.0), WindBurst(east_mps=4.0),
        ImuBias(gyro_radps=(0.1, 0.2, 0.3), accel_mps2=(1.0, 2.0, 3.0)),
        ImuBias(accel_mps2=(0.5, 0.0, -4.0)), MotorLoss(motor=2, share=0.5),
        MotorLoss(motor=2, share=0.25), MotorLoss(motor=1, share=0.75), GnssOff(),
    ]  # fmt: skip
    for fault in faults:
        state.begin(fault)
    assert state.active == tuple(faults)
    assert receiver.jump_ned_m == (11.0, 2.0, -2.0)
    assert receiver.on is False
    assert state.burst_ned_mps == (1.0, 6.0, 3.0)
    assert imu.fail.call_args.args[0] == pytest.approx([0.1, 0.2, 0.3, 1.5, 2.0, -1.0])
    assert healths(vehicle)[-2:] == [(1, 0.75), (2, 0.25)]
    vehicle.reset_mock()
    state.end(faults[7])
    assert healths(vehicle) == [(1, 0.75), (2, 0.5)]
    for fault in faults:
        state.end(fault)
    assert state.active == ()
    assert (receiver.jump_ned_m, receiver.on) == ((0.0, 0.0, 0.0), True)
    assert state.burst_ned_mps == (0.0, 0.0, 0.0)
    assert imu.fail.call_args.args == ([0.0] * 6,)
    assert dict(healths(vehicle)) == {1: 1.0, 2: 1.0}  # what was said last
    vehicle.reset_mock()
    state.begin(GnssOff())
    assert healths(vehicle) == []  # no motor that has been well all along


def test_a_fault_lasts_until_its_own_end() -> None:
    clock: Any = Mock(t_ns=0)
    state = FaultState([], Mock(), clock, receiver=None, imu=None)
    for clock.t_ns, north_mps in ((0, 1.0), (S, 2.0)):
        state.begin(WindBurst(north_mps=north_mps, duration_s=1.5))
    state.begin(WindBurst(north_mps=4.0))
    for t_ns, north_mps in ((1.499, 7.0), (1.5, 6.0), (2.499, 6.0), (2.5, 4.0), (9.0, 4.0)):
        clock.t_ns = round(t_ns * S)
        state.update()
        assert state.burst_ned_mps[0] == north_mps


@pytest.mark.parametrize("fault", [GnssOff(), GnssJump(), ImuBias()])
def test_where_there_is_no_sensor_none_can_fail(fault: Fault) -> None:
    with pytest.raises(FaultError, match=f"fault {fault.kind!r} needs sensors.kind = 'realistic'"):
        FaultState([fault], Mock(), Mock(t_ns=0), receiver=None, imu=None)
