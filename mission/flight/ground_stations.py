"""Links to ground stations beside the one that flies the vehicle."""

from collections.abc import Sequence

from mission.config.models import LinkConfig
from mission.config.preflight import signing_key
from sitl.autopilot.codec.wire import Seal
from sitl.links import UdpLink


def station_links(link: LinkConfig, urls: Sequence[str] | None = None) -> list[UdpLink]:
    """A link for each of `urls` (default: those of `link.gcs`), signed where there is a key.

    Raises:
        InputError: the key cannot be read.
    """
    urls = link.gcs if urls is None else urls
    if link.signing_key is None:
        return [UdpLink(url) for url in urls]
    key = signing_key(link.signing_key)
    return [UdpLink(url, Seal(key, link_id=number)) for number, url in enumerate(urls)]
