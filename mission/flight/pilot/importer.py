"""Mission items out of plan files, by MAVSDK's own importer."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.exceptions import MavsdkError

from mission.base.errors import InputError
from mission.flight.pilot.calls import reason
from mission.flight.pilot.connection import CONNECT_TIMEOUT_S, ground_station, raw_core
from mission.flight.pilot.raw_items import from_raw
from mission.flight.plan_file import PlanFile
from sitl.autopilot.values.messages import MissionItem


@dataclass(frozen=True)
class Imported:
    """What a plan file holds; items count from 0."""

    items: tuple[MissionItem, ...]  # without the home that a waypoint file starts with
    fence: tuple[MissionItem, ...]
    rally: tuple[MissionItem, ...]


def import_plan(plan: PlanFile, *, heartbeat: bytes) -> Imported:
    """Let MAVSDK read the file. Its importer belongs to a vehicle, so `heartbeat` plays one.

    Raises:
        InputError: MAVSDK cannot read it.
    """
    return asyncio.run(_import(plan, heartbeat=heartbeat))


async def _import(plan: PlanFile, *, heartbeat: bytes) -> Imported:
    async with ground_station() as mavsdk:
        await mavsdk.add_any_connection("raw://")
        core = raw_core(mavsdk)
        core.subscribe_raw_bytes_to_be_sent(_nowhere)
        core.pass_received_raw_bytes(heartbeat)
        system = await mavsdk.first_autopilot(timeout_s=CONNECT_TIMEOUT_S)
        importer = MissionRawAsync(system)
        try:
            if plan.is_qgroundcontrol:
                found = await importer.import_qgroundcontrol_mission_from_string(plan.text)
            else:
                found = await importer.import_mission_planner_mission_from_string(plan.text)
        except MavsdkError as error:
            raise InputError(
                f"{plan.path}: damaged: MAVSDK cannot read it: {reason(error)}"
            ) from None
    items = [from_raw(item) for item in found.mission_items]
    return Imported(
        _counted(items[1:] if plan.home_is_item else items),
        _counted([from_raw(item) for item in found.geofence_items]),
        _counted([from_raw(item) for item in found.rally_items]),
    )


def _counted(items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    return tuple(replace(item, seq=seq) for seq, item in enumerate(items))


def _nowhere(_: bytes) -> None:
    """There is no vehicle to send to."""
