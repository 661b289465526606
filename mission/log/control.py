"""Encoding and decoding of `/control`, the estimates and setpoints of the control: a fixed layout.

A message is `ControlTrack`'s fields of one instant, each a packed list of single-precision numbers,
so that all messages of a flight are rows of equal length, made and read many at once.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

from mission.base.area import Area
from mission.base.arrays import Floats, Ints
from mission.base.tables import annotated
from mission.log.signals import Signal, euler_deg
from mission.log.values import NS_PER_S, ControlTrack, Track

NAME = "aerofed.Control"
_AXES = dict(annotated(ControlTrack, tuple))  # names of each field's numbers
# Before the numbers of a field stand its tag, a packed list, and how many bytes they are.
_HEADS = {f"{name} head": (n << 3 | 2, 4 * len(_AXES[name])) for n, name in enumerate(_AXES, 1)}
_ROW = np.dtype(
    [
        part
        for name, axes in _AXES.items()
        for part in ((f"{name} head", "u1", 2), (name, "<f4", len(axes)))
    ]
)
_BEGINS = np.cumsum([0, *map(len, _AXES.values())]).tolist()[:-1]
_EMPTY = np.zeros(1, _ROW)
for _name, _head in _HEADS.items():
    _EMPTY[_name] = _head
# Which column of the aircraft's row each number is, and its sign; in quaternions, FRD -> NED
# (w, x, y, z) as FLU -> ENU (x, y, z, w), a second one is added: see `messages.area_pose`.
_COLUMNS = [2, 2, 1, 1, *range(5, 8), 9, 9, 8, 8, *range(12, 15), 15, *range(16, 20)]
_COLUMNS += [21, 20, 22, 24, 23, 25, 27, 26, 28, 29, 30]
_SIGNS = np.array([1, 1, 1, 1, 1, -1, -1] * 2 + [1] * 5 + [1, 1, -1] * 3 + [-1, -1], np.float64)
_QUATERNIONS, _SECOND = [0, 1, 2, 3, 7, 8, 9, 10], [3, 3, 4, 4, 10, 10, 11, 11]
_SECOND_SIGNS = np.array([1.0, -1.0, -1.0, 1.0] * 2)
_PLACE, _YAW = slice(19, 22), 28  # what does not begin at zero
_GRID = 2.0**13  # far below what any sensor tells apart; the zeroed bits compress


def schema() -> bytes:
    """Return the schema of a `/control` message as a serialized protobuf FileDescriptorSet."""
    field = FieldDescriptorProto(label="LABEL_REPEATED", type="TYPE_FLOAT")
    message = DescriptorProto(name=NAME.split(".")[1])
    for number, name in enumerate(_AXES, 1):
        field.name, field.number = name, number
        message.field.append(field)
    file = FileDescriptorProto(
        name=NAME, package="aerofed", syntax="proto3", message_type=[message]
    )
    return bytes(FileDescriptorSet(file=[file]).SerializeToString())


def messages(area: Area, rows: Floats) -> Iterator[tuple[int, bytes]]:
    """Time (ns) and message of each row (n, 31) of `flightdyn.native.library.Trace`."""
    numbers = rows[:, _COLUMNS] * _SIGNS
    second = rows[:, _SECOND] * _SECOND_SIGNS
    numbers[:, _QUATERNIONS] = (numbers[:, _QUATERNIONS] + second) * math.sqrt(0.5)
    numbers[:, _PLACE] += area.xyz(np.zeros(3))
    numbers[:, _YAW] += math.pi / 2
    numbers = np.rint(numbers * _GRID) / _GRID
    made = np.repeat(_EMPTY, len(rows))
    for name, begin in zip(_AXES, _BEGINS, strict=True):
        made[name] = numbers[:, begin : begin + len(_AXES[name])]
    data, size = made.tobytes(), _ROW.itemsize
    for index, t_ns in enumerate(rows[:, 0].tolist()):
        yield int(t_ns), data[index * size : (index + 1) * size]


def track(t_ns: Ints, found: Sequence[bytes]) -> ControlTrack:
    """Decode `/control` messages, `found`, of the times `t_ns` (n,).

    Raises:
        ValueError: a message is of another layout.
    """
    made = np.frombuffer(b"".join(found), _ROW)
    if any((made[name] != head).any() for name, head in _HEADS.items()):
        raise ValueError("/control is of another layout")
    return ControlTrack(t_ns, **{name: made[name].astype(np.float64) for name in _AXES})


def ned_attitude(turns: Floats) -> Floats:
    """Convert attitudes (n, 4), FLU to ENU as (x, y, z, w), to FRD to NED as (w, x, y, z)."""
    x, y, z, w = turns.reshape(-1, 4).T
    turned = np.column_stack((w + z, x + y, x - y, w - z))
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def signals(area: Area, found: ControlTrack, belief: Track) -> dict[str, Signal]:
    """What the control was told and what it did, as it believed."""
    frd, ned = np.degrees([1.0, -1.0, -1.0]), np.array([1.0, 1.0, -1.0])
    place, here = found.position_setpoint_m, belief.pos_m
    here_ned = area.to_ned(here[:, :2], here[:, 2])
    by_name = {
        "wanted_position_m": area.to_ned(place[:, :2], place[:, 2]),
        "wanted_velocity_mps": found.velocity_setpoint_mps[:, [1, 0, 2]] * ned,
        "wanted_attitude_deg": euler_deg(ned_attitude(found.attitude_setpoint)),
        "attitude_deg": euler_deg(ned_attitude(found.attitude)),
        "wanted_rates_degps": found.rates_setpoint_radps * frd,
        "rates_degps": found.rates_radps * frd,
        "motors": found.motors,
    }
    t_s, at_s = found.t_ns / NS_PER_S, belief.t_ns / NS_PER_S
    made = {name: Signal(t_s, values) for name, values in by_name.items()}
    if len(at_s) > 1:
        made["position_m"] = Signal(at_s, here_ned)
        made["velocity_mps"] = Signal(at_s, np.gradient(here_ned, at_s, axis=0))
    return {name: each for name, each in made.items() if np.isfinite(each.values).any()}
