"""PX4's simulator protocol: MAVLink HIL messages, as its module simulator_mavlink reads them.

HIL_SENSOR goes out and HIL_ACTUATOR_CONTROLS comes in at every tick, so these two are packed by
hand; `tests/sitl/firmware` holds them against pymavlink.
"""

import struct
from collections.abc import Iterator
from typing import NamedTuple

from fastcrc import crc16
from pymavlink.dialects.v20 import common as mav

from flightdyn.atmosphere import altitude_m, temperature_k
from flightdyn.inertial import ImuSample
from flightdyn.sensors import BaroSample, MagSample
from flightdyn.state import GeodeticPoint, GnssFix

ACCEL_GYRO, MAG, BARO = 0x007 | 0x038, 0x1C0, 0x1A00  # bits of HIL_SENSOR.fields_updated
_LOCKSTEP = 1  # HIL_ACTUATOR_CONTROLS.flags: the firmware waits for each tick
_HEADER = struct.Struct("<BBBBBBBHB")  # of MAVLink 2; the message number is 24 bits long
_SENSOR = struct.Struct("<Q13fI")
_CONTROLS = struct.Struct("<QQ4f")
_V1, _V2 = 0xFE, 0xFD
_SYSTEM, _COMPONENT = 142, 1  # of the simulator; PX4 looks at neither
_KELVIN = 273.15
_UNKNOWN_COURSE = 65535
_SENSOR_EXTRA = mav.MAVLink_hil_sensor_message.crc_extra
_CONTROLS_ID = mav.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS
_CONTROLS_EXTRA = mav.MAVLink_hil_actuator_controls_message.crc_extra


class Controls(NamedTuple):
    """HIL_ACTUATOR_CONTROLS: duty cycles (0..1) of the four motors, all 0 while disarmed."""

    t_us: int
    lockstep: bool
    motors: tuple[float, float, float, float]  # front right, rear left, front left, rear right


class HilEncoder:
    """Sensor readings as frames."""

    def __init__(self, home: GeodeticPoint) -> None:
        self._temperature_c = temperature_k(home.alt_msl_m) - _KELVIN
        self._mav = mav.MAVLink(None, srcSystem=_SYSTEM, srcComponent=_COMPONENT)
        self._seq = 0

    def sensor(
        self, t_us: int, imu: ImuSample, baro: BaroSample | None, mag: MagSample | None
    ) -> bytes:
        """HIL_SENSOR. `t_us` becomes the firmware's clock."""
        fields = ACCEL_GYRO
        mx = my = mz = pressure_hpa = height_m = 0.0
        if mag is not None:
            fields |= MAG
            mx, my, mz = mag.field_frd_gauss
        if baro is not None:
            fields |= BARO
            pressure_hpa = baro.pressure_pa / 100
            height_m = altitude_m(baro.pressure_pa)
        p, q, r, x, y, z = imu
        payload = _SENSOR.pack(
            t_us, x, y, z, p, q, r, mx, my, mz,
            pressure_hpa, 0.0, height_m, self._temperature_c, fields,
        )  # fmt: skip
        return self._frame(mav.MAVLINK_MSG_ID_HIL_SENSOR, payload, _SENSOR_EXTRA)

    def _frame(self, number: int, payload: bytes, extra: int) -> bytes:
        self._seq = (self._seq + 1) & 0xFF
        header = _HEADER.pack(
            _V2, len(payload), 0, 0, self._seq, _SYSTEM, _COMPONENT, number & 0xFFFF, number >> 16
        )
        body = header + payload
        checksum = crc16.mcrf4xx(body[1:] + bytes((extra,)))
        return body + checksum.to_bytes(2, "little")

    def gps(self, t_us: int, fix: GnssFix, place: GeodeticPoint) -> bytes:
        """HIL_GPS: a receiver's solution, `place` its position on the globe."""
        n, e, d = (float(v) for v in fix.vel_ned_mps)
        speed = (n * n + e * e) ** 0.5
        message = mav.MAVLink_hil_gps_message(
            time_usec=t_us,
            fix_type=mav.GPS_FIX_TYPE_3D_FIX,
            lat=round(place.lat_deg * 1e7),
            lon=round(place.lon_deg * 1e7),
            alt=round(place.alt_msl_m * 1e3),
            eph=_cm(fix.std_horizontal_m),
            epv=_cm(fix.std_vertical_m),
            vel=_cm(speed),
            vn=_cm(n),
            ve=_cm(e),
            vd=_cm(d),
            cog=_UNKNOWN_COURSE,
            satellites_visible=fix.satellites,
        )
        return bytes(message.pack(self._mav))


def _cm(metres: float) -> int:
    return round(min(max(metres * 100, -32768), 32767))


class HilDecoder:
    """Finds HIL_ACTUATOR_CONTROLS in the stream; all else, whole or damaged, is passed over."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[Controls]:
        """The controls that `data` completes."""
        data = self._rest + data
        at = 0
        while True:
            while at < len(data) and data[at] not in (_V1, _V2):
                at += 1
            if at + 12 > len(data):
                break
            size = data[at + 1] + (8 if data[at] == _V1 else 12 + 13 * (data[at + 2] & 1))
            if at + size > len(data):
                break
            frame = data[at : at + size]
            at += size
            if frame[0] == _V2 and int.from_bytes(frame[7:10], "little") == _CONTROLS_ID:
                controls = _controls(frame)
                if controls is None:
                    at -= size - 1  # damaged: the next frame may begin inside of it
                else:
                    yield controls
        self._rest = data[at:]


def _controls(frame: bytes) -> Controls | None:
    end = 10 + frame[1]
    checksum = crc16.mcrf4xx(frame[1:end] + bytes((_CONTROLS_EXTRA,)))
    if checksum != int.from_bytes(frame[end : end + 2], "little"):
        return None
    payload = frame[10:end].ljust(_CONTROLS.size, b"\0")  # MAVLink 2 leaves zeros at the end out
    t_us, flags, a, b, c, d = _CONTROLS.unpack_from(payload)
    return Controls(t_us, bool(flags & _LOCKSTEP), (a, b, c, d))
