"""A frame on the wire, as the client packs and unpacks it: docs/live.md, Frames."""

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
    """A painted frame."""

    sequence: int
    """That of the frame it was made from."""
    timestamp: int
    """As it was sent."""
    size: tuple[int, int]
    """(width, height) of its picture, px: smaller than what was sent when the service steps down."""
    key: bool
    latency_us: int
    """What the service took: from the frame fully received to its answer sent."""
    payload: bytes


def pack(payload: bytes, size: tuple[int, int], key: bool, sequence: int, timestamp: int) -> bytes:
    """A frame for the service."""
    width, height = size
    return _HEADER.pack(VERSION, _KEY if key else 0, width, height, 0, sequence, 0, timestamp, 0) + payload


def unpack(message: bytes) -> Answer:
    """A frame from the service. Raises BadFrame."""
    if len(message) <= HEADER_BYTES or message[0] != VERSION:
        raise BadFrame(
            "The service sent a frame of another version.", field="frame.version",
            value=message[0] if message else "nothing", remedy="Use the same release of Impasto at both ends.",
        )  # fmt: skip
    _, flags, width, height, _, sequence, latency, timestamp, _ = _HEADER.unpack_from(message)
    return Answer(sequence, timestamp, (width, height), bool(flags & _KEY), latency, message[HEADER_BYTES:])
