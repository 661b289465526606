"""The film of a map, of flights whose every place is given."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bare_flight import bare_flight

from mission.figures.film import Actor, film
from mission.figures.style import BAD, GOOD
from mission.log.records import TimedUplinkRecord
from mission.log.values import Devices, EventRecord, FlightData
from mission.report.page import _spans_s

NOWHERE = (0.0, 0.0, 0.0)


def eastwards() -> FlightData:
    """At 1 m/s for ten seconds, 20 m high, with what a vehicle says on the way."""
    t_s = np.arange(0.0, 10.01, 0.1)
    said = (
        EventRecord(2_000_000_000, "mode", "mission", None, 6, NOWHERE, NOWHERE),
        EventRecord(4_000_000_000, "reached", "item 1", 1, 6, NOWHERE, NOWHERE),
    )
    places = np.column_stack((t_s, 0.0 * t_s, 0.0 * t_s + 20.0))
    return replace(bare_flight(t_s, places), events=said)


def serving(run: FlightData) -> FlightData:
    """The same in a round of four devices: one is heard, one is lost, one late, one not reached."""

    def sent(device: int, slot_t_s: float, *, delivered: bool = False, late: bool = False):
        return TimedUplinkRecord(
            round=1, device=device, community="a", step=0, slot_t_s=slot_t_s, plan_x_m=0.0,
            plan_y_m=0.0, est_x_m=0.0, est_y_m=0.0, est_alt_m=0.0, true_x_m=0.0, true_y_m=0.0,
            true_alt_m=0.0, plan_per=0.5, est_per=0.5, true_per=0.5, importance=1.0,
            delivered=delivered, ready_t_s=0.0, late=late, staleness=0, upload_s=0.0,
        )  # fmt: skip

    places = np.array([(1.0, 10.0), (2.0, 20.0), (3.0, 30.0), (4.0, 40.0)])
    uplinks = sent(2, 6.0, late=True), sent(0, 5.0, delivered=True), sent(1, 5.5), sent(3, math.nan)
    return replace(run, devices=Devices(places, ("a",) * 4), uplinks=uplinks)


def test_places_are_those_at_even_times_while_it_flies() -> None:
    run = eastwards()
    shown = film([Actor(run, run.truth)], {0: (0.0, 12.0)})
    assert (shown["from"], shown["step"]) == (0.0, 0.5)
    ((one,),) = (shown["seen"],)
    flown = [[step / 2, 0.0, 20.0] for step in range(21)]
    assert one["places"] == [*flown, None, None, None, None]
    assert film([Actor(run, run.truth)], {0: (0.0, 7200.0)})["step"] == 2.0  # 3600 at most
    assert film([Actor(run, run.truth)], {1: (900.0, 950.0), 2: (400.0, 4000.0)})["step"] == 1.0


@pytest.mark.parametrize("name", ["", "b"])
def test_news_of_a_flight_are_what_it_said_and_of_a_round_who_was_heard(name: str) -> None:
    run = eastwards()
    who = f"{name}: " if name else ""

    def news(of: FlightData, until_s: float = 20.0) -> list[object]:
        return list(film([Actor(of, of.truth, name, added_s=3.0)], {0: (0.0, until_s)})["news"])

    mode = (5.0, f"{who}mission", None, None, "")
    assert news(run) == [mode, (7.0, f"{who}item 1", None, None, "")]
    assert news(run, until_s=6.9) == [mode]
    assert news(serving(run)) == [
        mode,
        (8.0, f"{who}device 0 heard", 1.0, 10.0, GOOD),
        (8.5, f"{who}device 1 lost", 2.0, 20.0, BAD),
        (9.0, f"{who}device 2 late", 3.0, 30.0, BAD),
    ]


def test_nobody_is_seen_in_a_hole_of_the_log() -> None:
    run = eastwards()
    known = run.truth.t_ns[(run.truth.t_ns <= 3_000_000_000) | (run.truth.t_ns >= 7_000_000_000)]
    holed = replace(run, truth=run.truth.at(known), source=replace(run.source, kind="ULog"))
    seen = film([Actor(holed, run.truth, added_s=1.0)], {0: (0.0, 10.0)})["seen"][0]["places"]
    assert [n / 2 for n, place in enumerate(seen) if place is None] == np.arange(
        4.5, 8, 0.5
    ).tolist()


def test_it_lasts_as_long_as_each_round_or_as_the_flight() -> None:
    run = SimpleNamespace(data=bare_flight([5.0, 6.0, 9.0], np.zeros((3, 3))))
    found: Any = SimpleNamespace(measured=[], flown=None, run=run)
    assert _spans_s(found) == {0: (5.0, 9.0)}
    found.flown = SimpleNamespace(start_s=6.5, end_s=8.0)
    assert _spans_s(found) == {0: (6.5, 8.0)}
    found.measured = [
        SimpleNamespace(record=SimpleNamespace(round=n, start_t_s=10.0 * n, duration_s=4.0))
        for n in (1, 2)
    ]
    assert _spans_s(found) == {1: (10.0, 14.0), 2: (20.0, 24.0)}
