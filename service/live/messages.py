"""Models of the JSON messages of docs/live.md."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from pipeline.errors import BadParameter, ImpastoError
from pipeline.method_names import DEFAULT, DEFAULT_FILTER
from service.errors import BadMessage, Problem
from workers.contract.request import MAX_SEED, Json
from workers.live.codecs import webcodecs_name
from workers.strict_json import BadJson, strict_json

VERSION = 1
MAX_VALUES = 10_000
"""Values in one message."""
Codecs = Annotated[list[str], Field(min_length=1, max_length=16)]


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class FilterIn(_Message):
    """A filter of the painted frames."""

    method: str = DEFAULT_FILTER
    params: Json = {}


class Hello(_Message):
    """The client's first message."""

    type: Literal["hello"]
    method: str = DEFAULT
    params: Json = {}
    inputs: dict[str, str] = {}
    """Asset ids by input name."""
    seed: int = Field(default=0, ge=0, le=MAX_SEED)
    width: int
    height: int
    fps: float = 30.0
    send: Codecs = ["jpeg"]
    receive: Codecs = ["jpeg"]
    quality: int = Field(default=85, ge=1, le=100)
    prefer: Literal["fluent", "sharp"] = "fluent"
    """Property that stays constant when frames take too long: the frame rate ("fluent") or the working size
    ("sharp")."""
    filter: FilterIn | None = None


class ParamsIn(_Message):
    type: Literal["params"]
    params: Json = {}
    inputs: dict[str, str | None] = {}
    filter: FilterIn | None = None
    """Null removes the filter; a message without this field does not change it."""


class KeyframeIn(_Message):
    type: Literal["keyframe"]


class ByeIn(_Message):
    type: Literal["bye"]


Incoming = Hello | ParamsIn | KeyframeIn | ByeIn
_INCOMING: TypeAdapter[Incoming] = TypeAdapter(Annotated[Incoming, Field(discriminator="type")])


class Sending(BaseModel):
    """Codec of the frames that the client sends."""

    codec: str
    format: str | None = None


class Receiving(Sending):
    """Codec of the frames that the client receives."""

    webcodecs: str | None = None
    """The codec string for a browser's VideoDecoder."""


FORMATS = {"h264": "annexb"}


def receiving(codec: str, size: tuple[int, int], fps: float) -> Receiving:
    """Encoding of the frames that a client receives; `size` = (width, height), px."""
    return Receiving(codec=codec, format=FORMATS.get(codec), webcodecs=webcodecs_name(codec, size, fps))


class FilterOut(BaseModel):
    method: str
    params: Json


class ReadyOut(BaseModel):
    type: Literal["ready"] = "ready"
    version: int = VERSION
    session: str
    resumed: bool
    method: str
    params: Json
    filter: FilterOut | None = None
    prefer: str
    send: Sending
    receive: Receiving
    width: int
    height: int
    fps: float
    deadline_ms: float


class ParamsOut(BaseModel):
    type: Literal["params"] = "params"
    params: Json
    inputs: dict[str, str]
    filter: FilterOut | None = None


class SizeOut(BaseModel):
    """The reason for the working size."""

    reason: str
    """"slow" (missed deadlines), "room" (spare time) or "input" (size of the incoming frames)."""
    latency_ms: float | None = None
    """Delay that 95 % of the frames at the previous working size did not exceed, ms."""
    deadline_ms: float | None = None


class Stats(BaseModel):
    """Figures of the last second, or of the session."""

    type: Literal["stats"] = "stats"
    received: int
    painted: int
    dropped: int
    fps: float
    width: int
    height: int
    scale: float
    size: SizeOut
    latency_ms: dict[str, float]
    stages_ms: dict[str, float]


class Resolution(BaseModel):
    type: Literal["resolution"] = "resolution"
    width: int
    height: int
    scale: float
    reason: str
    latency_ms: float | None = None
    deadline_ms: float | None = None


class ReplacedOut(BaseModel):
    type: Literal["replaced"] = "replaced"
    reason: str


class KeyframeOut(BaseModel):
    type: Literal["keyframe"] = "keyframe"
    reason: str


class ErrorOut(BaseModel):
    type: Literal["error"] = "error"
    fatal: bool
    problem: Problem
    retry_after_s: float | None = None


class ByeOut(BaseModel):
    type: Literal["bye"] = "bye"
    stats: Stats


class ViewReadyOut(BaseModel):
    """Message to a viewer: encoding of the frames that follow."""

    type: Literal["ready"] = "ready"
    version: int = VERSION
    session: str
    receive: Receiving
    width: int
    height: int
    fps: float


class ViewWaitingOut(BaseModel):
    """Message to a viewer: no session can be watched now."""

    type: Literal["waiting"] = "waiting"


Outgoing = (
    ViewReadyOut
    | ViewWaitingOut
    | ReadyOut
    | ParamsOut
    | Stats
    | Resolution
    | ReplacedOut
    | KeyframeOut
    | ErrorOut
    | ByeOut
)


def parse(text: str) -> Incoming:
    """A text message of the client.

    Raises:
        BadMessage: not a JSON object, or of an unknown type.
        BadParameter: a field is missing, unknown or invalid.
    """
    try:
        data = strict_json(text.encode(), MAX_VALUES)
    except (BadJson, UnicodeEncodeError):
        raise BadMessage(
            "Text messages must be JSON.", field="message", value=text[:80], remedy="See docs/live.md for the messages."
        ) from None
    try:
        return _INCOMING.validate_python(data)
    except ValidationError as error:
        raise _fault(error) from None


def _fault(error: ValidationError) -> ImpastoError:
    first = error.errors()[0]
    if not first["loc"]:
        kinds = "hello, params, keyframe, bye"
        return BadMessage(
            "Unknown message type.", field="type", value=first["input"], remedy=f"Its type is one of: {kinds}."
        )
    kind, *names = (str(part) for part in first["loc"])
    field = ".".join(names) or kind
    if first["type"] == "missing":
        return BadParameter(f"{field} is missing.", field=field, remedy=f"Add {field} to {kind!r}.")
    if first["type"] == "extra_forbidden":
        return BadParameter(f"Unknown field {field!r} in {kind!r}.", field=field, remedy="Leave it out.")
    return BadParameter(f"{field} is not valid.", field=field, value=first["input"], remedy=f"{first['msg']}.")
