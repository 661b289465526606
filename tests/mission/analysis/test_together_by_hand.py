"""Flights put into one frame and on one clock, of tracks that are given; no file is read."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pymap3d
import pytest
from bare_flight import bare_flight

from flightdyn.state import GeodeticPoint
from mission.analysis.together import Together, together
from mission.base.area import Area
from mission.base.errors import InputError
from mission.log.values import EventRecord, Modes, PlanRecord, Source

NOT_FLOWN = {"config.toml": b"[mission]\nflight = 'none'\n"}  # so that all of it is in the air
HOME = GeodeticPoint(47.0, 8.0, 400.0)
# 60 m to the north and 20 m lower.
_LAT, _LON, _ = pymap3d.ned2geodetic(60.0, 0.0, 0.0, 47.0, 8.0, 400.0)
OTHER = GeodeticPoint(_LAT, _LON, 380.0)
T_S = np.arange(0.0, 40.25, 0.25)


def flight(name: str, *, east_m: float = 0.0, north_m: float = 0.0, up_m: float = 30.0,
           pace_mps: float = 5.0, home: GeodeticPoint = HOME, home_m: tuple[float, float] = (0, 0),
           **more: Any) -> Any:  # fmt: skip
    """To the east from so far east of its home, on its own clock."""
    places = np.column_stack(
        (east_m + home_m[0] + pace_mps * T_S, 0 * T_S + north_m + home_m[1], 0 * T_S + up_m)
    )
    data = replace(
        bare_flight(T_S, places), area=Area.at((500.0, 500.0), home_m, home),
        attachments=NOT_FLOWN, **more,
    )  # fmt: skip
    run = SimpleNamespace(data=data, path=Path(f"/logs/{name}.mcap"))
    return SimpleNamespace(run=run)


def changed(of: Any, **more: Any) -> Any:
    run = SimpleNamespace(data=replace(of.run.data, **more), path=of.run.path)
    return SimpleNamespace(run=run)


def pair() -> tuple[Any, Any]:
    """The second one flies towards the first one's start; 3 m to the north and 4 m above."""
    one = flight("a", home_m=(100.0, 50.0))
    other = flight("b", east_m=200.0, north_m=-57.0, up_m=54.0, pace_mps=-5.0, home=OTHER)
    return one, other


def test_all_are_in_an_area_with_fifty_metres_around_and_the_home_of_the_first() -> None:
    world = together(pair())
    assert world.names == ("a.mcap", "b.mcap")
    assert (world.added_s, world.by) == ((0.0, 0.0), ("simulated time",) * 2)
    assert world.area.home == HOME
    assert world.area.size_m == pytest.approx((300.0, 103.0), abs=0.05)
    assert world.area.home_m == pytest.approx((50.0, 50.0), abs=0.05)
    first, second = (track.pos_m for track in world.tracks)
    assert first[0] == pytest.approx([50.0, 50.0, 30.0], abs=0.05)
    assert second[0] == pytest.approx([250.0, 53.0, 34.0], abs=0.05)
    assert second[-1] == pytest.approx([50.0, 53.0, 34.0], abs=0.05)
    (row,) = world.rows
    assert row["separation_min_m"] == pytest.approx(5.0, abs=0.02)
    assert row["separation_horizontal_min_m"] == pytest.approx(3.0, abs=0.02)
    assert row["separation_vertical_min_m"] == pytest.approx(4.0, abs=0.02)
    assert row["separation_min_t_s"] == pytest.approx(20.0, abs=0.02)
    assert row["known_s"] == 40.0
    assert math.isnan(float(str(row["plan_separation_min_m"])))
    lat, lon, _ = pymap3d.ned2geodetic(
        1.5, 100.0, -32.0, HOME.lat_deg, HOME.lon_deg, HOME.alt_msl_m
    )
    assert row["separation_min_lat_deg"] == pytest.approx(lat, abs=1e-6)
    assert row["separation_min_lon_deg"] == pytest.approx(lon, abs=1e-6)
    assert row["separation_min_height_m"] == pytest.approx(32.0, abs=0.02)
    (met,) = world.met
    assert (met.t_s, met.away_m) == pytest.approx((20.0, 5.0), abs=0.02)
    assert met.at_m == pytest.approx([150.0, 51.5, 32.0], abs=0.05)
    assert world.on_map(np.array([[100.0, 50.0]])) == pytest.approx(
        np.array([[50.0, 50.0]]), abs=0.05
    )
    of_run = together(pair(), of_run=True)  # in the area of the run's tables
    assert of_run.area.size_m == (500.0, 500.0)
    assert of_run.tracks[0].pos_m[0] == pytest.approx([100.0, 50.0, 30.0])


def told_utc(of: Any, utc_s: float | None) -> Any:
    utc_ns = None if utc_s is None else round(utc_s * 1e9)
    return changed(of, source=Source("ULog", "since boot", utc_ns=utc_ns))


