"""Messages between two processes: a JSON object and some bytes. The other side may lie: nothing of it is run."""

from __future__ import annotations

import json
import socket
import struct
from typing import Any

Message = dict[str, Any]
HEADER = struct.Struct("!II")
MAX_JSON_BYTES = 8 << 20
MAX_BYTES = 64 << 20
"""Longest run of bytes beside a message: the times of a million frames take 16 MB."""


class Broken(Exception):
    """The other side has closed, or does not keep to the form."""


def packed(message: Message, data: bytes = b"") -> bytes:
    text = json.dumps(message).encode()
    return HEADER.pack(len(text), len(data)) + text + data


def lengths(header: bytes) -> tuple[int, int]:
    """Of the text and of the bytes that follow a header. Raises Broken."""
    text_bytes, data_bytes = HEADER.unpack(header)
    if text_bytes > MAX_JSON_BYTES or data_bytes > MAX_BYTES:
        raise Broken("a message is too long")
    return text_bytes, data_bytes


def parsed(text: bytes) -> Message:
    """Raises Broken."""
    try:
        message = json.loads(text)
    except ValueError as error:
        raise Broken("a message is no JSON") from error
    if not isinstance(message, dict):
        raise Broken("a message is no object")
    return message


def send(wire: socket.socket, message: Message, data: bytes = b"") -> None:
    """Raises OSError."""
    wire.sendall(packed(message, data))


def receive(wire: socket.socket) -> tuple[Message, bytes]:
    """The next message. Raises Broken, TimeoutError (the socket's own), OSError."""
    text_bytes, data_bytes = lengths(_exactly(wire, HEADER.size))
    return parsed(_exactly(wire, text_bytes)), _exactly(wire, data_bytes)


def _exactly(wire: socket.socket, size: int) -> bytes:
    parts, left = [], size
    while left:
        part = wire.recv(min(left, 1 << 20))
        if not part:
            raise Broken("the other side has closed")
        parts.append(part)
        left -= len(part)
    return b"".join(parts)
