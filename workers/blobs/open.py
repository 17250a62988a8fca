"""The blob store that the settings name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from workers.blobs.base import Blobs
from workers.blobs.disk import DiskBlobs
from workers.blobs.local_copies import LocalCopies
from workers.settings import FarmSettings

if TYPE_CHECKING:
    from workers.blobs.s3_client import S3Options


def open_blobs(settings: FarmSettings) -> Blobs:
    """Blobs in S3 if `blob_url` is set, else in a folder. Opens no connection yet."""
    if not settings.blob_url:
        return DiskBlobs(settings.blobs_at, settings.reserve_bytes)
    from workers.blobs.s3 import S3Blobs  # boto3 takes a third of a second of processor time to import

    return S3Blobs(s3_options(settings), LocalCopies(settings.copies_at, settings.cache_bytes, settings.reserve_bytes))


def s3_options(settings: FarmSettings) -> S3Options:
    """Address and credentials of the bucket that the settings name."""
    from workers.blobs.s3_client import S3Options

    bucket, _, folder = settings.blob_url.removeprefix("s3://").partition("/")
    folder = folder.strip("/")
    return S3Options(
        bucket=bucket,
        prefix=f"{folder}/" if folder else "",
        endpoint_url=settings.s3_endpoint_url,
        region=settings.s3_region,
        access_key=settings.s3_access_key.get_secret_value(),
        secret_key=settings.s3_secret_key.get_secret_value(),
        addressing=settings.s3_addressing,
        checksums=settings.s3_checksums,
        part_bytes=settings.s3_part_bytes,
    )
