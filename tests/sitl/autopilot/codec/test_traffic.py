"""What an aircraft says of itself to others, by MAVLink's tables of units."""

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav

from flightdyn.state import GeodeticPoint
from sitl.autopilot.codec.traffic import TRAFFIC, Transponder


def said_by(kind: str, velocity: tuple[float, float, float], *, name: str = "north") -> Any:
    place = GeodeticPoint(47.3976543, -8.5456789, 528.125)
    said = Transponder(name, 3, 1_700_000_000_000_000, place, 40.5, np.array(velocity), True)
    sender = mav.MAVLink(None, srcSystem=3, srcComponent=1)
    heard: Any = mav.MAVLink(None).parse_buffer(TRAFFIC[kind](said).pack(sender))
    return heard[0].to_dict()


def test_adsb() -> None:
    assert said_by("adsb", (3.0, -4.0, -1.25)) == {
        "mavpackettype": "ADSB_VEHICLE", "ICAO_address": 0xF00003, "lat": 473976543,
        "lon": -85456789, "altitude_type": 1, "altitude": 528125, "heading": 30687,
        "hor_velocity": 500, "ver_velocity": 125, "callsign": "north", "emitter_type": 14,
        "tslc": 0, "flags": 1 | 2 | 4 | 8 | 16 | 64 | 128, "squawk": 0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("north", "east", "heading"),
    [(1, 0, 0), (0, 1, 9000), (-1, 0, 18000), (0, -1, 27000), (1, -1e-6, 0), (1, -3e-4, 35998)],
)
def test_a_heading_is_below_a_whole_turn(north: float, east: float, heading: int) -> None:
    assert said_by("adsb", (north, east, 0.0))["heading"] == heading


def test_utm() -> None:
    said = said_by("utm", (3.0, -4.0, -1.25), name="the nineteenth here")
    identity = said.pop("uas_id")
    assert bytes(identity) == b"the nineteenth her"
    assert said == {
        "mavpackettype": "UTM_GLOBAL_POSITION", "time": 1_700_000_000_000_000, "lat": 473976543,
        "lon": -85456789, "alt": 528125, "relative_alt": 40500, "vx": 300, "vy": -400, "vz": -125,
        "h_acc": 65535, "v_acc": 65535, "vel_acc": 65535, "next_lat": 0, "next_lon": 0,
        "next_alt": 0, "update_rate": 100, "flight_state": 3, "flags": 1 | 2 | 4 | 8 | 16 | 32 | 64,
    }  # fmt: skip


def test_names_are_cut_and_filled() -> None:
    assert said_by("adsb", (0, 0, 0), name="ninechars")["callsign"] == "ninechar"
    assert bytes(said_by("utm", (0, 0, 0), name="\u00e4b")["uas_id"]) == b"?b" + b"\0" * 16
