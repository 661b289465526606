"""How a run talks to its vehicle, and how fast simulated time runs."""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from flightdyn.tables import Table
from mission.base.errors import InputError

NETWORK = ("udpin", "udpout", "tcpin", "tcpout")
NETWORK_FORMS = (
    "udpin://HOST:PORT or tcpin://HOST:PORT to listen, udpout://HOST:PORT or tcpout://HOST:PORT "
    "to call"
)
URL_FORMS = f"{NETWORK_FORMS}, or serial:///DEVICE:BAUD"


def checked_url(url: str) -> str:
    """Return the URL if it has a form that MAVSDK accepts.

    Raises:
        ValueError: it has not; the message lists the forms.
    """
    scheme, _, address = url.partition("://")
    place, _, number = address.rpartition(":")
    most = 65535 if scheme in NETWORK else 10_000_000
    numbered = number.isdecimal() and 1 <= int(number) <= most
    if scheme not in (*NETWORK, "serial") or not place or not numbered:
        raise ValueError(f"no address of a vehicle; it must be {URL_FORMS}")
    return url


class LinkConfig(Table):
    """How MAVSDK talks to the vehicle, and how fast simulated time runs in flight."""

    kind: Literal["in_process", "udp", "external"] = "in_process"
    """in_process needs no port; udp uses the loopback address; external flies the autopilot at url
    instead of the simulated vehicle"""
    url: Annotated[str, AfterValidator(checked_url)] = "udpin://0.0.0.0:14540"
    """external: MAVSDK connection URL of the autopilot: udpin://HOST:PORT or tcpin://HOST:PORT to
    listen, udpout://HOST:PORT or tcpout://HOST:PORT to call, or serial:///DEVICE:BAUD"""
    gcs: tuple[str, ...] = ()
    """ground stations that see the simulated vehicle while it is flown: udpin://HOST:PORT or
    tcpin://HOST:PORT to listen, udpout://HOST:PORT or tcpout://HOST:PORT to call"""
    signing_key: Path | None = None
    """file with the pass phrase by which the links of gcs are signed (MAVLink 2), both ways; unset:
    they are not"""
    udp_port: int = Field(14540, ge=1, le=65535)
    """udp: where MAVSDK listens"""
    speed: Literal["max"] | Annotated[float, Field(gt=0, le=1000)] = "max"
    """simulated seconds per second in flight; "max": as fast as it can"""
    connect_timeout_s: float = Field(60.0, gt=0, le=86_400)
    """external, firmware: wall seconds to wait for the first sign of the autopilot"""
    ready_timeout_s: float = Field(300.0, gt=0, le=86_400)
    """external, firmware: wall seconds to wait until the autopilot knows where it is and can be
    armed"""
    set_parameters: bool = False
    """external: set the autopilot's parameters for the flight, where they keep it from what the
    mission asks (speed, acceptance radius), and set them back at the end"""
    battery_timeout_s: float = Field(600.0, gt=0, le=86_400)
    """external: wall seconds to wait on the ground for a charged battery"""
    stall_timeout_s: float = Field(30.0, gt=0, le=3600)
    """wall seconds without any progress of the vehicle after which a run ends"""

    @field_validator("gcs")
    @classmethod
    def _links(cls, urls: tuple[str, ...]) -> tuple[str, ...]:
        if urls:
            # Imported here: asyncio takes 30 ms, half of what reading a configuration takes.
            from sitl.links import network_link
        for url in urls:
            try:
                network_link(url)
            except InputError as error:
                raise ValueError(f"{error}; it must be {NETWORK_FORMS}") from None
        return urls

    @model_validator(mode="after")
    def _seen_by_the_autopilot_itself(self) -> Self:
        if self.kind == "external" and self.gcs:
            raise ValueError(
                "gcs shows ground stations the simulated vehicle; an external autopilot "
                "(--vehicle, link.kind = external) has links of its own: leave gcs out"
            )
        return self
