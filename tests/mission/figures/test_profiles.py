"""Profiles along a plan and time lines of flights whose every number is given."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bare_flight import bare_flight
from bare_measured import bare_measured
from described import described, layers, rows, tables

from mission.analysis.holes import Hole
from mission.analysis.told import Values
from mission.figures.flight import profile_charts, timeline_chart
from mission.figures.style import Chart
from mission.log.values import EventRecord, PlanRecord, Track
from mission.report.page import about

T_S = np.arange(0.0, 40.25, 0.25)
PLACES = np.column_stack((5.0 * T_S, 0 * T_S, np.interp(T_S, (0, 20, 40), (10, 50, 30))))
PATH = np.array([[0.0, 0.0, 10.0], [100.0, 0.0, 50.0], [200.0, 0.0, 30.0]])
HERE = (0.0, 0.0, 0.0)


def one(number: int = 1, *, later_s: float = 0.0, **known: Any) -> Any:
    track = Track(((T_S + later_s) * 1e9).astype(np.int64), PLACES)
    usual = {
        "cross_m": np.interp(T_S, (0, 10, 40), (0, 2, 5)),
        "speed_mps": np.interp(T_S, (0, 40), (5, 9)),
        "estimate_m": np.interp(T_S, (0, 40), (1, 3)), "height_m": np.interp(T_S, (0, 40), (0, -4)),
        "estimate_height_m": np.interp(T_S, (0, 40), (-2, 0)),
    }  # fmt: skip
    return bare_measured(track, PATH[:, :2], number=number, **{**usual, **known})


def flight(*measured: Any, name: str = "a flight", **more: Any) -> Any:
    data = bare_flight(T_S, PLACES)
    plan = PlanRecord.of_flight(1, 0, PATH, slot_s=np.array([0.0, 20.0, 40.0]))
    data = replace(data, plans=(plan,), **more)
    return SimpleNamespace(
        run=SimpleNamespace(data=data, about=name, name=name), measured=measured, flown=None
    )


def ends(chart: Chart) -> dict[str, list[Any]]:
    """First and last point of each line."""
    found: dict[str, list[Any]] = {}
    for row in rows(described(chart), "series", "x"):
        if row["y"] is not None:
            found.setdefault(row["series"], []).append((row["x"], row["y"]))
    return {name: [points[0], points[-1]] for name, points in found.items()}


def shown(*flights: Any) -> dict[str, dict[str, list[Any]]]:
    charts = profile_charts(flights)
    return {chart["title"]["text"]: ends(chart) for chart in charts if "layer" in chart}


def test_a_flight_alone_has_its_profiles_by_metres_and_seconds() -> None:
    found = shown(flight(one(later_s=7.0)))
    assert list(found) == [
        "Time line", "Height above home", "Distance from the path", "Ground speed",
        "Estimate against the truth",
    ]  # fmt: skip
    assert found["Height above home"] == {
        "flown": [(0, 10), (200, 30)], "planned": [(0, 10), (200, 30)]
    }  # fmt: skip
    assert found["Distance from the path"] == {"flown": [(0, 0), (200, 5)]}
    assert found["Ground speed"] == {"flown": [(0, 5), (200, 9)]}
    assert found["Estimate against the truth"] == {
        "horizontal": [(0, 1), (40, 3)], "height": [(0, 2), (40, 0)]
    }  # fmt: skip
    unknown = shown(flight(one(estimate_m=np.zeros(0))))
    assert "Estimate against the truth" not in unknown
    heights = described(profile_charts([flight(one())])[1])
    tops = {(r["series"], r["x"], r["y"]) for r in rows(heights, "series", "x")}
    assert {("flown", 100.0, 50.0), ("planned", 100.0, 50.0)} <= tops


def test_passes_and_flights_are_told_apart() -> None:
    found = shown(flight(one(1), one(2)))
    assert list(found["Ground speed"]) == ["flown, pass 1", "flown, pass 2"]
    assert list(found["Estimate against the truth"]) == [
        f"{side}, flown, pass {n}" for n in (1, 2) for side in ("horizontal", "height")
    ]
    two = shown(flight(one()), flight(one(), name="another"))
    assert {"Time line of a flight", "Time line of another"} <= set(two)
    assert list(two["Height above home"]) == ["a flight", "another", "planned"]
    assert list(two["Estimate against the truth"]) == [
        "horizontal, a flight", "horizontal, another"
    ]  # fmt: skip


def test_no_line_leads_across_a_hole() -> None:
    hole = Hole(1, 1, 10.1, 19.9, (0.0, 0.0), (0.0, 0.0))
    chart = described(profile_charts([flight(one(holes=(hole,)))])[3])
    points = [(r["x"], r["y"]) for r in rows(chart, "series", "x")]
    gaps = [n for n, (_, y) in enumerate(points) if y is None]
    assert len(gaps) == 2
    assert points[gaps[0] - 1] == (50.0, 6.0)
    assert points[gaps[0] + 1] == (100.0, 7.0)
    assert points[gaps[1] - 1] == (200.0, 9.0)


def test_a_time_line_has_errors_events_and_spikes() -> None:
    cross_m = np.where(np.abs(T_S - 30.0) < 1.1, 4.0, 0.5)
    told = tuple(
        EventRecord(round(t * 1e9), "mode", text, None, 6, HERE, HERE)
        for t, text in ((12.0, "HOLD"), (29.0, "MISSION"), (41.0, "after it"))
    )
    chart = timeline_chart(flight(one(cross_m=cross_m), events=told), alone=True)
    lines = ends(chart)
    assert lines["cross-track"] == [(0.0, 0.5), (40.0, 0.5)]
    assert lines["height"] == [(0.0, 0.0), (40.0, 4.0)]  # without a sign
    rules = rows(described(chart), "x2", "what")
    assert [(r["x"], r["x2"], r["what"]) for r in rules] == [
        (12.0, 12.0, "mode: HOLD"), (29.0, 29.0, "mode: MISSION")
    ]  # fmt: skip
    tops = next(t for t in tables(described(chart), "what") if "x2" not in t[0])
    assert (tops[0]["x"], tops[0]["y"]) == (29.0, 4.0)
    assert 'during "mode: MISSION"' in tops[0]["what"]
    assert chart["title"]["subtitle"] == "dashed: something happened; points: spikes, and why"
    calm = timeline_chart(
        flight(one(cross_m=0 * T_S, height_m=0 * T_S, estimate_m=0 * T_S)), alone=True
    )
    assert "subtitle" not in calm["title"]


def test_of_a_flight_without_a_plan_the_time_line_is_against_setpoints_with_its_health() -> None:
    series = {
        "tracking_m": Values(T_S, T_S / 10.0), "height_off_m": Values(T_S, -T_S / 20.0),
        "innovation_ratio": Values(T_S, T_S / 80.0), "satellites": Values(T_S, 20.0 - T_S / 4.0),
        "vibration_mps2": Values(T_S, T_S / 4.0), "clips": Values(T_S, 0 * T_S),
    }  # fmt: skip
    of = flight()
    of.flown = SimpleNamespace(start_s=2.0, end_s=38.0, series=series)
    chart = timeline_chart(of, alone=True)
    lines: dict[str, list[Any]] = {}
    for table in tables(chart, "series", "x"):
        for row in table:
            if row["y"] is not None:
                lines.setdefault(row["series"], []).append((row["x"], row["y"]))
    found = {name: (points[0], points[-1]) for name, points in lines.items()}
    assert found == {
        "off its setpoint": ((0, 0), (40, 4)), "height": ((0, 0), (40, 2)),
        "innovations, of what is accepted": ((0, 0), (40, 0.5)),
        "vibration, of 10.0 m/s2": ((0, 0), (40, 1.0)), "satellites, of 20": ((0, 1.0), (40, 0.5)),
    }  # fmt: skip
    assert len(list(layers(chart))) == 2  # by an axis each
    assert chart["resolve"]["scale"]["y"] == "independent"


@pytest.mark.parametrize(
    ("wind", "words"),
    [
        ("", "no steady wind, no turbulence, no gusts"),
        ("speed_mps = 4.5", "4.5 m/s, no turbulence, no gusts"),
        ("speed_mps = 4\nfrom_deg = 22", "4 m/s from north (22°), no turbulence, no gusts"),
        ("speed_mps = 4\nfrom_deg = 23", "4 m/s from north-east (23°), no turbulence, no gusts"),
        ("speed_mps = 4\nfrom_deg = 270", "4 m/s from west (270°), no turbulence, no gusts"),
        ("speed_mps = 4\nfrom_deg = 340", "4 m/s from north (340°), no turbulence, no gusts"),
        ("turbulence_severity = 3", "no steady wind, turbulence of severity 3 of 7, no gusts"),
        ("gusts = [{}]", "no steady wind, no turbulence, 1 gust"),
        ("gusts = [{}, {}]", "no steady wind, no turbulence, 2 gusts"),
    ],
)
def test_a_page_says_the_wind_as_it_was_configured(wind: str, words: str) -> None:
    config = f"[vehicle.aircraft.wind]\n{wind}\n".encode()
    data = replace(bare_flight(T_S, PLACES), attachments={"config.toml": config})
    loaded: Any = SimpleNamespace(summary={"wall_s": {"fly": 2.0, "learn": 3.5}}, data=data)
    told = about(loaded)
    assert told["conditions"] == [("wind", words)]
    assert told["wall_s"] == [("fly", 2.0), ("learn", 3.5)]
    assert told["total_s"] == 5.5
    loaded.summary["wall_s"]["total"] = 9.0
    whole = about(loaded)
    assert (whole["total_s"], whole["wall_s"]) == (9.0, told["wall_s"])
    bare: Any = SimpleNamespace(summary={}, data=replace(data, attachments={}))
    assert about(bare)["conditions"] == []
    assert about(bare)["total_s"] == 0