def test_clocks_are_known_by_utc_or_by_what_is_told() -> None:
    one, other = pair()
    world = together([told_utc(one, 1000.0), told_utc(other, 996.5)])
    assert (world.added_s, world.by[1]) == ((0.0, -3.5), "UTC")
    assert world.tracks[1].t_ns[0] == -3_500_000_000
    # The second one is 3.5 s ahead: they meet in half of that, and 17.5 m of the way farther on.
    assert world.rows[0]["separation_min_t_s"] == pytest.approx(20.0 - 1.75, abs=0.02)
    assert "b.mcap: -3.500 s on the clock of a.mcap, by UTC" in list(world.lines)
    for key in ("b.mcap", "/logs/b.mcap"):
        told = together([told_utc(one, 1000.0), told_utc(other, None)], {key: 2.0})
        assert (told.added_s, told.by[1]) == ((0.0, 2.0), "--offset")
    for offsets, why in (
        ({"c": 1.0}, r"--offset c: no such log \(there are: a\.mcap, b\.mcap\)"),
        ({"b.mcap": math.inf}, "--offset b.mcap=inf: must be a number"),
        ({}, "b.mcap: its clock cannot be aligned with that of a.mcap"),
    ):
        with pytest.raises(InputError, match=why):
            together([told_utc(one, 1000.0), told_utc(other, None)], offsets)
    external = {"config.toml": NOT_FLOWN["config.toml"] + b"[link]\nkind = 'external'\n"}
    with pytest.raises(InputError, match="its clock cannot be aligned"):
        together([one, changed(other, attachments=external)])


@pytest.mark.parametrize(("far_m", "of_one_place"), [(4990.0, True), (5010.0, False)])
def test_flights_farther_apart_than_five_kilometres_are_of_other_places(
    far_m, of_one_place
) -> None:
    one, other = flight("a"), flight("b", east_m=200.0 + far_m)
    if of_one_place:
        assert len(together([one, other]).pairs) == 1
        return
    with pytest.raises(InputError, match=r"b\.mcap: 5\.0 km from a\.mcap: flights of other places"):
        together([one, other])
    assert len(together([one, other], at_once=True).pairs) == 1  # they were flown at once


def test_flights_of_other_times_are_not_together() -> None:
    one, other = pair()
    with pytest.raises(InputError, match="in the air when none of the others is"):
        together([one, other], {"b.mcap": 40.0})
    assert together([one, other], {"b.mcap": 39.0}).rows[0]["known_s"] == pytest.approx(1.0)
    third = together([one, other, flight("c")], {"c.mcap": 90.0}, at_once=True)
    assert [(p.first, p.second) for p in third.pairs] == [(0, 1)]
    never = [line for line in third.lines if "never in the air" in line]
    assert never == [
        f"{both} and c.mcap: never in the air at the same time" for both in ("a.mcap", "b.mcap")
    ]


def test_a_wreck_is_said_with_its_cause_and_a_hole_with_what_is_known() -> None:
    here = (0.0, 0.0, 0.0)
    one, other = pair()
    said = (EventRecord(30 * 10**9, "status", "hit a wall", None, 2, here, here),
            EventRecord(30 * 10**9, "status", "chatter", None, 3, here, here))  # fmt: skip
    modes = Modes(np.array([0, 30 * 10**9]), ("HOLD", "TERMINATED"))
    wreck = changed(one, events=said[::-1], modes=modes)
    kept = (T_S <= 16.0) | (T_S >= 24.0)
    track = other.run.data.truth
    holed = changed(other, truth=track.at(track.t_ns[kept]))
    world: Together = together([wreck, holed])
    later = together([other, wreck], {"a.mcap": 3.0}, at_once=True)
    assert next(later.lines) == "a.mcap: lost at 33.0 s: hit a wall"
    lines = list(world.lines)
    assert lines[0] == "a.mcap: lost at 30.0 s: hit a wall"
    assert lines[-1].startswith(
        "a.mcap and b.mcap: no positions of one of them at 16.0-24.0 s: how near they came is not "
        "known; 40.31 m at "
    )
    (row,) = world.rows
    assert math.isnan(float(str(row["separation_min_m"])))
    assert row["known_s"] == 32.0


def test_plans_are_compared_while_both_are_on_one() -> None:
    """As planned they pass 12 m apart, 4 m above each other, a second later than they are flown."""
    one, other = pair()

    def plan(of: Any, *points: tuple[float, float, float]) -> Any:
        slots = np.array([0.0, 40.0])
        return changed(of, plans=(PlanRecord.of_flight(1, 10**9, np.array(points), slot_s=slots),))

    world = together([
        plan(one, (100.0, 50.0, 30.0), (300.0, 50.0, 30.0)),
        plan(other, (200.0, -48.0, 54.0), (0.0, -48.0, 54.0)),
    ])  # fmt: skip
    (row,) = world.rows
    assert row["plan_separation_min_m"] == pytest.approx(math.hypot(12.0, 4.0), abs=0.02)
    assert row["plan_separation_horizontal_min_m"] == pytest.approx(12.0, abs=0.02)
    assert row["plan_separation_min_t_s"] == pytest.approx(21.0, abs=0.02)
    (path,), (second,) = world.plans
    a, b = world.seen
    assert (a.name, a.track, a.plans, b.name) == ("a.mcap", world.tracks[0], (path,), "b.mcap")
    assert a.colour != b.colour
    assert path == pytest.approx(np.array([(50, 50, 30), (250, 50, 30)]), abs=0.05)
    assert second[0] == pytest.approx([250.0, 62.0, 34.0], abs=0.05)
