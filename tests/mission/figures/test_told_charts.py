"""Charts of what a vehicle was told and did: which values, in which unit, from when to when."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bare_flight import bare_flight
from described import described, layers, rows

from mission.analysis.told import Values
from mission.figures.style import Chart
from mission.figures.told import flight_map, health_charts, side_by_side_charts, told_charts
from mission.log.signals import Signal
from mission.log.values import BatteryTrack, PlannedPlaces

T_S = np.arange(0.0, 20.5, 0.5)


def over(*axes: float) -> Signal:
    """Each axis rises from its value by 1 a second."""
    return Signal(T_S, np.column_stack([axis + T_S for axis in axes]))


def flight(signals: dict[str, Signal], **series: np.ndarray) -> Any:
    """In the air from 5 to 15 s."""
    planned = PlannedPlaces("a plan", {}, (), frozenset(), in_holes=False)
    track = np.column_stack((T_S, 0 * T_S, 0 * T_S + 9.0))
    data = replace(bare_flight(T_S, track), signals=signals, planned=planned)
    told = {name: Values(T_S, values) for name, values in series.items()}
    flown = SimpleNamespace(start_s=5.0, end_s=15.0, series=told)
    return SimpleNamespace(run=SimpleNamespace(data=data, about="a flight"), flown=flown)


def drawn(charts: list[Chart]) -> dict[str, tuple[str, dict[str, list[float]]]]:
    """By title the unit, and the first and last time and value of each line."""
    found = {}
    for chart in map(described, charts):
        lines: dict[str, list[float]] = {}
        for row in rows(chart, "series", "x"):
            if row["y"] is not None:
                ends = lines.setdefault(row["series"], [row["x"], row["y"]])
                ends[2:] = [row["x"], row["y"]]
        titles = (of["encoding"]["y"].get("title") for of in layers(chart))
        found[chart["title"]["text"]] = next(filter(None, titles)), lines
    return found


@pytest.mark.parametrize("air", [True, False])
def test_told_and_done_are_drawn_axis_by_axis_in_the_air(air: bool) -> None:
    names = ("position_m", "velocity_mps", "attitude_deg", "rates_degps")
    signals = {f"wanted_{name}": over(10.0, 200.0, 3000.0) for name in names}
    signals |= {name: over(11.0, 202.0, 3003.0) for name in names}
    found = flight(signals)
    begin, end = (5.0, 15.0) if air else (0.0, 20.0)
    if not air:
        found.flown = None

    def both(unit: str, told: Any, was: Any) -> tuple[str, dict[str, Any]]:
        lines = {name: pytest.approx([begin, of(begin), end, of(end)], rel=1e-5)
                 for name, of in (("told", told), ("was", was))}  # fmt: skip
        return unit, lines

    def turn(at: float) -> Any:
        return lambda t_s: (at + t_s + 180.0) % 360.0 - 180.0

    def plus(at: float) -> Any:
        return lambda t_s: at + t_s

    def level(at: float, other: float) -> Any:
        return lambda t_s: float(np.hypot(at + t_s, other + t_s))

    shown = drawn(told_charts(found))
    expected = {
        "Height": both("height (m)", lambda t_s: -3000.0 - t_s, lambda t_s: -3003.0 - t_s),
        "Position north": both("position north (m)", plus(10.0), plus(11.0)),
        "Position east": both("position east (m)", plus(200.0), plus(202.0)),
        "Ground speed": both("ground speed (m/s)", level(10.0, 200.0), level(11.0, 202.0)),
        "Climb": both("climb (m/s)", plus(3000.0), plus(3003.0)),
        "Roll": both("roll (deg)", turn(10.0), turn(11.0)),
        "Pitch": both("pitch (deg)", turn(200.0), turn(202.0)),
        "Yaw": both("yaw (deg)", turn(3000.0), turn(3003.0)),
        "Roll rate": both("roll rate (deg/s)", plus(10.0), plus(11.0)),
        "Pitch rate": both("pitch rate (deg/s)", plus(200.0), plus(202.0)),
        "Yaw rate": both("yaw rate (deg/s)", plus(3000.0), plus(3003.0)),
    }
    assert list(shown) == list(expected)
    for title, (unit, lines) in expected.items():
        assert shown[title][0] == unit
        assert shown[title][1] == lines, title


def test_what_has_two_axes_has_no_third_and_what_is_unknown_no_chart() -> None:
    flat = {name: over(1.0, 2.0) for name in ("wanted_velocity_mps", "velocity_mps")}
    assert list(drawn(told_charts(flight(flat)))) == ["Ground speed"]
    lost = {name: Signal(T_S, np.full((len(T_S), 3), np.nan)) for name in flat}
    assert told_charts(flight(lost)) == []
    assert told_charts(flight({})) == []


def test_health_has_a_line_for_each_axis_and_a_limit_of_innovations() -> None:
    signals = {
        "vibration_mps2": over(1.0, 2.0, 3.0), "innovation_ratio": over(0.0, 0.5),
        "satellites": over(12.0), "motors": over(*range(4)), "voltage_v": over(20.0),
    }  # fmt: skip
    found = flight(signals)
    none = np.full(2, np.nan)
    found.run.data = replace(
        found.run.data,
        battery=BatteryTrack(np.array([6, 14]) * 10**9, none, np.array([7.0, 9.0]), none, none),
    )
    charts = health_charts(found)
    shown = drawn(charts)
    assert {title: (unit, list(lines)) for title, (unit, lines) in shown.items()} == {
        "Vibration": ("vibration (m/s2)", ["x", "y", "z"]),
        "Innovations": ("innovations (of what is accepted)", ["velocity", "position"]),
        "Satellites": ("satellites (satellites)", ["satellites"]),
        "Motors": ("motors (of the most)", [f"motor {n}" for n in (1, 2, 3, 4)]),
        "Voltage": ("voltage (V)", ["voltage"]),
        "Current": ("current (A)", ["current"]),
    }
    assert shown["Vibration"][1]["z"] == [5.0, 8.0, 15.0, 18.0]
    assert shown["Current"][1]["current"] == [6.0, 7.0, 14.0, 9.0]
    gates = {
        chart["title"]["text"]
        for chart in charts
        if any(layer["mark"]["type"] == "rule" for layer in layers(chart))
    }
    assert gates == {"Innovations"}


def test_side_by_side_times_are_since_take_off_and_errors_have_no_sign() -> None:
    one = flight({}, tracking_m=T_S - 8.0, tilt_off_deg=np.full(len(T_S), np.nan))
    other = flight({}, tracking_m=0 * T_S + 2.0, motors=0 * T_S + 0.5)
    other.run.about, other.flown.start_s = "another", 2.0
    shown = drawn(side_by_side_charts([one, other]))
    assert {title: unit for title, (unit, _) in shown.items()} == {
        "Off the setpoint": "m", "Motors": "of the most"
    }  # fmt: skip
    assert shown["Off the setpoint"][1] == {
        "a flight": [-5.0, 8.0, 15.0, 12.0], "another": [-2.0, 2.0, 18.0, 2.0]
    }  # fmt: skip
    assert shown["Motors"][1] == {"another": [-2.0, 0.5, 18.0, 0.5]}


def test_a_map_has_where_it_was_told_to_be_beside_where_it_was() -> None:
    """Told 3 m farther north and 1 m to the east; between 8 and 12 s nothing."""
    wanted = np.column_stack((0 * T_S + 3.0, T_S + 1.0))
    wanted[(T_S > 8.0) & (T_S < 12.0)] = np.nan
    signals = {"wanted_position_m": Signal(T_S, wanted),
               "position_m": Signal(T_S, np.column_stack((0 * T_S, T_S)))}  # fmt: skip
    chart = described(flight_map(flight(signals)))
    lines: dict[int, list[tuple[float, float]]] = {}
    kinds = {}
    for row in rows(chart, "kind", "part"):
        lines.setdefault(row["part"], []).append((row["x"], row["y"]))
        kinds[row["part"]] = row["kind"]
    assert [(kinds[part], at) for part, at in lines.items()] == [
        ("flown", [(0, 0), (20, 0)]), ("planned", [(1, 3), (9, 3)]), ("planned", [(13, 3), (21, 3)])
    ]  # fmt: skip
    assert chart["title"]["text"] == "Told and flown"
    assert described(flight_map(flight({})))["title"]["text"] == "Flown"
