"""Ground stations that call themselves the same, as every script by MAVSDK does."""

import asyncio
import math
from typing import Any

import pytest
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.plugins.mission_raw import MissionItem
from patience import HANG_S
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk
from sitl_mavsdk import client, make_vehicle

from sitl.links import RawLink
from sitl.pace import Simulation

HERE, THERE = ("a link", "here"), ("a link", "there")


def waypoint(seq: int, metres: float) -> mav.MAVLink_mission_item_int_message:
    at = (474_000_000, 85_000_000, metres)
    return mav.MAVLink_mission_item_int_message(1, 1, seq, 6, 16, 0, 1, 0, 0, 0, math.nan, *at)


def test_each_is_answered_where_it_asks_and_ends_its_own_transfer_only() -> None:
    desk = Desk()
    station = mav.MAVLink(None, srcSystem=245, srcComponent=190)

    def say(message: Any, place: tuple[str, str]) -> list[tuple[Any, Any]]:
        """What is said of missions and commands, and where."""
        desk.vehicle.receive(bytes(message.pack(station)), desk.now, place)
        said = []
        for where, frame in desk.vehicle.outgoing(desk.now):
            heard: Any = mav.MAVLink(None).decode(bytearray(frame))
            name = heard.get_type()
            if name == "COMMAND_ACK" or (
                name.startswith("MISSION_") and heard.to_dict().get("target_system")
            ):
                said.append((where, heard))
        return said

    count = mav.MAVLink_mission_count_message(1, 1, 2)
    assert [place for place, _ in say(count, HERE)] == [HERE]
    for seq in range(2):
        assert [place for place, _ in say(waypoint(seq, 20.0), HERE)] == [HERE]
    ((place, counted),) = say(mav.MAVLink_mission_request_list_message(1, 1), THERE)
    assert (place, counted.count) == (THERE, 2)
    # The other reads the list to its end, and empties it: who still reads gets what was announced.
    ((place, _),) = say(mav.MAVLink_mission_request_list_message(1, 1), HERE)
    say(mav.MAVLink_mission_ack_message(1, 1, 0), HERE)
    ((place, cleared),) = say(mav.MAVLink_mission_clear_all_message(1, 1), HERE)
    assert (place, cleared.type) == (HERE, 0)
    for seq in range(2):
        ((place, item),) = say(mav.MAVLink_mission_request_int_message(1, 1, seq), THERE)
        assert (place, item.seq) == (THERE, seq)
    ((place, ack),) = say(mav.MAVLink_command_long_message(1, 1, 512, 0, 148, *[0.0] * 6), THERE)
    assert (place, ack.result) == (THERE, 0)


def items(count: int, metres: float, kind: int = 0) -> list[MissionItem]:
    """Of a mission, or of a fence whose corners lie where `metres` says."""
    if kind:
        corners = [(0, 0), (metres, 0), (metres, metres), (0, metres)]
        return [
            MissionItem(
                seq, 0, 5001, 0, 1, 4.0, 0.0, 0.0, 0.0,
                474_000_000 - 2000 + int(100 * north), 85_000_000 - 2000 + int(100 * east), 0.0, 1,
            )
            for seq, (north, east) in enumerate(corners)
        ]  # fmt: skip
    return [
        MissionItem(
            seq, 6, 16, int(seq == 0), 1, 0.0, 2.0, 0.0, math.nan,
            474_000_000 + 100 * seq, 85_000_000, metres, 0,
        )
        for seq in range(count)
    ]  # fmt: skip


@pytest.mark.slow
def test_two_scripts_by_mavsdk_read_and_write_at_once() -> None:
    """MAVSDK takes what it hears of any list, for whomever it is, for what it asked for."""

    async def attached(mavsdk: Mavsdk, link: RawLink) -> MissionRawAsync:
        await mavsdk.add_any_connection("raw://")
        core = mavsdk._mavsdk
        core.subscribe_raw_bytes_to_be_sent(link.feed)
        link.attach(core.pass_received_raw_bytes)
        return MissionRawAsync(await mavsdk.first_autopilot(timeout_s=HANG_S))

    async def run() -> None:
        vehicle, ours, theirs = make_vehicle(), RawLink(), RawLink()
        async with Simulation(vehicle, ours, theirs), client() as one, client() as other:
            writing, reading = await attached(one, ours), await attached(other, theirs)
            fence = items(4, 400.0, kind=1)
            await writing.upload_geofence(fence)

            async def read(station: MissionRawAsync) -> None:
                back = await station.download_geofence()
                assert [(item.command, item.x) for item in back] == [
                    (item.command, item.x) for item in fence
                ]
                back = await station.download_mission()
                assert len({item.z for item in back}) <= 1
                assert {item.mission_type for item in back} <= {0}

            async def write() -> None:
                for turn in range(20):
                    await writing.upload_mission(items(4, 10.0 + turn))
                    await read(writing)

            writer = asyncio.create_task(write())
            while not writer.done():
                await read(reading)
            await writer
            ours.detach()
            theirs.detach()

    asyncio.run(run())
