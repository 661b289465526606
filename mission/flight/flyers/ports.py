"""UDP ports that a flight needs, looked for before anything is written."""

import socket

from mission.base.errors import LinkLostError
from mission.config.models import LinkConfig


def check_link(link: LinkConfig) -> None:
    """Refuse ports that are taken.

    Raises:
        LinkLostError: names the key and the port.
    """
    if link.kind == "udp":
        _check_port("127.0.0.1", link.udp_port, f"link.udp_port = {link.udp_port}")
    elif link.kind == "external":
        _check_url(link.url, "link.url")
    for url in link.gcs:
        _check_url(url, "link.gcs")


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
