"""Messages between us and a child: a JSON object and some bytes. The other side may lie: nothing of it is run."""

from __future__ import annotations

import json
import socket
import struct
from typing import Any

Message = dict[str, Any]
_HEADER = struct.Struct("!II")
MAX_JSON_BYTES = 8 << 20
MAX_BYTES = 64 << 20
"""Longest run of bytes beside a message: the times of a million frames take 16 MB."""


class Broken(Exception):
    """The other side has closed, or does not keep to the form."""


def send(wire: socket.socket, message: Message, data: bytes = b"") -> None:
    """Raises OSError."""
    text = json.dumps(message).encode()
    wire.sendall(_HEADER.pack(len(text), len(data)) + text + data)


def receive(wire: socket.socket) -> tuple[Message, bytes]:
    """The next message. Raises Broken, TimeoutError (the socket's own), OSError."""
    text_bytes, data_bytes = _HEADER.unpack(_exactly(wire, _HEADER.size))
    if text_bytes > MAX_JSON_BYTES or data_bytes > MAX_BYTES:
        raise Broken("a message is too long")
    try:
        message = json.loads(_exactly(wire, text_bytes))
    except ValueError as error:
        raise Broken("a message is no JSON") from error
    if not isinstance(message, dict):
        raise Broken("a message is no object")
    return message, _exactly(wire, data_bytes)


def _exactly(wire: socket.socket, size: int) -> bytes:
    parts, left = [], size
    while left:
        part = wire.recv(min(left, 1 << 20))
        if not part:
            raise Broken("the other side has closed")
        parts.append(part)
        left -= len(part)
    return b"".join(parts)
