"""Base class of the ways to fly a run: checks before anything flies, and opening the flyer.

Each kind stands beside its flyer: `simulated`, `firmware`, `external`, `unflown`.
"""

import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from flightdyn.random import RandomStreams
from mission.base.area import Area
from mission.base.errors import LinkLostError
from mission.config.models import RunConfig
from mission.flight.fence_zones import airspace_zones
from mission.flight.flight_plan import Demand
from mission.flight.flyers.flyer import Flyer
from mission.log.values import Zone
from sitl.links import Link
from sitl.observer import VehicleObserver

if TYPE_CHECKING:  # who flies nothing needs no MAVSDK
    from mission.flight.pilot.limits import VehicleLimits

Say: TypeAlias = Callable[[str], None]


@dataclass(frozen=True)
class Task:
    """Configuration, area, random streams and demand of the flights of a run."""

    config: RunConfig
    area: Area
    streams: RandomStreams
    demand: Demand


@dataclass(frozen=True)
class Attached:
    """Observers, folder, messages and links of a flight."""

    observers: Sequence[VehicleObserver]
    folder: Path  # of the run
    say: Say  # hears what people should know of another autopilot than ours
    links: tuple[Link, ...] = ()  # of clients beside those of `link.gcs`; of a firmware


@dataclass(frozen=True)
class Flyers(ABC):
    """Factory of a run's flyer, and its checks before anything flies."""

    task: Task

    @property
    @abstractmethod
    def position_source(self) -> str:
        """Where the run's positions come from, for people."""

    @property
    def no_resume(self) -> str:
        """Why the run cannot be resumed, for people; empty where it can."""
        return ""

    def check(self) -> None:
        """Refuse what cannot work, before anything is written.

        Raises:
            LinkLostError: a port is taken.
            InputError: the firmware's binary is not there.
        """
        link = self.task.config.link
        if link.kind == "udp":
            _check_port("127.0.0.1", link.udp_port, f"link.udp_port = {link.udp_port}")
        elif link.kind == "external":
            _check_url(link.url, "link.url")
        for url in link.gcs:
            _check_url(url, "link.gcs")

    def await_vehicle(self, *, say: Say) -> "VehicleLimits | None":  # noqa: ARG002
        """Wait for a vehicle that must be there already; `say` hears what is waited for.

        Returns its own limits; None of one that keeps to the configuration's.

        Raises:
            LinkLostError, FlightError, InputError: it is not, or not where the devices are.
            KeyboardInterrupt: nobody wants to wait any longer.
        """
        return None

    def fence(self) -> tuple[Zone, ...]:
        """Return the fence zones that are known before the flight: the configured ones."""
        return airspace_zones(self.task.area)

    @abstractmethod
    def open(self, attached: Attached) -> AbstractAsyncContextManager[Flyer]:
        """A context manager that gives the flyer, and ends it with the block."""


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
