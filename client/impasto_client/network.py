"""Addresses of this computer, and certificate authorities.

Proxies and certificate authorities come from the environment, as in other programs: HTTPS_PROXY, HTTP_PROXY, ALL_PROXY
and NO_PROXY (on Windows and macOS otherwise the system's settings), SSL_CERT_FILE and SSL_CERT_DIR.
"""

from __future__ import annotations

import ssl
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import urlsplit

from impasto_client.errors import BadInput

NO_PROXIES = {"http://": None, "https://": None}
"""httpx's transports for addresses of this computer: its own, whatever the environment says of proxies."""


def is_loopback(server: str) -> bool:
    """Whether the address is this computer's own."""
    host = urlsplit(server).hostname or ""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def authorities(ca_file: str | Path) -> ssl.SSLContext | bool:
    """Certificate authorities for httpx: a PEM file's; for "", the environment's, else Mozilla's. Raises: BadInput."""
    if not ca_file:
        return True
    try:
        return ssl.create_default_context(cafile=str(ca_file))
    except OSError as error:  # includes ssl.SSLError
        raise BadInput(f"No certificates can be read: {error}.", field="ca_file", value=ca_file,
                       remedy="Name a PEM file with the certificates of your authorities.") from error  # fmt: skip


def remedy_for(error: Exception) -> str:
    """A sentence for the user on how to mend a failed connection."""
    if "CERTIFICATE_VERIFY_FAILED" in str(error):
        return "If your network has certificates of its own, name their PEM file in SSL_CERT_FILE, or as ca_file."
    return "Start one with `impasto serve`, or give its address with --server."
