"""Messages between two processes: a JSON object and bytes. No received data is executed."""

from __future__ import annotations

import json
import socket
import struct
from typing import Any

Message = dict[str, Any]
HEADER = struct.Struct("!II")
MAX_JSON_BYTES = 8 << 20
MAX_BYTES = 64 << 20
"""Maximum number of bytes with a message; the times of a million frames take 16 MB."""


class ConnectionBroken(Exception):
    """The other side has closed the connection, or violates the message format."""


def packed(message: Message, data: bytes = b"") -> bytes:
    text = json.dumps(message).encode()
    return HEADER.pack(len(text), len(data)) + text + data


def lengths(header: bytes) -> tuple[int, int]:
    """Lengths of the text and of the bytes after a header. Raises ConnectionBroken."""
    text_bytes, data_bytes = HEADER.unpack(header)
    if text_bytes > MAX_JSON_BYTES or data_bytes > MAX_BYTES:
        raise ConnectionBroken("a message is too long")
    return text_bytes, data_bytes


def parsed(text: bytes) -> Message:
    """The JSON object of a message. Raises ConnectionBroken."""
    try:
        message = json.loads(text)
    except ValueError as error:
        raise ConnectionBroken("a message is no JSON") from error
    if not isinstance(message, dict):
        raise ConnectionBroken("a message is no object")
    return message


def send(wire: socket.socket, message: Message, data: bytes = b"") -> None:
    """Send a message. Raises OSError."""
    wire.sendall(packed(message, data))


def receive(wire: socket.socket) -> tuple[Message, bytes]:
    """The next message. Raises ConnectionBroken, TimeoutError (the socket's), OSError."""
    text_bytes, data_bytes = lengths(_exactly(wire, HEADER.size))
    return parsed(_exactly(wire, text_bytes)), _exactly(wire, data_bytes)


def _exactly(wire: socket.socket, size: int) -> bytes:
    parts, left = [], size
    while left:
        part = wire.recv(min(left, 1 << 20))
        if not part:
            raise ConnectionBroken("the other side has closed")
        parts.append(part)
        left -= len(part)
    return b"".join(parts)
