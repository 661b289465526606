"""The flyer that a configuration asks for."""

import asyncio
import socket
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager

import numpy as np

from mission.config import LinkConfig
from mission.contact import look_at_vehicle
from mission.errors import LinkLostError
from mission.external import open_external
from mission.flyer import Flyer, Tap, open_simulated
from mission.pilot.limits import Demand
from mission.world import World
from sitl.observer import VehicleObserver


def open_flyer(
    world: World,
    observers: Sequence[VehicleObserver],
    *,
    tap: Tap | None = None,
    say: Callable[[str], None],
) -> AbstractAsyncContextManager[Flyer]:
    """The simulated vehicle, or an external autopilot, to which nobody but MAVSDK is linked.

    `say` hears what people should know of an external one.
    """
    config = world.config
    if config.link.kind == "external":
        return open_external(
            config.link,
            mission=config.mission,
            area=world.area,
            demand=_demand(world),
            observers=observers,
            say=say,
        )
    return open_simulated(config, world.vehicle, area=world.area, observers=observers, tap=tap)


def position_source(link: LinkConfig) -> str:
    """Where a run's positions come from, for people."""
    if link.kind == "external":
        return f"telemetry of {link.url}: truth and belief are what the autopilot says"
    return "simulated vehicle: truth from its physics, belief from its estimator"


def check_link(link: LinkConfig) -> None:
    """Refuse ports that are taken, before anything is written.

    Raises:
        LinkLostError: names the key and the port.
    """
    if link.kind == "udp":
        _check_port("127.0.0.1", link.udp_port, f"link.udp_port = {link.udp_port}")
    elif link.kind == "external":
        _check_url(link.url, "link.url")
    if link.kind != "external":
        for url in link.gcs:
            _check_url(url, "link.gcs")


def await_vehicle(world: World, *, say: Callable[[str], None]) -> None:
    """Wait for an external autopilot that can be flown, before anything is written.

    `say` hears what is waited for. The simulated vehicle is always there.

    Raises:
        LinkLostError: none answers in time, or it does not say where it is.
        InputError: it stands somewhere else than the area.
    """
    config = world.config
    if world.strategy is None or config.link.kind != "external":
        return
    say(f"waiting for a vehicle on {config.link.url} (Ctrl-C ends)")
    asyncio.run(look_at_vehicle(config.link, area=world.area, say=say))


def _demand(world: World) -> Demand:
    """What the rounds may ask of the vehicle: no path leads farther than to the devices."""
    mission = world.config.mission
    away_m = np.linalg.norm(world.devices_m - np.array(world.area.home_m), axis=1)
    return Demand(
        speed_mps=mission.speed_mps,
        altitude_m=mission.altitude_m,
        distance_m=float(away_m.max(initial=0.0)),
        acceptance_m=mission.acceptance_radius_m,
    )


def _check_url(url: str, key: str) -> None:
    host, _, port = url.removeprefix("udpin://").rpartition(":")
    if url.startswith("udpin://") and port.isdecimal():
        _check_port(host, int(port), f"{key} = {url}")


def _check_port(host: str, port: int, what: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, port))
        except (OSError, OverflowError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise LinkLostError(f"{what}: cannot listen on this UDP port: {reason}") from None
