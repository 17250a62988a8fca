"""/v1/uploads: resumable upload by tus 1.0.0 (https://tus.io/protocols/resumable-upload).

Core, creation, creation-with-upload, expiration, termination, checksum. When the last byte has arrived the file is
probed and becomes an asset: the answer, and every later HEAD, names it in `Impasto-Asset`; media that are refused
give a problem instead, the same at every later HEAD.
"""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Request, Response
from starlette.concurrency import run_in_threadpool

from service.access.depends import Parts, Reader, Service, Submitter
from service.access.keys import Principal
from service.assets.adopt import check_quota, check_room, disk_faults
from service.errors import BodyTooLarge
from service.uploads.headers import (
    BODY_TYPE,
    EXTENSIONS,
    HASHES,
    VERSION,
    check_body_type,
    check_version,
    filename,
    http_date,
    whole_number,
)
from service.uploads.receive import append, finish
from service.uploads.store import Upload, UploadStore
from workers.errors import NotFound

router = APIRouter(prefix="/v1/uploads", tags=["uploads"])

UploadId = Annotated[str, Path(pattern=r"^[A-Za-z0-9_-]{1,64}$", description="As Location said at creation.")]
BODY = {"requestBody": {"content": {BODY_TYPE: {"schema": {"type": "string", "format": "binary"}}}}}


@router.options("", status_code=204)
def options(parts: Parts) -> Response:
    """What this server can do."""
    return Response(
        status_code=204,
        headers={
            "Tus-Version": VERSION,
            "Tus-Extension": EXTENSIONS,
            "Tus-Max-Size": str(parts.settings.max_asset_bytes),
            "Tus-Checksum-Algorithm": ",".join(HASHES),
        },
    )


@router.post("", status_code=201, openapi_extra=BODY)
async def create_upload(request: Request, parts: Parts, caller: Submitter) -> Response:
    """Begin an upload of Upload-Length bytes; the body, if any, is its first piece."""
    check_version(request.headers)
    store = _store(parts)
    first = request.headers.get("content-length", "0") != "0" or "transfer-encoding" in request.headers
    if first:
        check_body_type(request.headers)
    upload = await run_in_threadpool(_create, request, parts, store, caller)
    offset = await append(request, parts, store, upload, 0) if first else 0
    upload = await _finish_if_whole(parts, store, upload, offset)
    headers = {"Location": f"/v1/uploads/{upload.id}"} | _state(store, upload, offset)
    return Response(status_code=201, headers=headers)


def _create(request: Request, parts: Service, store: UploadStore, caller: Principal) -> Upload:
    length = whole_number(request.headers, "Upload-Length")
    if length > parts.settings.max_asset_bytes:
        raise BodyTooLarge(
            f"A file may have {parts.settings.max_asset_bytes} bytes.",
            field="Upload-Length",
            value=length,
            remedy="Upload a smaller file.",
        )
    metadata = request.headers.get("upload-metadata", "")
    name = filename(metadata)
    check_quota(parts, caller, length)
    with disk_faults():
        parts.settings.uploads_dir.mkdir(parents=True, exist_ok=True)
        check_room(parts, length)
        return store.create(caller.owner, name, metadata, length)


@router.head("/{upload_id}")
def get_upload(upload_id: UploadId, request: Request, parts: Parts, caller: Reader) -> Response:
    """How far the upload is, and the asset it became."""
    check_version(request.headers)
    store = _store(parts)
    upload = _find(store, caller, upload_id)
    offset = store.offset(upload)
    if offset == upload.length:  # perhaps the process died between the last byte and the asset
        upload = finish(parts, store, upload)
    headers = _state(store, upload, offset) | {"Upload-Length": str(upload.length), "Cache-Control": "no-store"}
    if upload.metadata:
        headers["Upload-Metadata"] = upload.metadata
    return Response(status_code=200, headers=headers)


@router.patch("/{upload_id}", status_code=204, openapi_extra=BODY)
async def patch_upload(upload_id: UploadId, request: Request, parts: Parts, caller: Submitter) -> Response:
    """Go on with the upload at Upload-Offset."""
    check_version(request.headers)
    check_body_type(request.headers)
    at = whole_number(request.headers, "Upload-Offset")
    store = _store(parts)
    upload = await run_in_threadpool(_find, store, caller, upload_id)
    offset = await append(request, parts, store, upload, at)
    upload = await _finish_if_whole(parts, store, upload, offset)
    return Response(status_code=204, headers=_state(store, upload, offset))


@router.delete("/{upload_id}", status_code=204)
def delete_upload(upload_id: UploadId, request: Request, parts: Parts, caller: Submitter) -> Response:
    """Give the upload up. An asset that it has become stays."""
    check_version(request.headers)
    store = _store(parts)
    store.remove(_find(store, caller, upload_id))
    return Response(status_code=204)


def _store(parts: Service) -> UploadStore:
    return UploadStore(parts.settings.uploads_dir, parts.settings.upload_ttl_s)


def _find(store: UploadStore, caller: Principal, upload_id: str) -> Upload:
    upload = store.find(upload_id)
    if not caller.sees(upload.owner):
        raise NotFound("There is no such upload.", field="upload_id", value=upload_id, remedy="Begin a new one.")
    return upload


async def _finish_if_whole(parts: Service, store: UploadStore, upload: Upload, offset: int) -> Upload:
    return await run_in_threadpool(finish, parts, store, upload) if offset == upload.length else upload


def _state(store: UploadStore, upload: Upload, offset: int) -> dict[str, str]:
    headers = {"Upload-Offset": str(offset), "Upload-Expires": http_date(store.expires_at(upload))}
    if upload.asset_id:
        headers["Impasto-Asset"] = upload.asset_id
    return headers
