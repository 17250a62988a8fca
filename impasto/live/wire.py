"""Binary messages of the client: see docs/live.md, Frames."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from pipeline.errors import BadFrame

VERSION = 1
SUBPROTOCOL = "impasto.live.1"
_HEADER = struct.Struct(">BBHHHIIQQ")
HEADER_BYTES = _HEADER.size
_KEY = 1


@dataclass(frozen=True)
class Answer:
    """A stylised frame."""

    sequence: int
    """Sequence number of its source frame."""
    timestamp: int
    """Timestamp as sent."""
    size: tuple[int, int]
    """(width, height), px: smaller than sent while the service works at a lower resolution."""
    key: bool
    latency_us: int
    """Time from the frame's arrival at the service to the sending of its answer."""
    payload: bytes


def pack(payload: bytes, size: tuple[int, int], key: bool, sequence: int, timestamp: int) -> bytes:
    """A binary message with a frame for the service."""
    width, height = size
    return _HEADER.pack(VERSION, _KEY if key else 0, width, height, 0, sequence, 0, timestamp, 0) + payload


def unpack(message: bytes) -> Answer:
    """The frame in a binary message of the service. Raises BadFrame."""
    if len(message) <= HEADER_BYTES or message[0] != VERSION:
        raise BadFrame(
            "The service sent a frame of another version.", field="frame.version",
            value=message[0] if message else "nothing", remedy="Use the same release of Impasto at both ends.",
        )  # fmt: skip
    _, flags, width, height, _, sequence, latency, timestamp, _ = _HEADER.unpack_from(message)
    return Answer(sequence, timestamp, (width, height), bool(flags & _KEY), latency, message[HEADER_BYTES:])
