"""ULog files, decoded and encoded: rows of numbers by topic, and lines of text.

Format: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mission.base.arrays import Ints
from mission.base.errors import InputError
from mission.flight.logs.flight import DAMAGE, LogRows

Rows: TypeAlias = NDArray[Any]  # structured; the first field is `timestamp`, in microseconds
Columns: TypeAlias = dict[str, NDArray[Any]]
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
_NUMBERS = {
    **{f"int{8 * size}_t": f"<i{size}" for size in (1, 2, 4, 8)},
    **{f"uint{8 * size}_t": f"<u{size}" for size in (1, 2, 4, 8)},
    "float": "<f4", "double": "<f8", "bool": "<i1", "char": "<i1",
}  # fmt: skip
_FIELD = re.compile(r"(\w+)(?:\[(\d{1,4})\])? ([^;\s]+)")
_MOST_NUMBERS = 1 << 17  # in the rows of all topics; PX4's have some 20,000
# Kind and first bytes of each message, behind the two bytes of its length.
_BEGINS = re.compile(
    rb"(?s)D|S/s\x13 %\x0c\xbb\x12|[LC][0-7]|F\w+:|A(?<=\x00A).{3}\w|[OR](?<=\x02\x00.)"
    rb"|B(?<=\x28\x00B)|(?:[IP]|[MQ].).(?:u?int|float|double|bool|char)"
)
_APPENDED = 1  # the one flag that is known: more data come after the end
_MAGIC = b"ULog\x01\x12\x35"
_START = _MAGIC + b"\x01"
_SIZE_OF_START = 16  # with its time
_SINCE_1970_US = 10**15  # or later a clock counts from there, as PX4's does in some simulations
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


# Layout of a topic's rows, and how long they may be: PX4 leaves out what only fills them up.
_Kind: TypeAlias = "tuple[np.dtype[Any], range]"


@dataclass(frozen=True)
class _Topic:
    name: str
    kind: "np.dtype[Any]"
    sizes: range
    rows: bytearray


def decoded(
    content: bytes, found: LogRows
) -> tuple[dict[str, Columns], dict[str, list[list[str]]]]:
    """Return the first instance of each topic in a ULog, and texts by name, each of its parts.
    Lines of text, dropouts and damage go to `found`.

    Raises:
        InputError: it does not begin as one, or asks for a reader that knows more.
    """
    if len(content) < _SIZE_OF_START or not content.startswith(_MAGIC):
        raise InputError(f"{found.path}: not a ULog: it does not begin as one")
    formats, topics, told = dict[str, str](), dict[bytes, _Topic](), dict[str, list[list[str]]]()
    last = bytes(10)  # row, of which the time comes first
    firsts, kinds, room = dict[str, _Topic](), dict[str, _Kind](), _MOST_NUMBERS
    start_us = int.from_bytes(content[len(_START) : _SIZE_OF_START], "little")

    def since_start(t_us: Any) -> Any:
        """Times by the usual clock, which begins with the flight controller."""
        late = start_us > _SINCE_1970_US
        return t_us - start_us * (t_us >= start_us) if late else t_us

    def end_of(at: int) -> int:
        size = int.from_bytes(content[at : at + 2], "little")
        if not _BEGINS.match(content, at + 2):
            return at
        if content[at + 2] == ord("D"):
            topic = topics.get(content[at + 3 : at + 5])
            if topic is None or size - 2 not in topic.sizes:
                return at
        return at + 3 + size

    for at, end in found.messages(content, _BEGINS, end_of, begin=_SIZE_OF_START, head=2):
        body = content[at + 3 : end]
        try:
            match chr(content[at + 2]):
                case "D":
                    topic, last = topics[body[:2]], body
                    t_ns = since_start(int.from_bytes(body[2:10], "little")) * 1000
                    if firsts.get(topic.name) is topic and found.counts(at, topic.name, t_ns):
                        topic.rows.extend(body[2 : 2 + topic.sizes[0]])
                case "F":
                    name, _, fields = body.decode().partition(":")
                    formats[name] = fields
                case "A":
                    name = body[3:].decode()
                    if name not in kinds:
                        kinds[name] = _kind(name, formats, room)
                        room -= len(kinds[name][0].names or ())
                    topic = topics[body[1:3]] = _Topic(name, *kinds[name], bytearray())
                    if body[0] == 0:
                        firsts.setdefault(name, topic)
                case "L" if at in found.part:
                    level, t_us = struct.unpack_from("<BQ", body)
                    text = body[9:].decode(errors="ignore").strip()
                    found.event(since_start(t_us) * 1000, "status", text, severity=level - ord("0"))
                case "I":
                    key, value = body[1 : 1 + body[0]].decode(), body[1 + body[0] :]
                    told.setdefault(key.split(" ")[1], [[value.decode(errors="ignore")]])
                case "M":
                    continued, length = body[:2]
                    parts = told.setdefault(body[2 : 2 + length].decode().split(" ")[1], [])
                    if not continued:
                        parts.append([])
                    parts[-1].append(body[2 + length :].decode(errors="ignore"))
                case "O" if at in found.part:
                    found.skipped["dropout"] += 1
                    at_us, lost_ms = (int.from_bytes(b, "little") for b in (last[2:10], body[:2]))
                    found.dropouts_s.append((since_start(at_us) / 1e6, lost_ms / 1e3))
                case "B" if body[8] & ~_APPENDED or any(body[9:16]):
                    raise InputError(f"{found.path}: a ULog with flags that nobody here knows")
        except (ValueError, LookupError, struct.error, RecursionError):
            found.skipped[DAMAGE] += end - at
    tables = {name: np.frombuffer(topic.rows, topic.kind) for name, topic in firsts.items()}
    return {
        name: {
            column: since_start(table[column]) if column.endswith("timestamp") else table[column]
            for column in table.dtype.names or ()
        }
        for name, table in tables.items()
        if len(table) and "timestamp" in (table.dtype.names or ())
    }, told


def _kind(name: str, formats: Mapping[str, str], room: int) -> _Kind:
    numbers = list(islice(_numbers(name, formats), room))
    size = np.dtype(numbers).itemsize
    while numbers[-1][0].startswith("_padding"):
        numbers.pop()
    kind = np.dtype(numbers)
    return kind, range(kind.itemsize, size + 1)


def _numbers(kind: str, formats: Mapping[str, str], name: str = "") -> Iterator[tuple[str, str]]:
    """Yield name and kind of each number in a row; nested ones are `current.lat`, `q[0]`."""
    if kind in _NUMBERS:
        yield name, _NUMBERS[kind]
        return
    fields = _FIELD.findall(formats[kind])
    if not fields:
        raise ValueError(kind)
    for inner, count, field in fields:
        for at in (f"[{n}]" for n in range(int(count))) if count else ("",):
            yield from _numbers(inner, formats, f"{name}.{field}{at}".removeprefix("."))
