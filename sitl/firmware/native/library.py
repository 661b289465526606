"""The C interface of the bridges (`bridge.h`): what is sent and read lies in structures here.

A call releases Python's lock, since it may wait for the firmware.
"""

import ctypes
import struct

from native.building import library
from native.loading import load

_INT, _LONG, _UNSIGNED, _DOUBLE = ctypes.c_int, ctypes.c_int64, ctypes.c_uint64, ctypes.c_double
_POINTER, _BYTES = ctypes.c_void_p, ctypes.c_char_p

# What came of a call. ORDERED: the motors are what the firmware wants for the next tick; GONE: it
# has hung up; FREE_RUNNING: its clock is not ours; FOREIGN: it speaks another protocol.
NOTHING, ORDERED, GONE, FREE_RUNNING, FOREIGN = range(5)


class _HilSensor(ctypes.Structure):
    _fields_ = (
        ("t_us", _UNSIGNED), ("rates", _DOUBLE * 3), ("forces", _DOUBLE * 3),
        ("field_gauss", _DOUBLE * 3), ("pressure_hpa", _DOUBLE), ("height_m", _DOUBLE),
        ("temperature_c", _DOUBLE), ("fields", _UNSIGNED),
    )  # fmt: skip


class Hil(ctypes.Structure):
    """PX4 behind a TCP connection; `sensor` is what the next frame says."""

    _fields_ = (
        ("sensor", _HilSensor), ("motors", _DOUBLE * 4), ("sent_us", _UNSIGNED),
        ("answered_us", _UNSIGNED), ("socket", _LONG), ("error", _LONG), ("sequence", _LONG),
        ("size", _LONG), ("stream", ctypes.c_uint8 * 4096),
    )  # fmt: skip


class Json(ctypes.Structure):
    """ArduPilot behind a connected UDP socket; `t_s` to `attitude` are what the next reply says."""

    _fields_ = (
        ("t_s", _DOUBLE), ("rates", _DOUBLE * 3), ("forces", _DOUBLE * 3),
        ("position", _DOUBLE * 3), ("velocity", _DOUBLE * 3), ("attitude", _DOUBLE * 3),
        ("motors", _DOUBLE * 4), ("count", _LONG), ("socket", _LONG), ("length", _LONG),
        ("magic", _LONG), ("size", _LONG), ("reply", ctypes.c_uint8 * 1024),
    )  # fmt: skip


# Many numbers into a structure at once, from its beginning, in a tenth of the time that its fields
# take one by one.
put_inertial = struct.Struct("@Q6d").pack_into  # t_us, rates, forces
put_state = struct.Struct("@16d").pack_into  # t_s to attitude
get_motors = struct.Struct("@4d").unpack_from

# Of a structure, which has to outlive its use.
address_of = ctypes.addressof

_LIBRARY = load(library("bridge"))
# Each takes the address of its structure; `hil_send` a payload of HIL_GPS, too, or None.
hil_wait = ctypes.CFUNCTYPE(_INT, _POINTER, _INT)(("hil_wait", _LIBRARY))
hil_send = ctypes.CFUNCTYPE(_INT, _POINTER, _BYTES)(("hil_send", _LIBRARY))
json_wait = ctypes.CFUNCTYPE(_INT, _POINTER)(("json_wait", _LIBRARY))
json_send = ctypes.CFUNCTYPE(None, _POINTER)(("json_send", _LIBRARY))
json_repeat = ctypes.CFUNCTYPE(None, _POINTER)(("json_repeat", _LIBRARY))
