"""Numbers that pictures of flights show: when each does what, ends and arrows, battery and wind."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bare_flight import bare_flight
from described import described, layers, rows, tables

from mission.figures.conditions import condition_charts, estimator_charts
from mission.figures.maps import overview, round_map
from mission.figures.style import Chart
from mission.figures.together import separation_chart, timetable, together_film, together_map
from mission.log.records import UNKNOWN_ROUND, TimedUplinkRecord
from mission.log.values import (
    BatteryTrack,
    Devices,
    FlightData,
    InnovationTrack,
    PlannedPlaces,
    PlanRecord,
    WindTrack,
)
from mission.log.world_files import Met, Seen

NOT_FLOWN = {"config.toml": b"[mission]\nflight = 'none'\n"}  # so that all of it is in the air
NO_PLACES = np.zeros((0, 2))


def uplink(number: int, device: int, slot_t_s: float, **more: Any) -> TimedUplinkRecord:
    known: dict[str, Any] = dict.fromkeys(
        ("plan_x_m", "plan_y_m", "est_x_m", "est_y_m", "est_alt_m", "true_x_m", "true_y_m"), 0.0
    )
    known |= {"true_alt_m": 0.0, "plan_per": 0.5, "est_per": 0.5, "true_per": 0.5, "step": 1}
    known |= {"importance": 1.0, "delivered": True, "ready_t_s": 0.0, "late": False}
    known |= {"community": "a", "staleness": 0, "upload_s": 0.0, **more}
    return TimedUplinkRecord(round=number, device=device, slot_t_s=slot_t_s, **known)


def flight(*places: tuple[float, float, float, float], **more: Any) -> FlightData:
    """Straight between places: time, east, north, up."""
    t_s, *axes = np.array(places).T
    every = np.arange(t_s[0], t_s[-1] + 0.25, 0.25)
    track = np.column_stack([np.interp(every, t_s, axis) for axis in axes])
    return replace(bare_flight(every, track), attachments=NOT_FLOWN, **more)


def world(*flights: FlightData, added_s: float = 0.0, met: tuple[Met, ...] = ()) -> Any:
    """Flights judged together, of which all after the first are on a clock of their own."""
    names = tuple("abcdef"[: len(flights)])
    added = (0.0, *[added_s] * (len(flights) - 1))
    tracks = tuple(
        replace(of.truth, t_ns=of.truth.t_ns + round(by * 1e9))
        for of, by in zip(flights, added, strict=True)
    )
    seen = [
        Seen(n, f"#{k}{k}{k}", t, ()) for k, (n, t) in enumerate(zip(names, tracks, strict=True))
    ]
    runs = [SimpleNamespace(run=SimpleNamespace(data=of, path=n))
            for n, of in zip(names, flights, strict=True)]  # fmt: skip
    return SimpleNamespace(
        flights=runs, names=names, tracks=tracks, added_s=added, seen=seen, met=list(met),
        on_map=lambda points: np.add(points, (100.0, 0.0)),
    )  # fmt: skip


BUSY = (
    (0.0, 0.0, 0.0, 0.0), (10.0, 0.0, 0.0, 20.0), (20.0, 30.0, 0.0, 20.0), (25.0, 30.0, 0.0, 20.0),
    (30.0, 30.0, 0.0, 20.0), (35.0, 45.0, 0.0, 20.0), (40.0, 45.0, 0.0, 20.0),
)  # fmt: skip


def spans(chart: Chart, vehicle: str = "a") -> list[tuple[str, float, float]]:
    return [
        (row["kind"], row["begin"], row["end"])
        for row in rows(described(chart), "kind", "begin")
        if row["vehicle"] == vehicle
    ]


def test_a_timetable_tells_what_each_does_when() -> None:
    """A climb of 2 m/s, a leg of 3 m/s, a hover up to the last slot, a wait, and ways outside."""
    record = replace(UNKNOWN_ROUND, round=1, start_t_s=10.0, duration_s=20.0)
    sent = uplink(1, 0, 25.0), uplink(1, 1, 22.5), uplink(1, 2, math.nan), uplink(2, 0, 29.0)
    run = flight(*BUSY, rounds=(record,), uplinks=sent)
    chart = timetable(world(run, run, added_s=5.0))
    found = [
        ("climb, descent", 0.0, 10.0), ("leg", 10.0, 20.0), ("hover", 20.0, 25.0),
        ("wait", 25.0, 30.0), ("to and fro", 30.0, 35.0), ("wait", 35.0, 40.0),
    ]  # fmt: skip
    assert spans(chart) == found
    assert spans(chart, "b") == [(kind, since + 5.0, to + 5.0) for kind, since, to in found]
    slots = [(row["vehicle"], row["at"]) for row in rows(described(chart), "at")]
    assert slots == [(n, at + by) for n, by in (("a", 0), ("b", 5)) for at in (25.0, 22.5, 29.0)]
    # Of a round in which nobody sends, all is behind the last slot; of none, nothing.
    assert spans(timetable(world(replace(run, uplinks=()))))[2:4] == [
        ("wait", 20.0, 30.0), ("to and fro", 30.0, 35.0)
    ]  # fmt: skip
    assert spans(timetable(world(replace(run, uplinks=(), rounds=()))))[2:] == [
        ("hover", 20.0, 30.0), ("leg", 30.0, 35.0), ("hover", 35.0, 40.0)
    ]  # fmt: skip


@pytest.mark.parametrize(("pace_mps", "kind"), [(0.69, "hover"), (0.72, "leg")])
def test_who_is_slow_hovers_and_who_climbs_more_than_he_flies_climbs(pace_mps, kind: str) -> None:
    run = flight((0, 0, 0, 9), (20, 20 * pace_mps, 0, 9), (30, 35 * pace_mps, 0, 9 + 14 * pace_mps))
    assert spans(timetable(world(run)))[0][0] == kind
    steep = flight((0, 0, 0, 9), (20, 24, 32, 50), (40, 48, 64, 89))  # 40 m flown, 41 m and 39 m up
    assert spans(timetable(world(steep))) == [("climb, descent", 0.0, 20.0), ("leg", 20.0, 40.0)]


def test_a_map_of_all_has_some_height_and_rings_of_who_served_most() -> None:
    devices = Devices(np.array([[0.0, 1.0], [50.0, 2.0], [100.0, 3.0], [60.0, 4.0]]), ("a",) * 4)
    first, second = (
        flight((0, 100, 0, 9), (50, 300, 0, 9), devices=devices,
               uplinks=tuple(uplink(1, device, 3.0) for device in of))
        for of in ((0, 1, 1), (1, 2, 0))
    )  # fmt: skip
    near = Met("a and b", np.array([120.0, 0.0, 9.0]), 4.0, 1.234, np.zeros(2), np.ones(2))
    far = replace(near, name="c", at_m=np.array([150.0, 0.0, 9.0]), away_m=20.0)
    chart = described(together_map(world(first, second, met=(far, near)), 400.0))
    rings = [(row["by"], row["x"], row["y"]) for row in rows(chart, "by")]
    assert rings == [("a", 100, 1), ("a", 150, 2), ("b", 200, 3), ("", 160, 4)]
    low, high = (next(layers(chart))["encoding"][axis]["scale"]["domain"] for axis in "xy")
    assert low == pytest.approx([92.0, 308.0])
    assert high == pytest.approx([2.0 - 40.0 - 8.0, 2.0 + 40.0 + 8.0])
    crosses = [(row["x"], row["y"]) for row in rows(chart, "words")]
    assert crosses == [(150.0, 0.0), (120.0, 0.0)]
    told = {row["word"]: (row["x"], row["y"]) for table in tables(chart, "word") for row in table}
    assert told == {"1.23 m": (120.0, 0.0), "20.00 m": (150.0, 0.0)}


def test_a_film_of_all_lasts_from_the_first_to_the_last() -> None:
    early, late = flight((3, 0, 0, 9), (20, 9, 0, 9)), flight((5, 0, 0, 9), (30, 9, 0, 9))
    shown = together_film(world(late, early, added_s=0.5))
    assert shown["spans"] == {0: (3.5, 30.0)}
    assert [of["name"] for of in shown["seen"]] == ["a", "b"]


def test_distances_are_drawn_of_the_pairs_that_came_nearest_with_their_limit() -> None:
    pairs = tuple(
        Met(f"pair {n}", np.zeros(3), 1.0, 100.0 - n, np.arange(3.0), 100.0 - n + np.arange(3.0))
        for n in range(20)
    )
    chart = described(
        separation_chart(world(flight(*BUSY), met=pairs), {"separation_min_m": 150.0})
    )
    drawn = dict.fromkeys(row["series"] for row in rows(chart, "series", "y"))
    many = len(drawn)
    assert list(drawn) == [f"pair {n}" for n in range(19, 19 - many, -1)]
    assert 8 <= many < 20
    assert chart["title"]["subtitle"] == f"the {many} pairs that came nearest"
    assert rows(chart, "name") == [{"y": 150.0, "name": "limit 150 m"}]
    some = described(separation_chart(world(flight(*BUSY), met=pairs[:many]), {}))
    assert "subtitle" not in some["title"]
    assert not tables(some, "name")
    # Two in a colour are told apart by their dashes.
    looks = [
        list(zip(*(layer["encoding"][of]["scale"]["range"] for of in ("color", "strokeDash")),
                 strict=True))
        for layer in layers(some)
        if "strokeDash" in layer["encoding"]
    ]  # fmt: skip
    assert len({str(look) for look in looks[0]}) == many


def planned(number: int, *points: tuple[float, float], start_s: float = 0.0) -> PlanRecord:
    places = np.array([(*at, 20.0 + number) for at in points])
    times_s = 10.0 * np.arange(float(len(points)))
    return PlanRecord.of_flight(number, round(start_s * 1e9), places, slot_s=times_s)


def of_rounds(*ends: tuple[float, float]) -> FlightData:
    """Rounds of 10 s that lead from place to place."""
    points = [(0.0, 0.0), *ends]
    plans = [
        planned(n + 1, points[n], points[n + 1], start_s=10.0 * n) for n in range(len(points) - 1)
    ]
    records = [
        replace(UNKNOWN_ROUND, round=n + 1, start_t_s=10.0 * n, duration_s=10.0, delivered=n,
                scheduled=5, flown_path_m=99.6)
        for n in range(len(plans))
    ]  # fmt: skip
    places = [(10.0 * n, *at, 20.0) for n, at in enumerate(points)]
    return replace(flight(*places), plans=tuple(plans), rounds=tuple(records))


def test_arrows_lead_along_each_round_at_another_share_of_it() -> None:
    run = of_rounds((100.0, 0.0), (100.0, 200.0), (0.0, 200.0), (-40.0, 170.0))
    chart = described(overview(run, "a run"))
    arrows = [(r["round"], r["x"], r["y"], r["heading"]) for r in rows(chart, "heading")]
    assert np.array(arrows) == pytest.approx(
        np.array([
            (1, 25.0, 0.0, 90.0), (2, 100.0, 250 / 3, 0.0), (3, 100 - 175 / 3, 200.0, -90.0),
            (4, -30.0, 177.5, -180.0 + math.degrees(math.atan2(40, 30))),
        ]), abs=1e-3,
    )  # fmt: skip
    words = {r["word"]: (r["x"], r["y"]) for table in tables(chart, "word") for r in table}
    assert words == {
        "home": (0, 0), "round 1 ends": (100, 0), "round 2 ends": (100, 200),
        "round 3 ends": (0, 200), "round 4 ends": (-40, 170),
    }  # fmt: skip


def test_rounds_that_end_within_fifteen_metres_share_their_words() -> None:
    for apart_m, told in ((14.9, {"rounds 1, 3 end"}), (15.1, {"round 1 ends", "round 3 ends"})):
        chart = described(overview(of_rounds((100.0, 0.0), (0, 90.0), (100.0, apart_m)), ""))
        words = {row["word"] for table in tables(chart, "word") for row in table}
        assert words == {"home", "round 2 ends", *told}
    for count, few in ((8, True), (9, False)):
        turns = [(100.0 * math.cos(n), 100.0 * math.sin(n)) for n in range(count)]
        chart = described(overview(of_rounds(*turns), ""))
        assert bool(tables(chart, "heading")) == few


def test_a_map_of_a_plan_has_its_places_and_what_became_of_them() -> None:
    places = {
        2: (0.0, 0.0, 10.0), 3: (50.0, 0.0, 20.0), 5: (50.0, 0.9, 30.0), 6: (50.0, 1.1, 30.0),
        9: (-40.0, 30.0, 30.0),
    }  # fmt: skip
    at = {seq: np.array(of) for seq, of in places.items()}
    plan = PlannedPlaces("p", at, (np.array([5.0, 6.0, 7.0]),), frozenset({2, 5}), in_holes=False)
    run = replace(of_rounds((100.0, 0.0)), planned=plan)
    for in_holes, missed in ((False, "not reached"), (True, "not reached outside holes")):
        chart = described(
            round_map(replace(run, planned=replace(plan, in_holes=in_holes)), run.plans)
        )
        found = [(r["item"], r["x"], r["y"], r["height"], r["kind"]) for r in rows(chart, "item")]
        kinds = ("reached", missed, "reached", missed, missed)
        assert found == [
            *((str(seq), *of, kind) for (seq, of), kind in zip(places.items(), kinds, strict=True)),
            ("", 5.0, 6.0, 7.0, "rally point"),
        ]
        words = {r["word"]: (r["x"], r["y"]) for table in tables(chart, "word") for r in table}
        assert words == {
            "2": (0, 0), "3, 5": (50, 0), "6": (50, 1.1), "9": (-40, 30), "home": (0, 0)
        }  # fmt: skip


def test_a_map_of_a_round_tells_its_numbers_and_its_links() -> None:
    devices = Devices(np.array([[20.0, 30.0], [60.0, 40.0], [80.0, 1.0]]), ("a", "b", "a"))
    sent = (
        uplink(1, 0, 4.0, true_x_m=40.0, true_y_m=1.0, true_per=0.25),
        uplink(1, 1, 6.0, true_x_m=60.0, true_y_m=2.0, true_per=0.75, delivered=False),
        uplink(1, 2, 8.0, true_x_m=80.0, delivered=False, late=True),
        uplink(2, 2, 14.0, true_x_m=9.0),
    )
    run = replace(of_rounds((100.0, 0.0), (100.0, 50.0)), devices=devices, uplinks=sent)
    schedule, importance = np.zeros((2, 3), dtype=bool), np.array([0.2, 0.4, 0.1])
    plans = [replace(plan, schedule=schedule, importance=importance) for plan in run.plans]
    run = replace(run, plans=tuple(plans))
    chart = described(round_map(run, run.plans[:1]))
    assert chart["title"]["text"] == "round 1 · 0 of 5 delivered · 100 m · 21 m high"
    links = [(r["x"], r["y"], r["x2"], r["y2"], r["per"], r["t_s"]) for r in rows(chart, "x2")]
    assert links == [(40, 1, 20, 30, 0.25, 4), (60, 2, 60, 40, 0.75, 6)]
    marks = [(r["device"], r["x"], r["y"], r["importance"], r["outcome"], r["per"])
             for r in rows(chart, "device", "outcome")]  # fmt: skip
    assert marks == [
        (0, 20, 30, 0.2, "delivered", 0.25), (1, 60, 40, 0.4, "lost", 0.75),
        (2, 80, 1, 0.1, "late", 0.5),
    ]  # fmt: skip
    alike = replace(run, plans=tuple(replace(plan, altitude_m=60.0) for plan in run.plans))
    assert described(round_map(alike, alike.plans[:1]))["title"]["text"].endswith("· 100 m")


def line(chart: Chart) -> dict[str, list[tuple[float, float]]]:
    found: dict[str, list[tuple[float, float]]] = {}
    for row in rows(described(chart), "series", "x"):
        found.setdefault(row["series"], []).append((row["x"], row["y"]))
    return found


def test_battery_and_wind_are_thinned_and_in_their_units() -> None:
    t_ns = np.arange(1200) * 10**8
    none = np.full(1200, math.nan)
    left = np.linspace(1.0, 0.4, 1200)
    battery = BatteryTrack(t_ns, none, none, none, left)
    vel = np.column_stack(
        (3.0 + np.arange(1200) % 3, np.full(1200, 4.0), np.arange(1200) % 3 - 1.0)
    )
    run = replace(flight(*BUSY), battery=battery, wind=WindTrack(t_ns, vel))
    charge, wind = condition_charts(run)
    (remaining,) = line(charge).values()
    expected = [(n / 10, 100 * left[n]) for n in range(0, 1200, 3)]
    assert np.array(remaining) == pytest.approx(np.array(expected), rel=1e-4)
    shown = line(wind)
    across = np.hypot(vel[:, 0], 4.0).reshape(400, 3)
    times = np.arange(400) * 0.3 + 0.1
    for name, values in (
        ("horizontal", across.mean(axis=1)), ("upward", np.zeros(400)),
        ("horizontal, most", across.max(axis=1)),
    ):  # fmt: skip
        assert np.array(shown[name]) == pytest.approx(np.column_stack((times, values)), rel=1e-4)
    few = replace(run, wind=WindTrack(t_ns[:400], vel[:400]))
    assert list(line(condition_charts(few)[1])) == ["horizontal", "upward"]
    calm = replace(few, wind=WindTrack(t_ns, 0 * vel), battery=replace(battery, remaining=none))
    assert condition_charts(calm) == []


def test_innovations_are_drawn_by_their_greatest_and_those_refused_as_points() -> None:
    t_ns = np.arange(800) * 10**8
    ratio = np.where(np.arange(800) % 8 == 3, 1.5, 0.5)
    one = InnovationTrack(t_ns, np.zeros((800, 1)), np.ones((800, 1)), ratio, ratio < 1.0)
    three = replace(one, values=np.zeros((800, 3)))
    run = replace(flight(*BUSY), innovations={"baro": one, "gnss position": three})
    first, second = estimator_charts(run)
    shown = described(first)
    assert shown["title"] == {"text": "Baro against the estimate", "subtitle": "100 refused"}
    assert described(second)["title"] == {
        "text": "GNSS position against the estimate",
        "subtitle": "of 3 axes together; 100 refused",
    }
    every = [[(r["x"], r["y"]) for r in table] for table in tables(shown, "series", "x")]
    series, refused = sorted(every, key=lambda each: -len(each))
    assert len(series) == 400
    assert [y for _, y in series] == [0.5, 1.5, 0.5, 0.5] * 100
    assert refused == [(pytest.approx(0.3 + 0.8 * n), 1.5) for n in range(100)]
    assert rows(shown, "name") == [{"y": 1.0, "name": "refused beyond"}]
