"""/v1/projects/{project_id}/previews: pictures of a project that is being edited, as a stream of records.

    record = length of the header (4 bytes, big-endian) | header (JSON) | `header.bytes` bytes

The first record has the type "begin", the last "end", "overtaken" or "error".
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Generator
from contextlib import aclosing
from typing import Annotated, Any, Literal, Self, cast

import anyio
from anyio import CapacityLimiter
from pydantic import Base64Bytes, BaseModel, ConfigDict, Field, model_validator
from starlette.concurrency import run_in_threadpool
from starlette.responses import StreamingResponse

from pipeline.errors import BadParameter, Cancelled, ImpastoError
from pipeline.methods.parts import FrameNumber, FrameRange, Id, Ratio
from service.access.admission import Cost
from service.access.keys import Principal
from service.context.depends import Context, ServiceContext, Submitter
from service.errors import internal_error, problem
from service.jobs.lookup import find_job
from service.projects.lookup import find_project
from service.projects.schemas import ProjectId
from service.routing import Router
from service.schemas import JobId, Responses
from service.streaming import StreamedResponse, in_threads
from workers.blobs.keys import NoBlob
from workers.contract.request import Json
from workers.errors import NotFound
from workers.previews.model import MEDIA_TYPE, PreviewQuery, Record
from workers.previews.service import SLOT_POLL_S, PreviewRun
from workers.projects.patching import merged, patched

router = Router(prefix="/v1/projects/{project_id}/previews", tags=["previews"])

_BYTES = {"schema": {"type": "string", "format": "binary"}}
STREAM: Responses = {200: {"description": "Records", "content": {MEDIA_TYPE: _BYTES}}}
MOST_FRAMES = 48
Text = Annotated[str, Field(min_length=1, max_length=100)]


class QueryIn(BaseModel):
    """Fields that all preview requests share."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    client: Text = "script"
    channel: Text = "stage"
    seq: int = Field(default=0, ge=0, le=2**53 - 1, description="Overtakes lower ones of this client and channel.")
    version: int | None = Field(default=None, ge=1, description="None: the newest, or `document`.")
    document: Json | None = Field(default=None, description="Instead of a stored version.")
    change: list[Json] | Json | None = Field(
        default=None, description="JSON Patch, or JSON Merge Patch, on the stored version."
    )
    shot: Id
    layer: Id | None = Field(default=None, description="None: all visible layers.")
    max_side_px: int = Field(default=640, ge=16, le=4096)
    format: Literal["png", "jpeg"] = "png"


class PaintIn(QueryIn):
    frame: FrameNumber = 0
    frames: FrameRange | None = Field(default=None, description=f"At most {MOST_FRAMES}.")
    step: int = Field(default=1, ge=1, le=1000)
    crop: tuple[FrameNumber, FrameNumber, FrameNumber, FrameNumber] | None = Field(
        default=None, description="x, y, width, height in px of the video: that piece at full resolution."
    )
    coarse: bool = Field(default=True, description="A coarse picture first.")


