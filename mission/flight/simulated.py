"""What the application adds to any simulated vehicle, in a run or served alone: what goes wrong in
it as our errors, and links to ground stations beside the one that flies it."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from flightdyn.errors import FlightDynamicsError, FlightInputError
from mission.base.errors import FlightError, InputError, LinkLostError
from mission.config.models import LinkConfig
from mission.config.preflight import signing_key
from sitl.autopilot.codec.wire import Seal
from sitl.errors import LinkError, SitlInputError
from sitl.links import Link, network_link


@contextmanager
def of_settings() -> Iterator[None]:
    """Context manager around the making of a vehicle: refused settings raise InputError."""
    try:
        yield
    except (SitlInputError, FlightInputError) as error:
        raise InputError(str(error)) from None


@contextmanager
def of_a_vehicle() -> Iterator[None]:
    """Context manager around a vehicle's flight: translates errors of its links and physics.

    Raises:
        LinkLostError: a link cannot be opened or used.
        FlightError: the aircraft has left the range of its physics.
    """
    try:
        yield
    except LinkError as error:
        raise LinkLostError(str(error)) from None
    except FlightDynamicsError as error:
        raise FlightError(f"the simulated aircraft failed: {error}") from error


def station_links(
    link: LinkConfig, urls: Mapping[str, int] | Sequence[str] | None = None
) -> list[Link]:
    """Return a link for each of `urls` (default: those of `link.gcs`), signed if there is a key.
    A mapping gives each URL its local port, 0 for any.

    Raises:
        InputError: the key cannot be read.
    """
    urls = link.gcs if urls is None else urls
    own = urls if isinstance(urls, Mapping) else {}
    key = None if link.signing_key is None else signing_key(link.signing_key)
    return [
        network_link(url, Seal(key, link_id=number) if key else None, own_port=own.get(url, 0))
        for number, url in enumerate(urls)
    ]
