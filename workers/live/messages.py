"""Frames, paintings and errors as messages between processes: JSON and bytes, nothing executable."""

from __future__ import annotations

from itertools import accumulate, pairwise

from pipeline import errors
from pipeline.errors import ImpastoError
from pipeline.video.guard.wire import Message, packed
from workers.live.model import FrameRequest, RenderedFrame

ANALYZED = packed({"analyzed": True})
_KINDS = {kind.__name__: kind for kind in vars(errors).values() if isinstance(kind, type)}


def encode_request(work: FrameRequest) -> bytes:
    message = {
        "payloads": [len(payload) for payload in work.payloads],
        "size": work.size,
        "work_size": work.work_size,
        "key": work.key,
    }
    return packed(message, b"".join(work.payloads))


def decode_request(message: Message, data: bytes) -> FrameRequest:
    bounds = pairwise(accumulate(message["payloads"], initial=0))
    payloads = tuple(data[begin:end] for begin, end in bounds)
    return FrameRequest(payloads, tuple(message["size"]), tuple(message["work_size"]), message["key"])


def encode_frame(painted: RenderedFrame) -> bytes:
    return packed({"size": painted.size, "key": painted.key, "stages_s": dict(painted.stages_s)}, painted.data)


def decode_frame(message: Message, data: bytes) -> RenderedFrame:
    return RenderedFrame(data, tuple(message["size"]), message["key"], message["stages_s"])


def encode_error(error: Exception) -> bytes:
    """Errors of this package are sent with all their fields; of other errors, the class name and the message."""
    if not isinstance(error, ImpastoError):
        return packed({"error": "", "message": f"{type(error).__name__}: {error}"})
    parts = {"message": error.message, "field": error.field, "value": error.value, "remedy": error.remedy}
    return packed({"error": type(error).__name__, **parts})


def decode_error(message: Message) -> Exception:
    if not message["error"]:
        return RuntimeError(message["message"])
    kind = _KINDS.get(message["error"], ImpastoError)
    return kind(message["message"], field=message["field"], value=message["value"], remedy=message["remedy"])  # type: ignore[no-any-return]
