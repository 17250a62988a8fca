"""Binary messages in both directions: a big-endian header of 32 bytes, then the encoded frame, or sound for viewers."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from service.errors import BadMessage

VERSION = 1
_HEADER = struct.Struct(">BBHHHIIQQ")
HEADER_BYTES = _HEADER.size
_KEY = 1
_SOUND = 2
MAX_SOUND_BYTES = 4000
"""Longest packet of sound: Opus at 510 kbit/s needs 1,275 bytes for 20 ms."""
_MOST_US = (1 << 32) - 1


@dataclass(frozen=True)
class Header:
    key: bool
    width: int
    height: int
    sequence: int
    timestamp: int
    latency_us: int = 0
    """Microseconds from the frame's arrival to the sending of its answer; 0 in messages to the service."""


def unpack(message: bytes) -> tuple[Header, bytes]:
    """Header and payload of a binary message. Raises BadMessage."""
    if len(message) <= HEADER_BYTES:
        raise _bad("A frame is a header of 32 bytes and a payload.", "frame", f"{len(message)} bytes")
    version, flags, width, height, zero, sequence, latency, timestamp, zeros = _HEADER.unpack_from(message)
    if version != VERSION:
        raise _bad(f"Frames have version {VERSION}.", "frame.version", version)
    if flags & ~_KEY or zero or latency or zeros:
        raise _bad("Unused bits and fields of a frame's header are 0.", "frame.flags", f"{flags:#04x}")
    return Header(bool(flags & _KEY), width, height, sequence, timestamp), message[HEADER_BYTES:]


def pack(header: Header, payload: bytes) -> bytes:
    """A binary message."""
    latency_us = min(header.latency_us, _MOST_US)
    flags = _KEY if header.key else 0
    head = _HEADER.pack(
        VERSION, flags, header.width, header.height, 0, header.sequence, latency_us, header.timestamp, 0
    )
    return head + payload


def is_sound(message: bytes) -> bool:
    """Whether a binary message is a packet of sound instead of a frame. Raises BadMessage if its form is wrong."""
    if len(message) <= HEADER_BYTES or not message[1] & _SOUND:
        return False
    version, flags, channels, height, zero, _sequence, latency, _timestamp, zeros = _HEADER.unpack_from(message)
    if version != VERSION or flags != _SOUND or height or zero or latency or zeros:
        raise _bad("Unused bits and fields of a packet of sound are 0.", "sound.flags", f"{flags:#04x}")
    if channels not in (1, 2):
        raise _bad("Sound has one or two channels.", "sound.channels", channels)
    if len(message) > HEADER_BYTES + MAX_SOUND_BYTES:
        raise _bad(f"A packet of sound has at most {MAX_SOUND_BYTES} bytes.", "sound", f"{len(message)} bytes")
    return True


def _bad(message: str, field: str, value: object) -> BadMessage:
    return BadMessage(message, field=field, value=value, remedy="See docs/live.md, Frames.")
