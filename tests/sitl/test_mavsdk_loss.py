"""Real MAVSDK over a link that loses every message of a mission transfer the first time."""

import asyncio
import math
from collections.abc import Sequence
from typing import Any

import pytest
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.plugins.mission_raw import MissionItem
from patience import HANG_S
from pymavlink.dialects.v20 import common as mav
from sitl_mavsdk import client, make_vehicle

from sitl.links import RawLink
from sitl.pace import Simulation

pytestmark = pytest.mark.slow

TRANSFER = {
    mav.MAVLINK_MSG_ID_MISSION_COUNT,
    mav.MAVLINK_MSG_ID_MISSION_ITEM_INT,
    mav.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
    mav.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
    mav.MAVLINK_MSG_ID_MISSION_ACK,
}


class LosesOnce(RawLink):
    """Lets a message of a transfer pass the second time only; its sequence number may differ."""

    def __init__(self) -> None:
        super().__init__()
        self.lost: set[tuple[int, bytes]] = set()

    def passes(self, frame: bytes) -> bool:
        kind, payload = int.from_bytes(frame[7:10], "little"), frame[10:-2]
        if kind not in TRANSFER or (kind, payload) in self.lost:
            return True
        self.lost.add((kind, payload))
        return False

    def feed(self, data: bytes) -> None:
        if self.passes(data):
            super().feed(data)

    def send(self, frames: Sequence[bytes], to: Any = None) -> None:
        super().send([frame for frame in frames if self.passes(frame)], to)


def test_upload_and_download() -> None:
    items = [
        MissionItem(
            seq=seq, frame=6, command=16, current=int(seq == 0), autocontinue=1,
            param1=0.0, param2=2.0, param3=0.0, param4=math.nan,
            x=474_000_000 + 1000 * seq, y=85_000_000, z=20.0, mission_type=0,
        )
        for seq in range(3)
    ]  # fmt: skip

    async def run() -> None:
        vehicle, link = make_vehicle(), LosesOnce()
        async with Simulation(vehicle, link), client() as mavsdk:
            await mavsdk.add_any_connection("raw://")
            core = mavsdk._mavsdk
            core.subscribe_raw_bytes_to_be_sent(link.feed)
            link.attach(core.pass_received_raw_bytes)
            raw = MissionRawAsync(await mavsdk.first_autopilot(timeout_s=HANG_S))
            await raw.upload_mission(items)
            assert len(vehicle.autopilot.flight.mission.items) == 3
            back = await raw.download_mission()
            link.detach()
        assert [(item.seq, item.x) for item in back] == [(item.seq, item.x) for item in items]
        # Both sides: count, three requests and items, an acknowledgement; and the list's request.
        assert len(link.lost) == 17

    asyncio.run(run())
