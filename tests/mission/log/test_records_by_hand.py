"""Records as rows and as JSON: every kind of field, to and fro."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flightdyn.state import GeodeticPoint
from mission.base.area import Area
from mission.base.errors import InputError
from mission.log.records import (
    UNKNOWN_ROUND,
    AircraftRecord,
    TimedUplinkRecord,
    UplinkRecord,
    as_json,
    flat,
    from_json,
)
from mission.log.values import (
    Devices,
    EventRecord,
    MissionRecord,
    PlanRecord,
    SetpointRecord,
    Source,
    area_from_text,
    area_to_text,
)

NAN = math.nan
UPLINK = UplinkRecord(1, 2, "a", 3, 4.0, 5, 6, 7, 8, 9, 10, 11, 12, 0.1, 0.2, 0.3, 0.4, True)


def test_an_outcome_is_a_word() -> None:
    assert UPLINK.outcome == "delivered"
    assert replace(UPLINK, delivered=False).outcome == "lost"
    values = {name: getattr(UPLINK, name) for name in UplinkRecord.__slots__}
    for late, delivered, word in (
        (True, False, "late"),
        (False, True, "delivered"),
        (False, False, "lost"),
    ):
        timed = TimedUplinkRecord(
            **{**values, "delivered": delivered},
            ready_t_s=1.0,
            late=late,
            staleness=2,
            upload_s=3.0,
        )
        assert timed.outcome == word


def test_a_row_has_a_column_for_each_community_and_none_of_what_only_several_have() -> None:
    record = replace(UNKNOWN_ROUND, round=3, accuracy={"a": 1, "b": 0.5}, cov={"a": 2.0})
    row = flat(record)
    assert (row["round"], row["accuracy_a"], row["accuracy_b"], row["cov_a"]) == (3, 1.0, 0.5, 2.0)
    assert isinstance(row["accuracy_a"], float)
    assert "cov_b" not in row
    assert "aircraft" not in flat(UPLINK)
    assert flat(UPLINK, several=True)["aircraft"] == ""
    assert flat(replace(UPLINK, aircraft="x"))["aircraft"] == "x"
    alone = AircraftRecord.alone(replace(UNKNOWN_ROUND, round=2, flown_path_m=7.0), "x")
    assert (alone.round, alone.aircraft, alone.flown_path_m) == (2, "x", 7.0)
    assert math.isnan(alone.idle_s)
    assert not {"idle_s", "nearest", "nearest_m"} & set(flat(alone))
    assert flat(replace(alone, idle_s=0.0))["idle_s"] == 0.0
    assert UNKNOWN_ROUND.scheduled == 0
    assert math.isnan(UNKNOWN_ROUND.energy_j)


def through(record: Any, **beside: Any) -> Any:
    text = json.dumps(as_json(record)).replace("NaN", "null")
    return from_json(type(record), json.loads(text), **beside)


def test_records_come_back_from_json() -> None:
    back = through(replace(UPLINK, slot_t_s=NAN))
    assert math.isnan(back.slot_t_s)
    assert replace(back, slot_t_s=4.0) == UPLINK
    item = (0.0, 16.0, 3.0, 1.0, 2.0, NAN, 4.0, 47.0, 8.0, 20.0, 1.0)
    mission = through(MissionRecord(5, "mission", (item,)), t_ns=5)
    np.testing.assert_equal(mission.items, [item])
    event = EventRecord(1, "reached", "x", 4, 6, (1.0, 2.0, NAN), (4.0, 5.0, 6.0))
    np.testing.assert_equal(through(event, t_ns=1).true_m, (1.0, 2.0, NAN))
    assert through(event, t_ns=1).seq == 4
    assert through(replace(event, seq=None), t_ns=1).seq is None
    world = Devices(np.array([[1.0, 2.0], [3.0, 4.0]]), ("a", "b"))
    assert through(world).pos_m.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert through(world).community == ("a", "b")
    sent = through(SetpointRecord(1, "X", None, 7, (1.0, NAN)), t_ns=1)
    assert (sent.frame, sent.mask) == (None, 7)
    np.testing.assert_equal(sent.values, (1.0, NAN))
    plan = PlanRecord.of_flight(1, 2, np.array([[0.0, 0, 0], [3, 4, 0]]), slot_s=np.array([0.0, 5]))
    told = as_json(replace(plan, schedule=np.array([[False, True], [True, False]])))
    assert told["schedule"] == [[0, 1], [1, 0]]
    assert told["stops_at"] == [0, 1]


@pytest.mark.parametrize(
    ("record", "changes"),
    [
        (UPLINK, {"round": 1.5}), (UPLINK, {"device": "2"}), (UPLINK, {"community": 5}),
        (MissionRecord(5, "mission", ()), {"items": [[0.0] * 10]}),
        (MissionRecord(5, "mission", ()), {"items": [[0.0] * 12]}),
        (MissionRecord(5, "mission", ()), {"items": [[0.0, None, *[0.0] * 9]]}),
        (MissionRecord(5, "mission", ()), {"items": [[0.0, 0.0, None, *[0.0] * 8]]}),
        (EventRecord(1, "a", "b", 1, 6, (0, 0, 0), (0, 0, 0)), {"seq": 1.5}),
        (EventRecord(1, "a", "b", 1, 6, (0, 0, 0), (0, 0, 0)), {"true_m": [1.0, 2.0]}),
    ],
)  # fmt: skip
def test_a_row_of_another_kind_is_refused(record: Any, changes: dict[str, Any]) -> None:
    row = json.loads(json.dumps(as_json(record))) | changes
    with pytest.raises((TypeError, ValueError, IndexError)):
        from_json(type(record), row, **({} if record is UPLINK else {"t_ns": 1}))
    with pytest.raises(KeyError):
        from_json(type(record), {}, t_ns=1)


def test_devices_are_as_many_as_their_communities() -> None:
    world = Devices(np.zeros((3, 2)), ("b", "a", "b"))
    assert world.communities == ("b", "a")
    assert world.community_of.tolist() == [0, 1, 0]
    for shape in ((2, 2), (3, 3)):
        with pytest.raises(ValueError, match="pos_m has shape"):
            Devices(np.zeros(shape), ("b", "a", "b"))


def test_an_area_comes_back_from_the_metadata_of_a_log() -> None:
    area = Area.at((400.5, 300.25), (100.0, 50.0), GeodeticPoint(47.123456789, -8.0, 500.0))
    told = area_to_text(area)
    back = area_from_text(told)
    assert (back.size_m, back.home_m, back.home) == (area.size_m, area.home_m, area.home)
    for key, value in (("size_m", "[1, 2, 3]"), ("home_m", "5"), ("home", "{}")):
        with pytest.raises((TypeError, ValueError)):
            area_from_text({**told, key: value})
    nowhere = json.dumps({"lat_deg": 91, "lon_deg": 0, "alt_msl_m": 0})
    with pytest.raises(InputError):
        area_from_text({**told, "home": nowhere})


def test_only_places_on_the_globe_are_on_it() -> None:
    on = [
        Source("x", "y", only).on_globe for only in (None, "true", "believed", "local", "heights")
    ]
    assert on == [True, True, True, False, False]