class CardIn(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    id: Text
    set: Json = Field(description="JSON Merge Patch on the layer.")


class StylesIn(QueryIn):
    frame: FrameNumber = 0
    max_side_px: int = Field(default=200, ge=16, le=1024)
    cards: tuple[CardIn, ...] = Field(min_length=1, max_length=24)


class PropagateIn(QueryIn):
    key: FrameNumber = Field(description="The frame that is painted on.")
    image: Base64Bytes | None = Field(default=None, description="PNG of the present key; None: the document's.")
    around: int = Field(default=3, ge=1, le=24, description="Frames before and after it.")
    max_side_px: int = Field(default=320, ge=16, le=2048)


@router.post("/propagate", response_class=StreamingResponse, responses=STREAM)
async def preview_propagate(
    project_id: ProjectId, body: PropagateIn, context: Context, caller: Submitter
) -> StreamingResponse:
    """The frames around a painted key, made from it."""
    options = {"key": body.key, "around": body.around, "image": body.image, "format": body.format}
    return await _answer(context, caller, project_id, "propagate", body, options)


class RegionsIn(QueryIn):
    frame: FrameNumber = 0
    film: bool = Field(default=False, description="The layer's own regions as the film has them, instead of tubes.")


class DirectionsIn(QueryIn):
    frame: FrameNumber = 0
    spacing_px: int = Field(default=12, ge=2, le=200, description="Between two points of the grid, px of the preview.")


class KeysIn(QueryIn):
    frames: FrameRange | None = Field(default=None, description="None: the whole video.")
    count: int = Field(default=8, ge=1, le=100)


class CutsIn(QueryIn):
    pass


class FlickerIn(QueryIn):
    frame: FrameNumber = 0
    frames: FrameRange | None = Field(
        default=None, description=f"Figures of these instead of one map; of previews at most {MOST_FRAMES}."
    )
    count: int = Field(default=120, ge=1, le=600, description="Figures of at most as many frames, evenly spread.")
    film: JobId | None = Field(default=None, description="A finished film of the shot. None: previews are measured.")


class ClustersIn(QueryIn):
    pass


class SpreadIn(QueryIn):
    frame: FrameNumber = 0
    around: int = Field(default=6, ge=0, le=24, description="Frames after it.")
    max_side_px: int = Field(default=256, ge=16, le=1024)


Box = Annotated[
    tuple[Ratio, Ratio, Ratio, Ratio],
    Field(description="Left, top, right, bottom, as shares of the frame's sides: around the object, or a point on it."),
]


class ObjectIn(QueryIn):
    frame: FrameNumber = 0
    box: Box


Width = Annotated[float, Field(gt=0, le=1)]


class ObjectMarkIn(BaseModel):
    """A click on an object, or a box around it; or a stroke, which is painted."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    frame: FrameNumber
    box: Box | None = Field(default=None, description="None: a stroke is given.")
    stroke: tuple[tuple[Ratio, Ratio, Width], ...] = Field(
        default=(), max_length=10_000, description="Points of a painted line, as shares of the frame's sides, each "
        "with the width there as a share of the frame's width.",
    )  # fmt: skip
    erase: bool = Field(default=False, description="Take it away from the matte instead of adding it.")

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.box is None) == (not self.stroke):
            raise ValueError("Give either a box or a stroke.")
        return self


class MatteIn(QueryIn):
    frames: FrameRange | None = Field(default=None, description="None: the whole video.")
    frame: FrameNumber | None = Field(
        default=None, description="The frame whose mask is wanted first: it comes at once if the objects need not be "
        "followed to it, or have been.",
    )  # fmt: skip
    marks: tuple[ObjectMarkIn, ...] = Field(min_length=1, max_length=500)


@router.post("/object", response_class=StreamingResponse, responses=STREAM)
async def preview_object(
    project_id: ProjectId, body: ObjectIn, context: Context, caller: Submitter
) -> StreamingResponse:
    """The object of a frame of the video that is clicked, or in a box: a mask."""
    return await _answer(context, caller, project_id, "object", body, {"frame": body.frame, "box": body.box})


@router.post("/matte", response_class=StreamingResponse, responses=STREAM)
async def preview_matte(project_id: ProjectId, body: MatteIn, context: Context, caller: Submitter) -> StreamingResponse:
    """The matte of clicked objects in every frame of the video: masks at its size, as a layer's `matte` takes them."""
    return await _answer(
        context, caller, project_id, "matte", body, body.model_dump(include={"frames", "frame", "marks"})
    )


@router.post("/clusters", response_class=StreamingResponse, responses=STREAM)
async def preview_clusters(
    project_id: ProjectId, body: ClustersIn, context: Context, caller: Submitter
) -> StreamingResponse:
    """Clusters of every frame as a job finds them, before a film is painted."""
    return await _answer(context, caller, project_id, "clusters", body, {})


@router.post("/spread", response_class=StreamingResponse, responses=STREAM)
async def preview_spread(
    project_id: ProjectId, body: SpreadIn, context: Context, caller: Submitter
) -> StreamingResponse:
    """The foreground of a frame and of those after it, spread from scribbles; or marks that move with the picture."""
    return await _answer(context, caller, project_id, "spread", body, {"frame": body.frame, "around": body.around})


@router.post("/regions", response_class=StreamingResponse, responses=STREAM)
async def preview_regions(
    project_id: ProjectId, body: RegionsIn, context: Context, caller: Submitter
) -> StreamingResponse:
    """Tubes and objects of a frame, with the numbers that jobs find: a map, and a list."""
    options = {"frame": body.frame, "film": body.film}
    return await _answer(context, caller, project_id, "regions", body, options)


@router.post("/directions", response_class=StreamingResponse, responses=STREAM)
async def preview_directions(
    project_id: ProjectId, body: DirectionsIn, context: Context, caller: Submitter
) -> StreamingResponse:
    """Stroke directions of a frame on a grid."""
    options = {"frame": body.frame, "spacing_px": body.spacing_px}
    return await _answer(context, caller, project_id, "directions", body, options)


@router.post("/keys", response_class=StreamingResponse, responses=STREAM)
async def preview_keys(project_id: ProjectId, body: KeysIn, context: Context, caller: Submitter) -> StreamingResponse:
    """Frames that are worth a painted key, and the scores of every frame."""
    return await _answer(context, caller, project_id, "keys", body, {"frames": body.frames, "count": body.count})


@router.post("/cuts", response_class=StreamingResponse, responses=STREAM)
async def preview_cuts(project_id: ProjectId, body: CutsIn, context: Context, caller: Submitter) -> StreamingResponse:
    """Hard cuts of the layer's video, as a job finds them."""
    return await _answer(context, caller, project_id, "cuts", body, {})


@router.post("/flicker", response_class=StreamingResponse, responses=STREAM)
async def preview_flicker(
    project_id: ProjectId, body: FlickerIn, context: Context, caller: Submitter
) -> StreamingResponse:
    """Map of the flicker of one painted frame relative to its source, or the flicker of several frames."""
    options = body.model_dump(include={"frame", "frames", "count"})
    if body.film is not None:
        options |= await run_in_threadpool(_film, context, caller, body.film)
    elif body.frames is not None and body.frames[1] - body.frames[0] > MOST_FRAMES:
        raise BadParameter("These are too many frames to paint for a preview.", field="frames",
                           value=list(body.frames), remedy=f"Name at most {MOST_FRAMES}, or a film.")  # fmt: skip
    return await _answer(context, caller, project_id, "flicker", body, options)


@router.post("/paint", response_class=StreamingResponse, responses=STREAM)
async def preview_paint(project_id: ProjectId, body: PaintIn, context: Context, caller: Submitter) -> StreamingResponse:
    """Painted frames, coarse first."""
    options = body.model_dump(include={"frame", "frames", "step", "crop", "coarse", "format"})
    return await _answer(context, caller, project_id, "paint", body, options)


@router.post("/source", response_class=StreamingResponse, responses=STREAM)
async def preview_source(
    project_id: ProjectId, body: PaintIn, context: Context, caller: Submitter
) -> StreamingResponse:
    """Unchanged frames of the shot's video."""
    options = body.model_dump(include={"frame", "frames", "step", "format"})
    return await _answer(context, caller, project_id, "source", body, options)


@router.post("/styles", response_class=StreamingResponse, responses=STREAM)
async def preview_styles(
    project_id: ProjectId, body: StylesIn, context: Context, caller: Submitter
) -> StreamingResponse:
    """One frame of a layer in several styles."""
    return await _answer(context, caller, project_id, "styles", body, {"frame": body.frame, "format": body.format})


@router.get("/state")
def preview_state(project_id: ProjectId, context: Context, caller: Submitter) -> Json:
    """Size of the preview cache, and the process that makes previews."""
    find_project(context, caller, project_id)
    return context.farm.previews.state()


def _film(context: ServiceContext, caller: Principal, job_id: str) -> Json:
    """Blob key of a finished film, and the frame of the video with which it begins."""
    job = find_job(context, caller, job_id)
    first = job.request.frames[0] if job.request.frames else 0
    return {"film": context.farm.files.get(job_id, "result").key, "film_start": first}


async def _answer(
    context: ServiceContext, caller: Principal, project_id: str, what: str, body: QueryIn, options: Json
) -> StreamingResponse:
    async with context.admission.one(Cost.HEAVY, caller):
        query = await run_in_threadpool(_query, context, caller, project_id, what, body, options)
    run = context.farm.previews.start(query, caller.owner)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    pieces = _pieces(run, f"/v1/projects/{project_id}/previews/{what}", context.preview_threads)
    return StreamedResponse(pieces, 200, headers, MEDIA_TYPE, run.cancel)


async def _pieces(run: PreviewRun, path: str, threads: CapacityLimiter) -> AsyncGenerator[bytes]:
    """Yield the records of the answer. A preview has a thread only once it has a slot."""
    try:
        while not run.ready():
            await anyio.sleep(SLOT_POLL_S)
        async with aclosing(in_threads(_encoded(run, path), threads)) as pieces:
            async for piece in pieces:
                yield piece
    finally:
        run.close()


def _encoded(run: PreviewRun, path: str) -> Generator[bytes]:
    try:
        for record in run:
            yield record.encode()
    except Cancelled:
        return
    except Exception as error:
        shown = problem(_as_impasto_error(error, path), path).model_dump(exclude_none=True)
        yield Record({"type": "error", "problem": shown}).encode()


def _as_impasto_error(error: Exception, path: str) -> ImpastoError:
    """The error that the client gets in an answer that has begun."""
    if isinstance(error, NoBlob):
        return NotFound(
            "The bytes of a file of this project are lost.",
            field="document",
            value=str(error),
            remedy="Upload the file again.",
        )
    return error if isinstance(error, ImpastoError) else internal_error(path, error)


def _query(
    context: ServiceContext, caller: Principal, project_id: str, what: str, body: QueryIn, options: Json
) -> PreviewQuery:
    project = find_project(context, caller, project_id)
    value = _document(context, project_id, body)
    layers = context.farm.projects.layer_sources(project, value, body.shot, body.layer)
    if isinstance(body, StylesIn):
        options = {**options, "cards": _cards(context, project_id, value, body, caller)}
    return PreviewQuery(what, project_id, body.client, body.channel, body.seq, layers, body.max_side_px, options)


def _document(context: ServiceContext, project_id: str, body: QueryIn) -> Json:
    if body.document is not None:
        return body.document
    _, value = context.farm.projects.document(project_id, body.version)
    if body.change is None:
        return value
    changed = patched(value, body.change) if isinstance(body.change, list) else merged(value, body.change)
    return cast(Json, changed)


def _cards(
    context: ServiceContext, project_id: str, value: Json, body: StylesIn, caller: Principal
) -> list[tuple[str, Any]]:
    """(id, layer) of every card. Invalid changes of a card are reported as errors of the request."""
    project = find_project(context, caller, project_id)
    made = []
    for card in body.cards:
        shots = [_with_card(shot, body, card) if shot.get("id") == body.shot else shot for shot in value["shots"]]
        (layer, *_) = context.farm.projects.layer_sources(project, {**value, "shots": shots}, body.shot, body.layer)
        made.append((card.id, layer))
    return made


def _with_card(shot: Json, body: StylesIn, card: CardIn) -> Json:
    layers = shot.get("layers", [])
    wanted = body.layer or next((layer["id"] for layer in layers if layer.get("visible", True)), None)
    return {**shot, "layers": [merged(own, card.set) if own.get("id") == wanted else own for own in layers]}
