"""Access to S3: options, one client per process, and the translation of its errors."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import boto3
from boto3.exceptions import Boto3Error
from botocore.config import Config
from botocore.exceptions import BotoCoreError, ClientError, ConnectTimeoutError, HTTPClientError
from botocore.handlers import add_expect_header
from urllib3.exceptions import HTTPError

from pipeline.errors import StorageError, StorageFull
from workers.blobs.keys import NoBlob

CONNECT_S, READ_S = 5.0, 10.0
"""Time limits of a connection, and of every wait for an answer's bytes, seconds."""
CALL_S = 20.0
"""A call that has taken this long is not tried again, seconds. With its last try it ends before the attempt that makes
it counts as hanging (`FarmSettings.stall_s`)."""
_CONNECTIONS = 32
_TRIES = 9
"""Tries of a request. Waits between them double from 50 ms, with random jitter: about six seconds in total."""
_DEADLINE = "impasto_deadline"
_MISSING = {"NoSuchKey", "NoSuchUpload", "NotFound", "404"}
_FULL = {"QuotaExceeded", "InsufficientStorage", "InsufficientCapacity", "XMinioStorageFull", "507"}
_REMEDIES = {
    "NoSuchBucket": "Make the bucket, or name another in IMPASTO_BLOB_URL.",
    "AccessDenied": "Let the key list, read, write and delete in the bucket.",
    "InvalidAccessKeyId": "Correct IMPASTO_S3_ACCESS_KEY.",
    "SignatureDoesNotMatch": "Correct IMPASTO_S3_ACCESS_KEY and IMPASTO_S3_SECRET_KEY, or the machine's clock.",
    "RequestTimeTooSkewed": "Set the machine's clock.",
}


@dataclass(frozen=True)
class S3Options:
    """Address and credentials of the store. A plain value.

    Args:
        bucket: must exist.
        prefix: of every key, empty or ending in a slash; several farms may share a bucket.
        endpoint_url: address of the server; empty: Amazon's.
        access_key, secret_key: credentials; empty: those that boto3 finds (environment, files, the machine's role).
        addressing: "path" for servers without a name for each bucket, "virtual", or "auto".
        checksums: send and check CRCs of bodies; off for servers that do not know them.
        part_bytes: larger blobs are sent in parts of this size.
    """

    bucket: str
    prefix: str = ""
    endpoint_url: str = ""
    region: str = ""
    access_key: str = ""
    secret_key: str = field(default="", repr=False)
    addressing: str = "auto"
    checksums: bool = True
    part_bytes: int = 16 << 20


_lock = threading.Lock()
S3Client: TypeAlias = Any
"""A client of boto3, which ships no types."""
Answer: TypeAlias = dict[str, Any]
"""Result of a boto3 call."""
_clients: dict[tuple[int, S3Options, bool], S3Client] = {}


def client_for(options: S3Options, hasty: bool = False) -> S3Client:
    """The client of this process; thread-safe. `hasty`: gives up after a few seconds, for health checks."""
    key = (os.getpid(), options, hasty)
    with _lock:
        if key not in _clients:
            _clients[key] = _new_client(options, hasty)
        return _clients[key]


def _new_client(options: S3Options, hasty: bool) -> S3Client:
    when = "when_supported" if options.checksums else "when_required"
    config = Config(
        signature_version="s3v4",
        s3={"addressing_style": options.addressing},
        max_pool_connections=_CONNECTIONS,
        connect_timeout=2.0 if hasty else CONNECT_S,
        read_timeout=3.0 if hasty else READ_S,
        retries={"mode": "standard", "total_max_attempts": 1 if hasty else _TRIES},
        request_checksum_calculation=when,
        response_checksum_validation=when,
    )
    with as_storage_error():
        client = boto3.session.Session().client(
            "s3",
            endpoint_url=options.endpoint_url or None,
            region_name=options.region or None,
            aws_access_key_id=options.access_key or None,
            aws_secret_access_key=options.secret_key or None,
            config=config,
        )
    events = client.meta.events
    # If the connection breaks in an answer to "Expect: 100-continue", botocore 1.44.5 never stops reading.
    events.unregister("before-call.s3", add_expect_header)
    events.register("before-call.s3", _set_deadline)
    events.register("request-created.s3", _check_deadline)
    return client


def _set_deadline(params: Answer, **_event: object) -> None:
    params["context"][_DEADLINE] = time.monotonic() + CALL_S


def _check_deadline(request: Any, **_event: object) -> None:
    """Called before each try."""
    if time.monotonic() > request.context.get(_DEADLINE, float("inf")):
        raise ConnectTimeoutError(endpoint_url=request.url, error=f"no answer within {CALL_S:g} s")


@contextmanager
def as_storage_error(key: str = "") -> Iterator[None]:
    """Convert errors of S3 and its client to KeyError (no such blob), StorageFull or StorageError."""
    try:
        yield
    except ClientError as error:
        if key and code_of(error) in _MISSING:
            raise NoBlob(key) from None
        raise _refused(error) from error
    except (BotoCoreError, Boto3Error, HTTPClientError, HTTPError, OSError) as error:
        if isinstance(cause := error.__cause__ or error.__context__, ClientError):
            raise _refused(cause) from error
        remedy = "Check that it runs and can be reached."
        raise StorageError(f"The S3 store does not answer: {_describe(error)}.", remedy=remedy) from error


def code_of(error: ClientError) -> str:
    """S3's own code ("NoSuchKey"), or the HTTP status of an answer without a body ("404")."""
    return str(error.response.get("Error", {}).get("Code", ""))


def _refused(error: ClientError) -> StorageError:
    code, message = code_of(error), error.response.get("Error", {}).get("Message", "")
    if code in _FULL:
        return StorageFull("The S3 store is full.", remedy="Free some space in the bucket, or raise its quota.")
    remedy = _REMEDIES.get(code, "Look into the server's log.")
    return StorageError(f"The S3 store refuses: {code} {message}".rstrip(". ") + ".", remedy=remedy)


def _describe(error: Exception) -> str:
    return (str(error) or type(error).__name__).rstrip(".")
