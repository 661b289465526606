"""PX4's simulator protocol: MAVLink HIL messages, as its module simulator_mavlink reads them.

HIL_SENSOR goes out and HIL_ACTUATOR_CONTROLS comes in at every tick, so these two are packed by
hand; `tests/sitl/firmware` holds them against pymavlink.
"""

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from fastcrc import crc16
from pymavlink.dialects.v20 import common as mav

from flightdyn.inertial import ImuSample
from flightdyn.physics.atmosphere import altitude_m, temperature_k
from flightdyn.physics.sensors import BaroSample, MagSample
from flightdyn.state import GeodeticPoint, GnssFix

ACCEL_GYRO, MAG, BARO = 0x007 | 0x038, 0x1C0, 0x1A00  # bits of HIL_SENSOR.fields_updated
_LOCKSTEP = 1  # HIL_ACTUATOR_CONTROLS.flags: the firmware waits for each tick
# Header of MAVLink 2, whose message number is 24 bits long, and payload.
_SENSOR = struct.Struct("<BBBBBBBHBQ13fI")
_CONTROLS = struct.Struct("<QQ4f")
_V1, _V2 = 0xFE, 0xFD
_SYSTEM, _COMPONENT = 142, 1  # of the simulator; PX4 looks at neither
_KELVIN = 273.15
_UNKNOWN_COURSE = 65535
_SENSOR_EXTRA = bytes((mav.MAVLink_hil_sensor_message.crc_extra,))
_SENSOR_ID = mav.MAVLINK_MSG_ID_HIL_SENSOR
_SENSOR_SIZE = 64  # of the payload
_CONTROLS_ID = mav.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS.to_bytes(3, "little")
_CONTROLS_EXTRA = bytes((mav.MAVLink_hil_actuator_controls_message.crc_extra,))
_CONTROLS_SIZE = 12 + 81  # of a frame: its last byte, the mode, is never zero


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
        self._seq = (self._seq + 1) & 0xFF
        body = _SENSOR.pack(
            _V2, _SENSOR_SIZE, 0, 0, self._seq, _SYSTEM, _COMPONENT, _SENSOR_ID, 0,
            t_us, x, y, z, p, q, r, mx, my, mz,
            pressure_hpa, 0.0, height_m, self._temperature_c, fields,
        )  # fmt: skip
        checksum = crc16.mcrf4xx(body[1:] + _SENSOR_EXTRA)
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

    def feed(self, data: bytes) -> Sequence[Controls]:
        """The controls that `data` completes."""
        if not self._rest and len(data) == _CONTROLS_SIZE:  # nearly always: one frame, whole
            whole = _controls(data)
            if whole is not None:
                return (whole,)
        return list(self._search(self._rest + data))

    def _search(self, data: bytes) -> Iterator[Controls]:
        at = 0
        while True:
            while at < len(data) and data[at] not in (_V1, _V2):
                at += 1
            if at + 12 > len(data):
                break
            size = data[at + 1] + (8 if data[at] == _V1 else 12 + 13 * (data[at + 2] & 1))
            if at + size > len(data):
                break
            controls = _controls(data[at : at + size])
            if controls is not None:
                yield controls
                at += size
            elif _is_controls(data, at):
                at += 1  # damaged: the next frame may begin inside of it
            else:
                at += size
        self._rest = data[at:]


def _is_controls(data: bytes, at: int) -> bool:
    return data[at] == _V2 and data[at + 7 : at + 10] == _CONTROLS_ID


def _controls(frame: bytes) -> Controls | None:
    """A whole frame as controls; None where it is another message, or damaged."""
    if not _is_controls(frame, 0):
        return None
    end = 10 + frame[1]
    checksum = crc16.mcrf4xx(frame[1:end] + _CONTROLS_EXTRA)
    if checksum != int.from_bytes(frame[end : end + 2], "little"):
        return None
    if end < 10 + _CONTROLS.size:  # MAVLink 2 leaves zeros at the end out
        frame = frame[:end].ljust(10 + _CONTROLS.size, b"\0")
    t_us, flags, a, b, c, d = _CONTROLS.unpack_from(frame, 10)
    return Controls(t_us, bool(flags & _LOCKSTEP), (a, b, c, d))
