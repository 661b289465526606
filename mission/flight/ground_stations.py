"""Links to ground stations beside the one that flies a simulated vehicle."""

from collections.abc import Mapping, Sequence

from mission.config.link import LinkConfig
from mission.config.preflight import signing_key
from sitl.autopilot.codec.wire import Seal
from sitl.links import Link, network_link


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
