"""Allowed targets of webhooks: http(s) URLs of public addresses, unless the operator allows private ones.

The URL is checked when a job is submitted, and the address again at each connection, since a name may change.
"""

from __future__ import annotations

import ipaddress
import socket
from ipaddress import IPv4Address
from urllib.parse import SplitResult, urlsplit

from pipeline.errors import BadParameter

NAT64 = ipaddress.ip_network("64:ff9b::/96")
GLOBAL_UNICAST = ipaddress.ip_network("2000::/3")


def check_target(url: str, private: bool) -> None:
    """Raise BadParameter unless `url` is empty or an allowed target.

    A name that cannot be resolved now is accepted: delivery will retry.
    """
    if not url:
        return
    parts = _split(url)
    if private:
        return
    for address in _resolve(parts.hostname or "", parts.port or 443):
        if not is_public(address):
            raise _bad(url, "It points to a private address.", "Use a public one, or ask the operator to allow it.")


def _split(url: str) -> SplitResult:
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        raise _bad(url, "It is not a URL.", "For example https://example.org/hook.") from None
    if parts.scheme not in ("http", "https") or not parts.hostname or port == 0:
        raise _bad(url, "It is not an http(s) URL.", "For example https://example.org/hook.")
    if parts.username or parts.password or parts.fragment:
        raise _bad(url, "It contains a user, a password or a fragment.", "Leave those out.")
    if not url.isascii() or any(char.isspace() for char in url):
        raise _bad(url, "It contains characters that a URL may not.", "Encode them.")
    return parts


def _bad(url: str, why: str, remedy: str) -> BadParameter:
    return BadParameter(f"The webhook cannot be used. {why}", field="webhook", value=url, remedy=remedy)


def _resolve(host: str, port: int) -> list[str]:
    try:
        return [str(row[4][0]) for row in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)]
    except (OSError, UnicodeError):
        return []


def is_public(address: str) -> bool:
    """Whether an IP address is reachable on the public Internet.

    IPv6 addresses must be global unicast (2000::/3, RFC 4291) or a standard form of a public IPv4 address (mapped, or
    NAT64's well-known prefix). Every other form that embeds IPv4, such as `::127.0.0.1`, is refused.
    """
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return False
    if isinstance(found, IPv4Address):
        return _is_public_v4(found)
    if (mapped := found.ipv4_mapped) is not None:
        return _is_public_v4(mapped)
    if found in NAT64:
        return _is_public_v4(IPv4Address(int(found) & 0xFFFFFFFF))
    embedded = [found.sixtofour, *(found.teredo or ())]
    return (
        found in GLOBAL_UNICAST and found.is_global and all(_is_public_v4(one) for one in embedded if one is not None)
    )


def _is_public_v4(address: IPv4Address) -> bool:
    return address.is_global and not address.is_multicast
