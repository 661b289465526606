"""Payloads of PX4's simulator protocol, as its module simulator_mavlink reads them.

The messages of every tick, HIL_SENSOR and HIL_ACTUATOR_CONTROLS, and the frames round all of them
are written and read in C (`sitl.firmware.native`).
"""

import struct

from flightdyn.state import GeodeticPoint, GnssFix

MAG, BARO = 0x1C0, 0x1A00  # bits of HIL_SENSOR.fields_updated
_GPS = struct.Struct("<QiiiHHHhhhHBB")
_FIX_3D = 3
_UNKNOWN_COURSE = 65535


def gps_payload(t_us: int, fix: GnssFix, place: GeodeticPoint) -> bytes:
    """HIL_GPS at a time of PX4's clock, `place` being the solution's on the globe."""
    n, e, d = fix.vel_ned_mps.tolist()
    return _GPS.pack(
        t_us,
        round(place.lat_deg * 1e7),
        round(place.lon_deg * 1e7),
        round(place.alt_msl_m * 1e3),
        _unsigned_cm(fix.std_horizontal_m),
        _unsigned_cm(fix.std_vertical_m),
        _unsigned_cm((n * n + e * e) ** 0.5),
        _cm(n),
        _cm(e),
        _cm(d),
        _UNKNOWN_COURSE,
        _FIX_3D,
        min(fix.satellites, 254),  # 255: not known
    )


def _cm(metres: float) -> int:
    return round(min(max(metres * 100, -32768), 32767))


def _unsigned_cm(metres: float) -> int:
    return round(min(metres * 100, 65534))  # 65535: not known
