"""A ULog, byte by byte: https://docs.px4.io/main/en/dev_log/ulog_file_format.html."""

import struct
from collections.abc import Mapping
from typing import Any


class UlogBytes:
    """A log of topics by name, each its fields and their format for `struct`, without the time."""

    def __init__(self, topics: Mapping[str, tuple[str, str]]) -> None:
        self._topics = {name: (n, form) for n, (name, (_, form)) in enumerate(topics.items())}
        self.content = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0))
        self.message(b"B", bytes(40))
        for name, (fields, _) in topics.items():
            self.message(b"F", f"{name}:uint64_t timestamp;{fields};".encode())
        for number, name in enumerate(topics):
            self.message(b"A", struct.pack("<BH", 0, number) + name.encode())

    def message(self, mark: bytes, data: bytes) -> None:
        """Add a message of any kind."""
        self.content.extend(struct.pack("<H", len(data)) + mark + data)

    def row(self, name: str, t_s: float, *values: Any) -> None:
        """Add a row of a topic."""
        number, form = self._topics[name]
        self.message(b"D", struct.pack(f"<HQ{form}", number, round(t_s * 1e6), *values))
