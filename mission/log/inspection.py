"""What is in a log, whether it is sound, and where two logs differ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from mcap.records import Message

from mission.log.contents import Contents, load
from mission.log.values import NS_PER_S

_SHOWN = 5  # differences or findings of one kind that are spelled out


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """Name, schema, message count and time range (simulated seconds) of one topic."""

    name: str
    schema: str
    messages: int
    start_s: float
    end_s: float

    @property
    def rate_hz(self) -> float:
        """Mean rate between the first and the last message; 0 for fewer than two."""
        span = self.end_s - self.start_s
        return (self.messages - 1) / span if span > 0 else 0.0


@dataclass(frozen=True)
class LogInfo:
    """Summary of a log: size, time range (simulated seconds), topics, metadata and attachments."""

    path: Path
    size_bytes: int
    start_s: float
    end_s: float
    topics: tuple[TopicInfo, ...]
    metadata: Mapping[str, Mapping[str, str]]
    attachments: Mapping[str, int]  # name -> bytes

    @property
    def messages(self) -> int:
        """Number of messages in all topics."""
        return sum(topic.messages for topic in self.topics)

    @property
    def megabytes_per_hour(self) -> float:
        """Size per simulated hour; 0 for a log without duration."""
        span = self.end_s - self.start_s
        return self.size_bytes / 1e6 / (span / 3600) if span > 0 else 0.0


def info(path: Path) -> LogInfo:
    """Read a whole log, verified, and say what is in it.

    Raises:
        LogError: it cannot be read, is no log of ours, or is damaged.
    """
    contents = _ours(path)
    topics = [
        TopicInfo(
            name,
            contents.schema(name).name,
            len(messages),
            min(m.log_time for m in messages) / NS_PER_S,
            max(m.log_time for m in messages) / NS_PER_S,
        )
        for name, messages in sorted(contents.messages.items())
    ]
    return LogInfo(
        path=path,
        size_bytes=path.stat().st_size,
        start_s=min((topic.start_s for topic in topics), default=0.0),
        end_s=max((topic.end_s for topic in topics), default=0.0),
        topics=tuple(topics),
        metadata=contents.metadata,
        attachments={name: len(data) for name, data in contents.attachments.items()},
    )


def _ours(path: Path) -> Contents:
    contents = load(path)
    _ = contents.area  # refuses what is not ours
    return contents


def check(path: Path) -> tuple[str, ...]:
    """Verify checksums and message numbering; return a line for each topic with gaps or disorder.

    Raises:
        LogError: it cannot be read, is no log of ours, or is damaged.
    """
    contents = _ours(path)
    findings = []
    for name, messages in sorted(contents.messages.items()):
        missing = sum(
            later.sequence - earlier.sequence - 1
            for earlier, later in pairwise(messages)
            if later.sequence > earlier.sequence + 1
        )
        if missing:
            findings.append(f"{name}: {missing} messages are missing from its numbering")
        if any(later.sequence <= earlier.sequence for earlier, later in pairwise(messages)):
            findings.append(f"{name}: messages are numbered out of order")
    return tuple(findings)


def diff(first: Path, second: Path) -> tuple[str, ...]:
    """Where two logs differ, in words; nothing for logs that say the same.

    Raises:
        LogError: one of them cannot be read, is no log of ours, or is damaged.
    """
    a, b = _ours(first), _ours(second)
    lines = [
        *_keys("metadata", a.metadata, b.metadata),
        *_keys("attachment", a.attachments, b.attachments),
    ]
    for name in sorted({*a.messages, *b.messages}):
        lines += _messages(name, a.messages.get(name, []), b.messages.get(name, []))
    return tuple(lines)


def _keys(kind: str, a: Mapping[str, object], b: Mapping[str, object]) -> list[str]:
    lines = [f"{kind} {name}: only in the first" for name in a if name not in b]
    lines += [f"{kind} {name}: only in the second" for name in b if name not in a]
    lines += [f"{kind} {name}: differs" for name in a if name in b and a[name] != b[name]]
    return lines


def _messages(name: str, a: Sequence[Message], b: Sequence[Message]) -> list[str]:
    lines = []
    told = zip(a, b, strict=False)
    different = [x.log_time for x, y in told if (x.log_time, x.data) != (y.log_time, y.data)]
    if different:
        first = ", ".join(f"{t / NS_PER_S:.3f}" for t in different[:_SHOWN])
        more = ", ..." if len(different) > _SHOWN else ""
        lines.append(f"{name}: {len(different)} messages differ, at {first}{more} s")
    if len(a) != len(b):
        lines.append(f"{name}: {len(a)} messages in the first, {len(b)} in the second")
    return lines
