"""When configured faults begin."""

from unittest.mock import Mock

from flightdyn.faults import WindBurst
from flightdyn.physics.fault_state import FaultState

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
