"""What travels between a session and the process that paints for it. Plain data, pickled to Ray actors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from workers.model import Json

Size = tuple[int, int]
"""(width, height), px."""


@dataclass(frozen=True)
class Packet:
    """A frame as it came from the client."""

    sequence: int
    timestamp: int
    """The client's, of any meaning; comes back unchanged."""
    size: Size
    """Width and height according to its header."""
    key: bool
    data: bytes
    at_s: float
    """When it was fully received, seconds of the session's clock."""


@dataclass(frozen=True)
class WireFormat:
    """How frames travel on one connection."""

    send: str
    """Codec of the client's frames."""
    receive: str
    """Codec of ours."""
    quality: int = 85
    """1 to 100, of our pictures."""
    fps: float = 30.0
    """Nominal rate, for encoders."""


@dataclass(frozen=True)
class LiveOrder:
    """All that a painter needs to begin, or to go on in another process."""

    method: str
    params: Mapping[str, Json]
    """Complete, with defaults."""
    seed: int
    inputs: Mapping[str, str]
    """Input name -> blob key of what the method refers to."""
    size: Size
    """To work at."""
    wire: WireFormat
    max_side_px: int = 1920
    """Longest side of a picture that is decoded."""


@dataclass(frozen=True)
class FrameRequest:
    """One frame to paint."""

    payloads: tuple[bytes, ...]
    """Payloads: last the frame to paint; before it the frames that it is built on and that are not painted (video
    codecs)."""
    size: Size
    """Of the frame's picture."""
    work_size: Size
    """To paint at."""
    key: bool = False
    """The answer shall be a key frame."""


@dataclass(frozen=True)
class RenderedFrame:
    """An answer's picture."""

    data: bytes
    size: Size
    key: bool
    stages_s: Mapping[str, float] = field(default_factory=dict)
    """Seconds of "decode", "look", "paint", "encode"."""
