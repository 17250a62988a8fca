"""Preview queries, and the records of an answer. Plain data that is sent between processes."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from pydantic import JsonValue

from pipeline.compositing import Blend
from pipeline.errors import ImpastoError
from pipeline.video.media import SourceOptions
from workers.contract.request import Json

SINGLE = "single"
"""Kind of a preview of one frame of a job that is not submitted: without a project and layers."""
MEDIA_TYPE = "application/vnd.impasto.records"


_READ_AS = "\n"
"""Between the blob key of a video and how it is read; blob keys are one line."""


def video_key(blob: str, source: SourceOptions) -> str:
    """The key of a video's frames: its blob key, and how it is read."""
    return blob if source == SourceOptions() else f"{blob}{_READ_AS}{json.dumps(source.as_json(), sort_keys=True)}"


def of_video_key(key: str) -> tuple[str, SourceOptions]:
    """The inverse of `video_key`."""
    blob, _, source = key.partition(_READ_AS)
    return blob, SourceOptions.from_json(json.loads(source) if source else None)


@dataclass(frozen=True)
class LayerSources:
    """A layer of a shot with all inputs of its method.

    Attributes:
        video: `video_key` of the layer's video.
        files: blob keys of inputs that are files, by input name.
        images: input -> frame -> blob key or bytes of the image, for inputs that are images by frame.
        documents: inputs that are JSON, parsed.
    """

    id: str
    method: str
    params: Mapping[str, object]
    seed: int
    video: str
    files: Mapping[str, str] = field(default_factory=dict)
    images: Mapping[str, Mapping[int, str | bytes]] = field(default_factory=dict)
    documents: Mapping[str, JsonValue] = field(default_factory=dict)
    opacity: float = 1.0
    blend: Blend = "over"
    matte: str | None = None
    """Blob key of the matte, gray pictures: white where the layer is visible."""
    below: str = ""
    """`video_key` of the shot's video, over which the backmost layer lies."""

    @cached_property
    def digest(self) -> str:
        """A key that is equal for layers with equal pictures."""
        what = (self.method, dict(self.params), self.seed, self.video, dict(self.files), dict(self.images),
                dict(self.documents))  # fmt: skip
        return hashlib.sha256(repr(what).encode()).hexdigest()


@dataclass(frozen=True)
class PreviewQuery:
    """One request.

    Attributes:
        what: kind of the preview: a key of `workers.previews.engine.kinds()`, or SINGLE.
        project: id of the project.
        client, channel, seq: a request cancels earlier ones, with lower `seq`, of the same client and channel.
        layers: from back to front; at least one, except for SINGLE.
        side_px: longest side of the answer's pictures.
        options: further arguments of the kind, checked by the service.
    """

    what: str
    project: str
    client: str
    channel: str
    seq: int
    layers: tuple[LayerSources, ...]
    side_px: int
    options: Json = field(default_factory=dict)


@dataclass(frozen=True)
class Record:
    """A record of an answer: a JSON header, whose `type` names its kind, and bytes."""

    header: Mapping[str, object]
    payload: bytes = b""

    def encode(self) -> bytes:
        """Length of the header as 4 bytes, big-endian; the header with `bytes`, the payload's length; the payload."""
        header = json.dumps({**self.header, "bytes": len(self.payload)}, separators=(",", ":")).encode()
        return struct.pack(">I", len(header)) + header + self.payload


class Overtaken(ImpastoError):
    """A later request of the same client and channel has arrived; `by` is its number."""

    code = "overtaken"

    def __init__(self, by: int) -> None:
        super().__init__("A later request has come.", field="seq", value=by)
        self.by = by

    def __reduce__(self) -> tuple[object, ...]:
        return Overtaken, (self.by,)
