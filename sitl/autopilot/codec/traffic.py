"""Other aircraft as MAVLink tells them: ADSB_VEHICLE and UTM_GLOBAL_POSITION."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mav

from flightdyn.state import GeodeticPoint, Vector

# Altitudes are above mean sea level. A first digit of 0xF is no state's address (ICAO Annex 10).
_ICAO = 0xF00000
_SEEN = (
    mav.ADSB_FLAGS_VALID_COORDS | mav.ADSB_FLAGS_VALID_ALTITUDE | mav.ADSB_FLAGS_VALID_HEADING
    | mav.ADSB_FLAGS_VALID_VELOCITY | mav.ADSB_FLAGS_VERTICAL_VELOCITY_VALID
    | mav.ADSB_FLAGS_VALID_CALLSIGN | mav.ADSB_FLAGS_SIMULATED
)  # fmt: skip
_TOLD = (
    mav.UTM_DATA_AVAIL_FLAGS_TIME_VALID | mav.UTM_DATA_AVAIL_FLAGS_UAS_ID_AVAILABLE
    | mav.UTM_DATA_AVAIL_FLAGS_POSITION_AVAILABLE | mav.UTM_DATA_AVAIL_FLAGS_ALTITUDE_AVAILABLE
    | mav.UTM_DATA_AVAIL_FLAGS_RELATIVE_ALTITUDE_AVAILABLE
    | mav.UTM_DATA_AVAIL_FLAGS_HORIZONTAL_VELO_AVAILABLE
    | mav.UTM_DATA_AVAIL_FLAGS_VERTICAL_VELO_AVAILABLE
)  # fmt: skip
UNKNOWN = 65535  # of an accuracy


class Transponder(NamedTuple):
    """What an aircraft says of itself, by its own estimate."""

    name: str
    system: int
    time_us: int  # since 1970
    place: GeodeticPoint
    height_m: float  # above its home
    vel_ned_mps: Vector
    airborne: bool


def _adsb(said: Transponder) -> mav.MAVLink_message:
    lat, lon, alt_mm = _e7(said.place)
    north, east, down = said.vel_ned_mps.tolist()
    return mav.MAVLink_adsb_vehicle_message(
        _ICAO + said.system, lat, lon, mav.ADSB_ALTITUDE_TYPE_GEOMETRIC, alt_mm,
        round(math.degrees(math.atan2(east, north)) % 360.0 * 100.0) % 36000,
        round(math.hypot(north, east) * 100.0), round(-down * 100.0),
        said.name.encode("ascii", "replace")[:8], mav.ADSB_EMITTER_TYPE_UAV, 0, _SEEN, 0,
    )  # fmt: skip


def _utm(said: Transponder) -> mav.MAVLink_message:
    lat, lon, alt_mm = _e7(said.place)
    north, east, down = (round(speed * 100.0) for speed in said.vel_ned_mps.tolist())
    state = mav.UTM_FLIGHT_STATE_AIRBORNE if said.airborne else mav.UTM_FLIGHT_STATE_GROUND
    identity = list(said.name.encode("ascii", "replace")[:18].ljust(18, b"\0"))
    return mav.MAVLink_utm_global_position_message(
        said.time_us, identity, lat, lon, alt_mm, round(said.height_m * 1e3), north, east, down,
        UNKNOWN, UNKNOWN, UNKNOWN, 0, 0, 0, 100, state, _TOLD,
    )  # fmt: skip


def _e7(place: GeodeticPoint) -> tuple[int, int, int]:
    return round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), round(place.alt_msl_m * 1e3)


# By the names of `VehicleConfig.traffic`.
TRAFFIC: Mapping[str, Callable[[Transponder], mav.MAVLink_message]] = {"adsb": _adsb, "utm": _utm}
