"""Messages between a session and the process that paints for it. Plain data, pickled to Ray actors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from workers.contract.request import Json

Size = tuple[int, int]
"""(width, height), px."""


@dataclass(frozen=True)
class Packet:
    """A frame as it came from the client."""

    sequence: int
    timestamp: int
    """Number that the client chose; it is returned unchanged."""
    size: Size
    """Width and height according to its header."""
    key: bool
    data: bytes
    at_s: float
    """Time at which the frame was fully received, seconds of the session's clock."""


@dataclass(frozen=True)
class WireFormat:
    """Encoding of frames on one connection."""

    send: str
    """Codec of the frames that the client sends."""
    receive: str
    """Codec of the painted frames."""
    quality: int = 85
    """Quality of the painted frames, 1 to 100."""
    fps: float = 30.0
    """Nominal frame rate, for encoders."""


@dataclass(frozen=True)
class FilterOrder:
    """A filter of the painted frames."""

    method: str
    """A method with a `live_filter`."""
    params: Mapping[str, Json]
    """Complete, with defaults."""


@dataclass(frozen=True)
class LiveOrder:
    """Everything a worker needs to start a stream, or to continue it in another process."""

    method: str
    params: Mapping[str, Json]
    """Complete, with defaults."""
    seed: int
    inputs: Mapping[str, str]
    """Input name -> blob key of a reference of the method."""
    size: Size
    """(width, height) at which frames are analyzed, px."""
    wire: WireFormat
    max_side_px: int = 1920
    """Maximum side of a decoded picture, px."""
    filter: FilterOrder | None = None


@dataclass(frozen=True)
class FrameRequest:
    """One frame to paint."""

    payloads: tuple[bytes, ...]
    """Payloads: the frame to paint is the last one; the others are unpainted frames on which it depends (video
    codecs)."""
    size: Size
    """(width, height) of the frame, px."""
    work_size: Size
    """(width, height) at which the frame is analyzed, px."""
    key: bool = False
    """Whether the answer must be a key frame."""


@dataclass(frozen=True)
class RenderedFrame:
    """An answer's picture."""

    data: bytes
    size: Size
    key: bool
    stages_s: Mapping[str, float] = field(default_factory=dict)
    """Seconds of "decode", "analyze", "paint", "filter" (only with a filter), "encode"."""
