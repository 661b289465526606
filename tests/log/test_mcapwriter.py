"""Our MCAP writer against the library's: the same calls give the same bytes."""

import io
from collections.abc import Callable
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from mission.log.mcapwriter import McapWriter

CHUNK = 500

Call = Callable[[Any], object]


def message(channel: int, t_ns: int, data: bytes, sequence: int) -> Call:
    return lambda w: w.add_message(channel, t_ns, data, t_ns + 1, sequence)


CALLS = st.one_of(
    st.builds(
        message,
        st.integers(1, 3),
        st.integers(0, 2**63),
        st.binary(max_size=300),
        st.integers(0, 2**32 - 1),
    ),
    st.just(lambda w: w.flush()),
    st.builds(lambda d: lambda w: w.add_attachment(0, 5, "ä", "text/plain", d), st.binary()),
    st.builds(
        lambda d: lambda w: w.add_metadata("m", d),
        st.dictionaries(st.text(max_size=5), st.text(max_size=5), max_size=3),
    ),
)


def written(writer: Any, stream: io.BytesIO, calls: list[Call]) -> bytes:
    schema = writer.register_schema("s", "jsonschema", b"{}")
    for topic in ("/a", "/b"):
        writer.register_channel(topic, "json", schema, {"k": "v"})
    writer.register_channel("/raw", "x", 0)
    for call in calls:
        call(writer)
    writer.finish()
    return stream.getvalue()


@settings(max_examples=150, deadline=None)
@given(st.lists(CALLS, max_size=30))
def test_it_writes_what_the_library_writes(calls: list[Call]) -> None:
    reference, ours = io.BytesIO(), io.BytesIO()
    library = Writer(
        reference, chunk_size=CHUNK, compression=CompressionType.ZSTD, enable_data_crcs=True
    )
    library.start(library="x")
    mine = McapWriter(ours, library="x", chunk_bytes=CHUNK, level=3)
    assert written(mine, ours, calls) == written(library, reference, calls)
