"""Encoding of ULog files: rows of numbers by topic, and lines of text, in order of time.

Format: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

import struct
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mission.base.arrays import Ints

Rows: TypeAlias = NDArray[Any]  # structured; the first field is `timestamp`, in microseconds
Line: TypeAlias = tuple[int, int, str]  # t_ns, MAV_SEVERITY, text

_TYPES = {
    "|b1": "bool",
    "|u1": "uint8_t",
    "<u2": "uint16_t",
    "<i4": "int32_t",
    "<u8": "uint64_t",
    "<f4": "float",
    "<f8": "double",
}
# Of the fields that PX4 does not keep as flags, bytes and single precision.
_KINDS = {
    **dict.fromkeys(("timestamp", "timestamp_sample", "nav_state_timestamp"), "<u8"),
    **dict.fromkeys(("lat", "lon", "ref_lat", "ref_lon"), "<f8"),
    **dict.fromkeys(("latitude_deg", "longitude_deg", "altitude_msl_m"), "<f8"),
    **dict.fromkeys(("seq_current", "seq_total"), "<u2"),
    "seq_reached": "<i4",
}
_BY_KIND: dict[str, Any] = {"b": "|b1", "u": "|u1", "i": "|u1", "f": "<f4"}
_PARTS = {"current": "position_setpoint"}  # types of fields that are rows
_START = b"ULog\x01\x12\x35\x01"
_HEADER = struct.Struct("<HB")
_MOST_TEXT = 60_000  # that fits a message


def rows(t_ns: Ints, **columns: Any) -> Rows:
    """Build a topic's rows from columns: (n,) or (n, k) values, a value for all, or nested rows."""
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    kinds = [
        (name, _KINDS.get(name) or _BY_KIND.get(values.dtype.kind, values.dtype), values.shape[1:])
        for name, values in arrays.items()
    ]
    table = np.zeros(len(t_ns), dtype=[("timestamp", "<u8"), *kinds])
    table["timestamp"] = np.asarray(t_ns) // 1000
    for name, values in arrays.items():
        table[name] = values
    return table


def ulog(
    topics: Mapping[str, Rows], lines: Sequence[Line], told: Sequence[tuple[str, str]] = ()
) -> bytes:
    """Encode a ULog file, without empty topics; `told`: names and texts of information messages."""
    topics = {name: table for name, table in topics.items() if len(table)}
    formats: dict[str, str] = {}
    for name, table in topics.items():
        _declare(name, table.dtype, formats)
    records = [
        (t_us, _record("D", struct.pack("<H", number) + row.tobytes()))
        for number, table in enumerate(topics.values())
        for t_us, row in zip(table["timestamp"].tolist(), table, strict=True)
    ]
    for t_ns, severity, text in lines:
        start = struct.pack("<BQ", ord("0") + severity, t_ns // 1000)
        records.append((t_ns // 1000, _record("L", start + text.encode())))
    records.sort(key=lambda record: record[0])
    head = [_record("B", bytes(40))]  # no flags
    head += [_record("F", f"{name}:{fields}".encode()) for name, fields in formats.items()]
    head.append(_record("I", b"\x10char[7] sys_nameAerofed"))
    # GNSS in degrees and metres, as since PX4 1.14.
    head.append(_record("I", b"\x18uint32_t ver_data_format" + struct.pack("<I", 2)))
    for name, text in told:
        for begin in range(0, len(text), _MOST_TEXT):
            part = text[begin : begin + _MOST_TEXT]
            key = f"char[{len(part)}] {name}"
            head.append(
                _record("M", struct.pack("<BB", begin > 0, len(key)) + (key + part).encode())
            )
    for number, name in enumerate(topics):
        head.append(_record("A", struct.pack("<BH", 0, number) + name.encode()))
    start_us = struct.pack("<Q", records[0][0] if records else 0)
    return b"".join([_START, start_us, *head, *(data for _, data in records)])


def _declare(name: str, kind: "np.dtype[Any]", formats: dict[str, str]) -> None:
    """Add the format of a topic, after those of the rows in it."""
    fields = []
    for field in kind.names or ():
        part = kind[field]
        if part.names:
            _declare(_PARTS[field], part, formats)
            fields.append(f"{_PARTS[field]} {field};")
        else:
            size = "".join(f"[{length}]" for length in part.shape)
            fields.append(f"{_TYPES[part.base.str]}{size} {field};")
    formats[name] = "".join(fields)


def _record(kind: str, data: bytes) -> bytes:
    return _HEADER.pack(len(data), ord(kind)) + data
