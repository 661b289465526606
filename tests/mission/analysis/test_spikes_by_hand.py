"""Spikes and health of flights whose every number is given, up to the bounds of what is one."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bare_flight import bare_flight
from bare_measured import bare_measured
from numpy.typing import ArrayLike

from mission.analysis.measure import Leg, Measured, happened, legs
from mission.analysis.spikes import events, spikes
from mission.analysis.whole import health, with_battery
from mission.log.signals import Signal
from mission.log.values import BatteryTrack, EventRecord, FlightData, MissionRecord, Track

T_S = np.arange(0.0, 60.25, 0.25)
PATH = np.array([[0.0, 0.0], [60.0, 0.0]])


def event(t_s: float, kind: str, text: str, *, severity: int = 6) -> EventRecord:
    return EventRecord(
        round(t_s * 1e9), kind, text, None, severity, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    )


def measured(cross: ArrayLike = 0.0, *, number: int = 3, **more: Any) -> Measured:
    track = Track((T_S * 1e9).astype(np.int64), np.column_stack((T_S, 0 * T_S, 0 * T_S)))
    legs = {"leg": (T_S // 10).astype(int), "cross_m": np.broadcast_to(cross, T_S.shape)}
    return bare_measured(track, PATH, number=number, **{**legs, **more})


def flight(*told: EventRecord, **more: Any) -> FlightData:
    return replace(bare_flight(T_S, np.zeros((len(T_S), 3))), events=told, **more)


def hill(peak: float, *, at_s: float = 30.0, wide_s: float = 4.0) -> np.ndarray:
    """Straight up to a peak and down again."""
    return np.asarray(peak * np.clip(1.0 - np.abs(T_S - at_s) / wide_s, 0.0, None))


def test_a_spike_is_of_more_than_a_metre_and_ends_at_its_half() -> None:
    assert spikes(flight(), [measured(hill(1.0))]) == ()
    (found,) = spikes(flight(), [measured(hill(1.0625))])
    # Above half a metre: within 2.1 s of its top.
    assert (found.start_s, found.end_s) == (28.0, 32.0)
    assert (found.what, found.peak_m, found.peak_s) == ("cross-track", 1.0625, 30.0)
    assert (found.number, found.leg, found.during) == (3, 3, ())
    assert found.words == "at 28.0-32.0 s cross-track 1.1 m, leg 3"
    # Where a metre is usual, only what is three times as far is one.
    assert spikes(flight(), [measured(np.maximum(1.0, hill(2.95)))]) == ()
    (found,) = spikes(flight(), [measured(np.maximum(1.0, hill(3.05)))])
    assert (found.start_s, found.end_s, found.peak_m) == (28.0, 32.0, 3.05)


def test_spikes_a_second_apart_are_one() -> None:
    """Three metres for a second each."""

    def found(apart_s: float) -> list[tuple[float, float]]:
        after_s = T_S - (20.75 + apart_s)
        high = ((T_S >= 20.0) & (T_S < 21.0)) | ((after_s >= 0.0) & (after_s < 1.0))
        return [(s.start_s, s.end_s) for s in spikes(flight(), [measured(3.0 * high)])]

    assert found(1.0) == [(20.0, 22.5)]
    assert found(1.25) == [(20.0, 20.75), (22.0, 22.75)]


def test_each_kind_of_error_has_its_spikes_in_order() -> None:
    given = measured(
        hill(3.0, at_s=40.0), height_m=-hill(2.0, at_s=10.0), estimate_m=hill(5.0, at_s=50.0)
    )
    found = spikes(flight(), [given, measured(hill(4.0, at_s=20.0), number=4)])
    rows = [(s.what, s.peak_m, s.peak_s, s.number, s.leg) for s in found]
    assert rows == [
        ("height error", 2.0, 10.0, 3, 1), ("cross-track", 4.0, 20.0, 4, 2),
        ("cross-track", 3.0, 40.0, 3, 4), ("estimate off by", 5.0, 50.0, 3, 5),
    ]  # fmt: skip
    unknown = measured(0.0, estimate_m=np.zeros(0))
    assert spikes(flight(), [unknown]) == ()


def test_a_corner_that_is_cut_by_ten_metres_is_no_spike() -> None:
    near = np.where(np.abs(T_S - 30.0) < 10.0, math.nan, 0.0)
    for peak, is_one in ((10.0, False), (10.5, True)):
        assert bool(spikes(flight(), [measured(hill(peak), straight=near)])) == is_one
    assert spikes(flight(), [measured(hill(9.0), straight=0 * T_S)])


def test_events_explain_what_begins_within_five_seconds() -> None:
    told = [
        event(22.75, "mode", "too early"), event(23.0, "mode", "HOLD"), event(30.0, "reached", "x"),
        event(31.0, "status", "bad", severity=4), event(31.0, "status", "so", severity=5),
        event(31.5, "fault", "motor"), event(31.5, "failsafe", "low"), event(32.0, "armed", "off"),
        event(32.0, "armed", "off"), event(32.25, "mode", "too late"),
    ]  # fmt: skip
    (found,) = spikes(flight(*told), [measured(hill(1.0625))])
    assert found.during == (
        "mode: HOLD", "status: bad", "fault: motor", "failsafe: low", "armed: off"
    )  # fmt: skip
    assert found.words.endswith('leg 3, during "mode: HOLD"; "status: bad"; "fault: motor"; '
                                '"failsafe: low"; "armed: off"')  # fmt: skip


def test_events_before_a_pass_explain_what_is_at_its_begin() -> None:
    told = [event(-5.25, "mode", "A"), event(-5.0, "mode", "B"), event(3.0, "mode", "C")]
    (found,) = spikes(flight(*told), [measured(hill(3.0, at_s=0.0))])
    assert found.during == ("mode: B", "mode: C")


def test_events_are_told_uploaded_lost_and_dropped_in_order() -> None:
    kept = (T_S <= 20.0) | (T_S >= 24.0)
    data = flight(
        event(9.5, "mode", "A"), event(10.0, "mode", "B"), event(50.0, "mode", "C"),
        event(50.5, "mode", "D"), missions=(MissionRecord(30 * 10**9, "fence", ()),),
        dropouts_s=np.array([[8.0, 1.5], [8.5, 1.5], [49.0, 9.0]]),
        gnss_ns=(T_S[(T_S < 40.0) | (T_S > 42.0)] * 1e9).astype(np.int64),
        truth=Track((T_S[kept] * 1e9).astype(np.int64), np.zeros((kept.sum(), 3))),
    )  # fmt: skip
    found = [(e.start_s, e.end_s, e.text) for e in events(data, 10.0, 50.0)]
    assert found == [
        (8.5, 10.0, "log dropout of 1.50 s"), (10.0, 10.0, "mode: B"),
        (20.0, 24.0, "no positions 20.0-24.0 s"), (30.0, 30.0, "fence uploaded"),
        (39.75, 42.25, "GNSS lost 39.8-42.2 s"), (49.0, 58.0, "log dropout of 9.00 s"),
        (50.0, 50.0, "mode: C"),
    ]  # fmt: skip


def test_events_count_from_their_begin_up_to_the_end() -> None:
    told = [event(10.0, "armed", "armed"), event(50.0, "armed", "disarmed")]
    for kind, number in (("mode", 1), ("failsafe", 2), ("fault", 3)):
        for at_s in (9.0, 19.75, 39.75, 40.0, 55.0):
            told += [event(at_s, kind, f"{kind} {at_s}")] * number
    told.append(event(30.0, "fault", "Fault ends: wind"))
    found = happened(flight(*told), round(19.75e9), round(40e9))
    assert found["mode_changes"] == 2
    assert found["failsafes"] == 4
    assert found["faults"] == 6
    assert math.isnan(found["gnss_gaps"])
    assert math.isnan(found["gnss_gap_max_s"])
    fixes_s = np.concatenate((np.arange(0.0, 20.5, 0.5), np.arange(22.5, 30.0, 0.5), [33.0, 33.5]))
    fixes = (np.append(fixes_s, 60.0) * 1e9).astype(np.int64)
    found = happened(flight(gnss_ns=fixes), 0, round(31e9))
    assert (found["gnss_gaps"], found["gnss_gap_max_s"]) == (2, 3.5)
    # Three usual intervals are none yet.
    found = happened(flight(gnss_ns=(np.array([0, 1, 2, 3, 6, 7, 8]) * 10**9)), 0, round(8e9))
    assert (found["gnss_gaps"], found["gnss_gap_max_s"]) == (0, 0.0)
    found = happened(flight(gnss_ns=(np.array([0, 1, 2, 3, 7, 8, 9]) * 10**9)), 0, round(8e9))
    assert (found["gnss_gaps"], found["gnss_gap_max_s"]) == (1, 4.0)


def test_a_leg_ends_where_the_next_one_begins() -> None:
    """Three pieces of a path at 1 m/s, of which the last two are one leg; and an end of 0.4 m."""
    path = np.array([[0.0, 0.0], [20.0, 0.0], [45.0, 0.0], [60.0, 0.0], [60.4, 0.0]])
    of = measured(
        np.where(T_S < 20.0, 1.0, 3.0), leg=np.where(T_S < 20.0, 1, 2),
        height_m=np.where(T_S == 30.0, -7.0, 2.0), pieces=np.array([1, 2, 2, 3]),
        seqs=np.array([0, 4, -1, 6, 7]),
    )  # fmt: skip
    of = replace(of, fit=replace(of.fit, waypoints_at_m=path[:, 0]))
    first, second = legs(of)
    assert first.cross_track_rms_m == pytest.approx(math.sqrt((80 * 1.0 + 9.0) / 81))
    assert replace(first, cross_track_rms_m=1.0) == Leg(3, 1, 4, 20, 0.0, 20.0, 1.0, 3.0, 2.0, 1.0)
    assert second == Leg(3, 2, 6, 40.0, 20.0, 60.0, 3.0, 3.0, 7.0, 1.0)
    # Of a leg on which there is one sample at most nothing is known.
    (_, unknown) = legs(replace(of, leg=np.where(T_S < 60.0, 1, 2)))
    assert math.isnan(unknown.start_s)
    assert math.isnan(unknown.speed_mean_mps)
    assert (unknown.item, unknown.length_m) == (6, 40.0)
    (_, short) = legs(replace(of, leg=np.where(T_S < 59.75, 1, 2)))
    assert (short.start_s, short.end_s, short.speed_mean_mps) == (59.75, 60.0, 1.0)
    # Its speed is that over ground.
    climbs = replace(of.truth, pos_m=of.truth.pos_m + np.outer(T_S, [0.0, 0.0, 2.0]))
    assert [leg.speed_mean_mps for leg in legs(replace(of, truth=climbs))] == [1.0, 1.0]
    assert legs(replace(of, seqs=of.seqs[:0])) == ()
    assert [leg.item for leg in legs(replace(of, seqs=np.array([0, -1, -1, 6, 7])))] == [None, 6]


AIR_S = [(10.0, 20.0), (30.0, 40.0)]


def signal(*axes: ArrayLike) -> Signal:
    return Signal(T_S, np.column_stack([np.broadcast_to(axis, T_S.shape) for axis in axes]))


def test_of_health_the_worst_axis_counts_and_only_in_the_air() -> None:
    first, second = (T_S >= 10.0) & (T_S <= 20.0), (T_S >= 30.0) & (T_S <= 40.0)
    signals = {
        "vibration_mps2": signal(1.0, np.where(T_S == 20.0, 7.0, math.nan), 2.0),
        "clips": signal(np.floor(T_S), 100.0 + 2 * np.floor(T_S)),
        "remaining": signal(0.9, np.where(T_S == 30.0, 0.2, 0.5)),
        "voltage_v": signal(24.0 - T_S / 10.0, 23.5 - T_S / 10.0),
        "satellites": signal(np.where(first | second, 8.0, 3.0)),
        "hdop": signal(math.nan),
        "other": signal(1.0),
    }
    found = health(flight(signals=signals), AIR_S)
    assert set(found) == {*signals, "sag_v", "log_gap_s"} - {"other"}
    (air,) = {tuple(found[name].t_s) for name in signals if name in found}
    assert air == tuple(T_S[first | second])
    expected = {
        "vibration_mps2": [2.0] * 40 + [7.0] + [2.0] * 41, "satellites": [8.0] * 82,
        "remaining": [0.5] * 41 + [0.2] + [0.5] * 40,
        "voltage_v": 23.5 - np.array(air) / 10.0, "hdop": [math.nan] * 82,
        "clips": 2 * (np.floor(air) - 10), "sag_v": (np.array(air) - 10.0) / 10.0,
    }  # fmt: skip
    for name, values in expected.items():
        assert found[name].values == pytest.approx(values, nan_ok=True), name


def test_motors_at_their_most_and_apart() -> None:
    """At 0.99 for 2.5 s; on average they are 0.3 apart."""
    full = (T_S >= 12.0) & (T_S < 14.5)
    one, other = np.where(full, 0.99, 0.5), np.where(full, 0.3, 0.2)
    found = health(flight(signals={"motors": signal(one, other, 0.4)}), AIR_S)
    assert found["motors"].values.max() == 0.99
    assert found["motors_full_s"].values.tolist() == [2.5]
    assert np.isnan(found["motors_full_s"].t_s).all()
    means = (0.5 + 10 / 82 * 0.49, 0.2 + 10 / 82 * 0.1)
    assert found["motor_imbalance"].values == pytest.approx([means[0] - means[1]])
    below = health(flight(signals={"motors": signal(0.98)}), AIR_S)
    assert below["motors_full_s"].values.tolist() == [0.0]


def test_a_log_that_holds_nothing_at_all_and_what_it_tells_of() -> None:
    """Times of any signal, each in the air for itself."""
    kept = (T_S < 12.0) | (T_S > 15.0)
    other = Signal(np.array([13.0]), np.zeros((1, 1)))
    data = flight(
        signals={"other": other}, dropouts_s=np.array([[9.0, 5.0], [10.0, 0.5], [40.0, 0.7]]),
        truth=Track((T_S[kept] * 1e9).astype(np.int64), np.zeros((kept.sum(), 3))),
    )  # fmt: skip
    found = health(data, AIR_S)["log_gap_s"]
    long = {at: size for at, size in zip(found.t_s, found.values, strict=True) if size != 0.25}
    assert long == {11.75: 1.25, 13.0: 2.25, 10.0: 0.5, 40.0: 0.7}
    assert len(found.t_s) == 4 + (8 - 1) + (20 - 1) + 40


def test_a_battery_of_the_vehicle_is_the_first_of_its_signals() -> None:
    times, none = np.array([0.0, 30.0, 60.0]), np.full(3, math.nan)
    battery = BatteryTrack((times * 1e9).astype(np.int64), np.array([25.0, 24, 23]), none, none,
                           np.array([1.0, 0.9, 0.8]))  # fmt: skip
    found = with_battery(flight(signals={"voltage_v": signal(1.0, T_S)}, battery=battery))
    assert set(found) == {"voltage_v", "remaining"}
    assert found["voltage_v"].t_s.tolist() == times.tolist()
    assert found["voltage_v"].values.tolist() == [[25.0, 0.0], [24.0, 30.0], [23.0, 60.0]]
    assert found["remaining"].values.tolist() == [[1.0], [0.9], [0.8]]
