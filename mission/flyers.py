"""The flyer that a configuration asks for."""

import socket
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager

from mission.config import LinkConfig
from mission.errors import LinkLostError
from mission.external import look_at_vehicle, open_external
from mission.flyer import Flyer, Tap, open_simulated
from mission.interrupts import run_flight
from mission.world import World
from sitl.observer import VehicleObserver


def open_flyer(
    world: World, observers: Sequence[VehicleObserver], *, tap: Tap | None = None
) -> AbstractAsyncContextManager[Flyer]:
    """The simulated vehicle, or an external autopilot, to which nobody but MAVSDK is linked."""
    config = world.config
    if config.link.kind == "external":
        return open_external(
            config.link, mission=config.mission, area=world.area, observers=observers
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
    run_flight(look_at_vehicle(config.link, mission=config.mission, area=world.area))


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
