"""Our writer of MCAP against the library's, and filled templates against Foxglove's encoding."""

import io
from typing import Any

import numpy as np
import pytest
from foxglove import messages as fox
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import CompressionType, Writer

from mission.log.chunked import ChunkedWriter
from mission.log.messages import POSE, TRANSFORM


def drive(writer: Any, *, messages: int) -> None:
    """The same calls in any case: several chunks, times out of order, attachments between."""
    rng = np.random.default_rng(1)
    for number in range(4):
        writer.register_schema(f"schema {number}", "protobuf", bytes(rng.integers(0, 256, 50)))
    for number in range(9):
        writer.register_channel(f"/topic/{number}", "protobuf", number % 5, {})
    writer.add_metadata("first", {"a": "b"})
    writer.add_attachment(0, 5, "a.json", "application/json", b"{}")
    writer.flush()
    for k in range(messages):
        t_ns = 10_000_000 * max(0, k + int(rng.integers(-5, 5)))
        data = bytes(rng.integers(0, 4, int(rng.integers(0, 100))))
        writer.add_message(int(rng.integers(1, 10)), t_ns, data, t_ns + 1, k)
        if k % 40 == 0:
            writer.flush()
        if k % 700 == 0:
            writer.add_metadata("more", {"k": str(k)})
    writer.finish()


@pytest.mark.parametrize("messages", [0, 1, 3000])
def test_the_same_bytes_as_the_library(messages: int) -> None:
    theirs, ours = io.BytesIO(), io.BytesIO()
    peer = Writer(theirs, chunk_size=2000, compression=CompressionType.ZSTD, enable_data_crcs=True)
    peer.start(library="library")
    drive(peer, messages=messages)
    drive(ChunkedWriter(ours, library="library", chunk_bytes=2000), messages=messages)
    assert ours.getvalue() == theirs.getvalue()


def decoder(schema: Any) -> Any:
    """The class of messages of a protobuf schema."""
    files = descriptor_pb2.FileDescriptorSet.FromString(bytes(schema.data))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def test_filled_templates_say_what_the_encoder_says() -> None:
    rng = np.random.default_rng(2)
    t_ns = np.array([0, 1, 100_000_000, 1_000_000_000, 86_400_000_000_000 + 999_999_999])
    numbers = rng.normal(0, 100, (len(t_ns), 7))
    numbers[0] = 0.0
    made = zip(t_ns.tolist(), numbers.tolist(), POSE.fill(t_ns, numbers), strict=True)
    poses, transforms = decoder(fox.PoseInFrame.get_schema()), TRANSFORM.fill(t_ns, numbers)
    for instant, (x, y, z, *turn), data in made:
        stamp = fox.Timestamp(*divmod(instant, 1_000_000_000))
        place, orientation = {"x": x, "y": y, "z": z}, dict(zip("xyzw", turn, strict=True))
        expected = fox.PoseInFrame(
            timestamp=stamp,
            frame_id="area",
            pose=fox.Pose(position=fox.Vector3(**place), orientation=fox.Quaternion(**orientation)),
        )
        assert poses.FromString(data) == poses.FromString(expected.encode())
    found = decoder(fox.FrameTransform.get_schema()).FromString(transforms[2])
    assert found.timestamp.nanos == 100_000_000
    assert (found.rotation.w, found.translation.z) == (numbers[2, 6], numbers[2, 2])
