"""Where webhooks may go: http(s) to public addresses, unless the operator allows private ones.

Checked when a job is submitted, and again for the very address that is connected to: by then the name may point
elsewhere.
"""

from __future__ import annotations

import ipaddress
import socket
from ipaddress import IPv4Address, IPv6Address
from urllib.parse import SplitResult, urlsplit

from pipeline.errors import BadParameter

NAT64 = ipaddress.ip_network("64:ff9b::/96")


def check_target(url: str, private: bool) -> None:
    """Raise BadParameter unless `url` is empty or may be told of a job's end.

    A name that cannot be resolved now is let through: whether the receiver is there is found out at delivery.
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
        raise _bad(url, "It holds a user, a password or a fragment.", "Leave those out.")
    if not url.isascii() or any(char.isspace() for char in url):
        raise _bad(url, "It holds characters that a URL may not.", "Encode them.")
    return parts


def _bad(url: str, why: str, remedy: str) -> BadParameter:
    return BadParameter(f"That webhook cannot be used. {why}", field="webhook", value=url, remedy=remedy)


def _resolve(host: str, port: int) -> list[str]:
    try:
        return [str(row[4][0]) for row in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)]
    except (OSError, UnicodeError):
        return []


def is_public(address: str) -> bool:
    """Whether an IP address is reachable on the public Internet, seen through every way to wrap IPv4 in IPv6."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return False
    return all(_global(one) for one in (found, *_wrapped(found)))


def _global(address: IPv4Address | IPv6Address) -> bool:
    return address.is_global and not address.is_multicast


def _wrapped(address: IPv4Address | IPv6Address) -> list[IPv4Address]:
    if isinstance(address, IPv4Address):
        return []
    inner = [address.ipv4_mapped, address.sixtofour, *(address.teredo or ())]
    if address in NAT64:
        inner.append(IPv4Address(int(address) & 0xFFFFFFFF))
    return [one for one in inner if one is not None]
