"""Appends the body of a request to an upload, and turns a complete upload into an asset."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from pipeline.errors import BadInput
from pipeline.video.sequence_options import embed
from service.access.keys import Principal
from service.assets.adopt import check_free_space, check_quota, disk_faults, upload_folder
from service.assets.upload_store import Upload, UploadStore
from service.bodies import chunks
from service.context.depends import ServiceContext
from service.errors import OffsetMismatch
from service.uploads.headers import Checksum, sequence_options
from workers.contract.record import Asset
from workers.errors import NotFound


async def append(request: Request, context: ServiceContext, store: UploadStore, upload: Upload, at: int) -> int:
    """Append the body, which begins at offset `at`; returns the new offset.

    If the connection breaks, the received bytes are kept, unless a checksum was announced, which they could not match.

    Raises: OffsetMismatch, Locked, BodyTooLarge, RequestTimeout, ChecksumMismatch, StorageFull, ClientDisconnect.
    """
    checksum = Checksum.of(request.headers)
    if upload.closed:
        _check_offset(upload.length, at)
        return upload.length
    with store.claim(upload) as file:
        _check_offset(file.tell(), at)
        await run_in_threadpool(check_free_space, context, upload.length - at)
        try:
            await _copy(request, context, file, upload.length - at, checksum)
        except BaseException:
            if checksum:
                file.truncate(at)
            raise
        return file.tell()


def _check_offset(stands: int, at: int) -> None:
    if stands != at:
        raise OffsetMismatch(
            f"The upload has {stands} bytes.",
            headers={"Upload-Offset": str(stands)},
            field="Upload-Offset",
            value=at,
            remedy="Ask for the offset (HEAD), then continue from there.",
        )


async def _copy(
    request: Request, context: ServiceContext, file: BinaryIO, space: int, checksum: Checksum | None
) -> None:
    with disk_faults():
        try:
            async for chunk in chunks(request, space, context.settings.idle_s):
                check_free_space(context, len(chunk))  # other programs fill the disk, too
                await run_in_threadpool(file.write, chunk)
                if checksum:
                    checksum.hash.update(chunk)
        finally:
            file.flush()
        if checksum:
            checksum.check()
        await run_in_threadpool(os.fsync, file.fileno())


def finish(context: ServiceContext, store: UploadStore, caller: Principal, upload: Upload) -> Upload:
    """Turn a complete upload into an asset, at most once, also across restarts.

    Raises: BadMedia and its subclasses (again at each call); QuotaExceeded, StorageError (may be tried again); Locked
    (another request is doing this now).
    """
    if upload.closed:
        return _closed(upload)
    try:
        return _probe(context, store, caller, upload)
    except NotFound:  # another request has closed it
        return _closed(store.find(upload.id))


def _closed(upload: Upload) -> Upload:
    if upload.fault:
        raise upload_fault(upload)
    return upload


def _probe(context: ServiceContext, store: UploadStore, caller: Principal, upload: Upload) -> Upload:
    with store.claim(upload):
        check_upload_quota(context, store, caller, upload)
        try:
            with _packed(context, store.path(upload), upload) as path:
                asset: Asset = context.farm.assets.add(path, upload.filename, upload.owner)
        except BadInput as error:
            store.refused(upload, error)
            raise
        return store.became(upload, asset.id)


@contextmanager
def _packed(context: ServiceContext, path: Path, upload: Upload) -> Iterator[Path]:
    """The file, or a copy with the options of an image sequence: the upload itself stays as it arrived."""
    options = sequence_options(upload.metadata)
    if options is None:
        yield path
        return
    with tempfile.TemporaryDirectory(dir=upload_folder(context)) as folder:
        copy = Path(shutil.copyfile(path, Path(folder) / "file"))
        embed(copy, upload.filename, options)
        yield copy


def check_upload_quota(context: ServiceContext, store: UploadStore, caller: Principal, upload: Upload) -> None:
    """Raise QuotaExceeded if the owner's assets and open uploads, this one included, exceed the quota.

    If an operator acts on another owner's upload, nothing is counted against the operator.
    """
    if caller.owner == upload.owner:
        check_quota(context, caller, store.reserved().owned_bytes.get(upload.owner, 0))


def upload_fault(upload: Upload) -> BadInput:
    """The error with which the file was refused."""
    assert upload.fault
    fault = upload.fault
    error = BadInput(fault.message, field=fault.field, value=fault.value, remedy=fault.remedy)
    error.code = fault.code
    return error
