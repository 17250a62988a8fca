"""/v1/uploads: resumable upload by tus 1.0.0 (https://tus.io/protocols/resumable-upload).

Core, creation, creation-with-upload, expiration, termination, checksum. When the last byte has arrived the file is
probed and becomes an asset: the answer, and every later HEAD, names it in `Impasto-Asset`; refused media give a problem
instead, also at every later HEAD.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated

from fastapi import Path, Request, Response
from starlette.concurrency import run_in_threadpool

from service.access.admission import Cost
from service.access.keys import Principal
from service.assets.adopt import check_free_space, check_quota, disk_faults
from service.assets.upload_store import Upload, UploadStore
from service.context.depends import Context, Reader, ServiceContext, Submitter
from service.errors import BodyTooLarge, Locked
from service.routing import Router
from service.uploads.headers import (
    BODY_TYPE,
    EXTENSIONS,
    HASHES,
    VERSION,
    check_body_type,
    check_version,
    filename,
    http_date,
    sequence_options,
    whole_number,
)
from service.uploads.receive import append, finish
from workers.errors import NotFound, QuotaExceeded

router = Router(prefix="/v1/uploads", tags=["uploads"])

UploadId = Annotated[str, Path(pattern=r"^[A-Za-z0-9_-]{1,64}$", description="As Location said at creation.")]
BODY = {"requestBody": {"content": {BODY_TYPE: {"schema": {"type": "string", "format": "binary"}}}}}


@router.options("", status_code=204)
def options(context: Context) -> Response:
    """Versions, extensions and limits of this tus server."""
    return Response(
        status_code=204,
        headers={
            "Tus-Version": VERSION,
            "Tus-Extension": EXTENSIONS,
            "Tus-Max-Size": str(context.settings.max_asset_bytes),
            "Tus-Checksum-Algorithm": ",".join(HASHES),
        },
    )


@router.post("", status_code=201, openapi_extra=BODY)
async def create_upload(request: Request, context: Context, caller: Submitter) -> Response:
    """Create an upload of Upload-Length bytes. The body, if any, is its first part."""
    check_version(request.headers)
    store = _store(context)
    first = request.headers.get("content-length", "0") != "0" or "transfer-encoding" in request.headers
    if first:
        check_body_type(request.headers)
    upload = await run_in_threadpool(_create, request, context, store, caller)
    offset = await append(request, context, store, upload, 0) if first else 0
    upload = await _finish_if_whole(context, store, caller, upload, offset)
    headers = {"Location": f"/v1/uploads/{upload.id}"} | _state(store, upload, offset)
    return Response(status_code=201, headers=headers)


def _create(request: Request, context: ServiceContext, store: UploadStore, caller: Principal) -> Upload:
    length = whole_number(request.headers, "Upload-Length")
    if length > context.settings.max_asset_bytes:
        raise BodyTooLarge(
            f"A file may have {context.settings.max_asset_bytes} bytes.",
            field="Upload-Length",
            value=length,
            remedy="Upload a smaller file.",
        )
    metadata = request.headers.get("upload-metadata", "")
    name = filename(metadata)
    sequence_options(metadata)  # refuses wrong ones before the bytes arrive
    with disk_faults(), store.creating():
        reserved = store.reserved()
        _check_count(context, reserved.counts.get(caller.owner, 0))
        check_quota(context, caller, length + reserved.owned_bytes.get(caller.owner, 0))
        check_free_space(context, length + reserved.missing_bytes)
        return store.create(caller.owner, name, metadata, length)


def _check_count(context: ServiceContext, count: int) -> None:
    limit = context.settings.quota_open_uploads
    if count >= limit:
        raise QuotaExceeded(
            f"You may have {limit} unfinished uploads.",
            field="open_uploads",
            value=count,
            remedy="Finish or delete one, or wait until they expire.",
        )


@router.head("/{upload_id}")
def get_upload(upload_id: UploadId, request: Request, context: Context, caller: Reader) -> Response:
    """The upload's offset, and its asset once complete."""
    check_version(request.headers)
    store = _store(context)
    upload, offset = _find_with_offset(store, caller, upload_id)
    if offset == upload.length:  # the process may have died between the last byte and the asset
        with suppress(Locked):  # or another request is probing it now, and the asset will be named later
            upload = finish(context, store, caller, upload)
    headers = _state(store, upload, offset) | {"Upload-Length": str(upload.length), "Cache-Control": "no-store"}
    if upload.metadata:
        headers["Upload-Metadata"] = upload.metadata
    return Response(status_code=200, headers=headers)


@router.patch("/{upload_id}", status_code=204, openapi_extra=BODY)
async def patch_upload(upload_id: UploadId, request: Request, context: Context, caller: Submitter) -> Response:
    """Append to the upload at Upload-Offset."""
    check_version(request.headers)
    check_body_type(request.headers)
    at = whole_number(request.headers, "Upload-Offset")
    store = _store(context)
    upload = await run_in_threadpool(_find, store, caller, upload_id)
    offset = await append(request, context, store, upload, at)
    upload = await _finish_if_whole(context, store, caller, upload, offset)
    return Response(status_code=204, headers=_state(store, upload, offset))


@router.delete("/{upload_id}", status_code=204)
def delete_upload(upload_id: UploadId, request: Request, context: Context, caller: Submitter) -> Response:
    """Delete the upload. If it has become an asset, the asset stays."""
    check_version(request.headers)
    store = _store(context)
    store.remove(_find(store, caller, upload_id))
    return Response(status_code=204)


def _store(context: ServiceContext) -> UploadStore:
    return UploadStore(context.settings.uploads_dir, context.settings.upload_ttl_s)


def _find(store: UploadStore, caller: Principal, upload_id: str) -> Upload:
    upload = store.find(upload_id)
    if not caller.sees(upload.owner):
        raise NotFound("Upload not found.", field="upload_id", value=upload_id, remedy="Begin a new one.")
    return upload


def _find_with_offset(store: UploadStore, caller: Principal, upload_id: str) -> tuple[Upload, int]:
    """The upload and its offset, read again if a PATCH has closed it in between."""
    upload = _find(store, caller, upload_id)
    try:
        return upload, store.offset(upload)
    except NotFound:
        upload = _find(store, caller, upload_id)
        return upload, store.offset(upload)


async def _finish_if_whole(
    context: ServiceContext, store: UploadStore, caller: Principal, upload: Upload, offset: int
) -> Upload:
    if offset != upload.length:
        return upload
    async with context.admission.one(Cost.READING, caller):
        return await run_in_threadpool(finish, context, store, caller, upload)


def _state(store: UploadStore, upload: Upload, offset: int) -> dict[str, str]:
    headers = {"Upload-Offset": str(offset), "Upload-Expires": http_date(store.expires_at(upload))}
    if upload.asset_id:
        headers["Impasto-Asset"] = upload.asset_id
    return headers
