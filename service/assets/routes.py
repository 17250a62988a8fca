"""/v1/assets: upload a file in one request, list, describe, download, delete."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

from fastapi import Query, Request, Response
from starlette.concurrency import run_in_threadpool

from service.access.admission import Cost, costs
from service.access.keys import Principal
from service.assets.adopt import adopt, disk_faults, upload_folder
from service.assets.multipart import FileReceiver
from service.assets.sequences import SequenceQuery, with_options
from service.bodies import chunks
from service.context.depends import Context, Reader, ServiceContext, Submitter
from service.routing import Router
from service.schemas import AssetId, Cursor, Download, Limit, Listing, Responses, binary
from service.serving import serve
from workers.contract.record import Asset
from workers.errors import NotFound
from workers.farm_parts.stored_file import asset_file

router = Router(prefix="/v1/assets", tags=["assets"])

JPEG: Responses = {200: binary("image/jpeg", "The frame")[200]}
FORM_BYTES = 64 * 1024
"""Bytes that a multipart form may add to its file."""
FORM = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {"file": {"type": "string", "format": "binary"}},
                }
            }
        },
    }
}


@router.post("", status_code=201, openapi_extra=FORM, responses={200: {"model": Asset, "description": "Known"}})
async def upload(
    request: Request, response: Response, context: Context, caller: Submitter,
    sequence: Annotated[SequenceQuery, Query()],
) -> Asset:  # fmt: skip
    """Upload one file (field `file`). 201 with Location, or 200 when you have uploaded these bytes before.

    Options of an image sequence are stored in its zip, as `sequence.json`.
    """
    with tempfile.TemporaryDirectory(dir=await run_in_threadpool(upload_folder, context)) as folder:
        received = await _receive(request, context, Path(folder) / "file")
        sha256 = received.sha256
        if options := sequence.options():
            sha256 = await run_in_threadpool(with_options, received.path, received.filename, options)
        file = (received.path, received.filename, sha256)
        async with context.admission.one(Cost.READING, caller):
            asset, new = await run_in_threadpool(adopt, context, caller, *file)
    response.headers["Location"] = f"/v1/assets/{asset.id}"
    response.status_code = 201 if new else 200
    return asset


async def _receive(request: Request, context: ServiceContext, path: Path) -> FileReceiver:
    receiver = FileReceiver(request.headers.get("content-type", ""), path)
    try:
        with disk_faults():
            async for chunk in chunks(request, context.settings.max_asset_bytes + FORM_BYTES, context.settings.idle_s):
                await run_in_threadpool(receiver.feed, chunk)
    finally:
        receiver.close()
    receiver.finish()
    return receiver


@router.get("")
def list_assets(context: Context, caller: Reader, cursor: Cursor = None, limit: Limit = 50) -> Listing[Asset]:
    """Your assets, newest first."""
    page = context.farm.assets.page(caller.reach, cursor=cursor, limit=limit)
    return Listing(page.items, page.cursor)


@router.get("/{asset_id}")
def get_asset(asset_id: AssetId, context: Context, caller: Reader) -> Asset:
    """An asset: type, size, dimensions, duration."""
    return visible(context, caller, asset_id)


@router.head("/{asset_id}/content", include_in_schema=False)
@router.get(
    "/{asset_id}/content",
    response_class=Response,
    responses=binary("*/*", "The bytes as uploaded"),
)
def get_content(
    asset_id: AssetId, request: Request, context: Context, caller: Reader, download: Download = False
) -> Response:
    """The file, whole or a range of it."""
    return serve(context, asset_file(visible(context, caller, asset_id)), request, download)


@router.get("/{asset_id}/frame", response_class=Response, responses=JPEG)
@costs(Cost.FRAMES)
def get_frame(
    asset_id: AssetId,
    context: Context,
    caller: Reader,
    index: Annotated[int, Query(ge=0, le=10_000_000, description="Which frame, from 0; beyond the end: the last.")] = 0,
    max_side_px: Annotated[int, Query(ge=16, le=2048, description="Its longer side at most; never enlarged.")] = 720,
) -> Response:
    """One frame, decoded by the service, for videos that a browser cannot play. 503 while all slots are in use."""
    visible(context, caller, asset_id)
    jpeg = context.farm.assets.frame(asset_id, caller.reach, index, max_side_px)
    return Response(jpeg, media_type="image/jpeg", headers={"Cache-Control": "private, max-age=3600"})


@router.delete("/{asset_id}", status_code=204)
def delete_asset(asset_id: AssetId, context: Context, caller: Submitter) -> None:
    """Delete an asset. 409 while an unfinished job uses it."""
    visible(context, caller, asset_id)
    context.farm.assets.delete(asset_id, caller.reach)


def visible(context: ServiceContext, caller: Principal, asset_id: str, field: str = "asset_id") -> Asset:
    """The asset as the caller uploaded it. Raises NotFound, also for assets of other owners only."""
    try:
        return context.farm.assets.get(asset_id, caller.reach)
    except NotFound:
        raise NotFound(
            "Asset not found.", field=field, value=asset_id, remedy="See GET /v1/assets for yours."
        ) from None
