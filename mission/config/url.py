"""Connection URLs: the forms that MAVSDK accepts for the address of a vehicle."""

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
