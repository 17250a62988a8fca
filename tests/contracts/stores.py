"""Blob stores over the real S3 server of the session."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.real.swift import ACCESS_KEY, REGION, SECRET_KEY, Swift
from workers.blobs.local_copies import LocalCopies
from workers.blobs.s3 import S3Blobs
from workers.blobs.s3_client import S3Options

PART_BYTES = 5 << 20
"""Smallest part that S3 accepts, bytes."""


def s3_options(server: Swift, **changes: Any) -> S3Options:
    """Options that work; one bucket for the session is enough, since tests have prefixes of their own."""
    given = {
        "bucket": server.shared_bucket,
        "endpoint_url": server.endpoint,
        "region": REGION,
        "access_key": ACCESS_KEY,
        "secret_key": SECRET_KEY,
        "addressing": "path",
        "part_bytes": PART_BYTES,
    }
    return S3Options(**{**given, **changes})


def s3_blobs(server: Swift, folder: Path, **changes: Any) -> S3Blobs:
    """Blobs there, with local copies in `folder`."""
    return S3Blobs(s3_options(server, **changes), LocalCopies(folder / "copies", 100 << 20))
