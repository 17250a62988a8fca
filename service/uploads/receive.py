"""Bytes of one request onto the end of an upload, and what follows when it is whole."""

from __future__ import annotations

import os
from typing import BinaryIO

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from pipeline.errors import BadInput
from service.access.depends import Service
from service.assets.adopt import disk_faults
from service.bodies import chunks
from service.errors import OffsetMismatch
from service.uploads.headers import Checksum
from service.uploads.store import Upload, UploadStore
from workers.model import Asset


async def append(request: Request, parts: Service, store: UploadStore, upload: Upload, at: int) -> int:
    """Append the body, which begins at offset `at`; returns the new offset.

    What has arrived stays when the connection breaks, unless a checksum was promised: it can then not be checked.

    Raises: OffsetMismatch, Locked, BodyTooLarge, RequestTimeout, ChecksumMismatch, StorageFull, ClientDisconnect.
    """
    checksum = Checksum.of(request.headers)
    if upload.closed:
        _check_offset(upload.length, at)
        return upload.length
    with store.claim(upload) as file:
        _check_offset(file.tell(), at)
        try:
            await _copy(request, parts, file, upload.length - at, checksum)
        except BaseException:
            if checksum:
                file.truncate(at)
            raise
        return file.tell()


def _check_offset(stands: int, at: int) -> None:
    if stands != at:
        raise OffsetMismatch(
            f"The upload stands at {stands}.",
            headers={"Upload-Offset": str(stands)},
            field="Upload-Offset",
            value=at,
            remedy="Ask for the offset (HEAD) and go on from there.",
        )


async def _copy(request: Request, parts: Service, file: BinaryIO, room: int, checksum: Checksum | None) -> None:
    with disk_faults():
        try:
            async for chunk in chunks(request, room, parts.settings.idle_s):
                await run_in_threadpool(file.write, chunk)
                if checksum:
                    checksum.hash.update(chunk)
        finally:
            file.flush()
        if checksum:
            checksum.check()
        await run_in_threadpool(os.fsync, file.fileno())


def finish(parts: Service, store: UploadStore, upload: Upload) -> Upload:
    """Make the whole upload an asset; done at most once, also after a restart.

    Raises: BadMedia and the like, the same each time it is asked; StorageError (to be tried again).
    """
    if upload.asset_id:
        return upload
    if upload.fault:
        raise upload_fault(upload)
    with store.claim(upload):
        try:
            asset: Asset = parts.farm.add_asset(store.path(upload), upload.filename, upload.owner)
        except BadInput as error:
            store.refused(upload, error)
            raise
        return store.became(upload, asset.id)


def upload_fault(upload: Upload) -> BadInput:
    """The error that the media were refused with."""
    assert upload.fault
    fault = upload.fault
    error = BadInput(fault.message, field=fault.field, value=fault.value, remedy=fault.remedy)
    error.code = fault.code
    return error
