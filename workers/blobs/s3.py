"""Blobs in a bucket of S3, or of a compatible server. Writes are atomic; larger blobs are sent in parts, and exist only
after the last one. Failed requests are repeated with growing intervals; an interrupted read continues where it
stopped."""

from __future__ import annotations

import hashlib
import io
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import islice
from pathlib import Path
from typing import BinaryIO, cast

from boto3.s3.transfer import TransferConfig
from botocore.exceptions import ClientError

from pipeline.errors import StorageError
from workers.blobs.base import Content, Direct
from workers.blobs.keys import check_key
from workers.blobs.local_copies import LocalCopies
from workers.blobs.s3_client import Answer, S3Client, S3Options, as_storage_error, client_for, code_of
from workers.blobs.s3_direct import S3Direct
from workers.blobs.verified import check_file
from workers.errors import DamagedBlob
from workers.ids import new_id
from workers.process.heartbeat import current_heartbeat, heartbeats_of_another

_CHUNK = 1 << 20
_AT_ONCE = 1000
"""Maximum number of keys in one delete request, set by the protocol."""
_RESUMES = 4
"""Maximum number of continuations of an interrupted read."""
_PART_S = 120.0
"""Time that one part may take, seconds: over a slow line its bytes leave unseen."""
_SPOOL_BYTES = 32 << 20
"""Streams up to this size are kept in memory before they are sent, bytes."""
_TAKEN = {"PreconditionFailed", "ConditionalRequestConflict", "412"}


@dataclass(frozen=True)
class S3Blobs:
    """The blobs of a bucket under a prefix. A plain value that is pickled to workers, credentials included.

    Args:
        options: address of the bucket, and credentials.
        copies: local files for decoders.
    """

    options: S3Options
    copies: LocalCopies

    def put(self, key: str, data: Content) -> None:
        name = self._name(key)
        with as_storage_error(), heartbeats_of_another(_PART_S):
            if isinstance(data, Path):
                with data.open("rb") as file:
                    self._put_stream(name, file)
            elif callable(data):
                self._put_written(name, data)
            elif isinstance(data, bytes) and len(data) <= self.options.part_bytes:
                self._client.put_object(Bucket=self.options.bucket, Key=name, Body=data)
            else:
                self._put_stream(name, io.BytesIO(data) if isinstance(data, bytes) else data)

    def put_if_absent(self, key: str, data: bytes) -> bool:
        name = self._name(key)
        try:
            with as_storage_error():
                self._client.put_object(Bucket=self.options.bucket, Key=name, Body=data, IfNoneMatch="*")
        except StorageError as error:
            if isinstance(error.__cause__, ClientError) and code_of(error.__cause__) in _TAKEN:
                return False
            raise
        return True

    def get(self, key: str) -> bytes:
        return b"".join(self.read(key))

    def read(self, key: str, start: int = 0, stop: int | None = None, chunk: int = _CHUNK) -> Iterator[bytes]:
        name = self._name(key)
        if stop is not None and stop <= start:
            self._head(key)
            return iter(())
        first = self._open(name, start, stop)
        return iter(()) if first is None else self._pieces(name, first, start, stop, chunk)

    @contextmanager
    def local(self, key: str) -> Iterator[Path]:
        head = self._head(key)
        same = f"{self.options.endpoint_url} {self.options.bucket} {self._name(key)} {head['ETag']}"
        copy = hashlib.sha256(same.encode()).hexdigest()
        with self.copies.file(copy, head["ContentLength"], lambda place: self._download(key, place)) as place:
            try:
                check_file(key, place)
            except DamagedBlob:
                place.unlink(missing_ok=True)  # the next reader fetches it again
                raise
            yield place

    def size(self, key: str) -> int | None:
        try:
            return int(self._head(key)["ContentLength"])
        except KeyError:
            return None

    def delete(self, key: str) -> None:
        name = self._name(key)
        with suppress(KeyError), as_storage_error(key):
            self._client.delete_object(Bucket=self.options.bucket, Key=name)

    def delete_all(self, keys: Iterable[str]) -> None:
        left = iter(keys)
        while some := tuple(islice(left, _AT_ONCE)):
            with as_storage_error():
                names = [{"Key": self._name(key)} for key in some]
                answer = self._client.delete_objects(Bucket=self.options.bucket, Delete={"Objects": names})
            refused = [error for error in answer.get("Errors", ()) if error.get("Code") != "NoSuchKey"]
            if refused:
                reason = f"{refused[0].get('Code')} {refused[0].get('Message')}"
                raise StorageError(
                    f"{len(refused)} blobs cannot be deleted: {reason}.", remedy="Check the key's rights."
                )

    def keys(self, prefix: str) -> Iterator[str]:
        pages = self._client.get_paginator("list_objects_v2")
        own = len(self.options.prefix)
        with as_storage_error():
            for page in pages.paginate(Bucket=self.options.bucket, Prefix=self.options.prefix + prefix):
                yield from (found["Key"][own:] for found in page.get("Contents", ()))

    def check(self) -> None:
        """Raise StorageError if a small blob cannot be written and removed within seconds."""
        name = self._name(new_id("checks/"))
        hasty = client_for(self.options, hasty=True)
        with as_storage_error():
            hasty.put_object(Bucket=self.options.bucket, Key=name, Body=b"impasto")
            hasty.delete_object(Bucket=self.options.bucket, Key=name)
        self.check_free_space()

    def check_free_space(self, wanted_bytes: int = 0) -> None:
        """Buckets report no free space; the disk of local copies is checked."""
        self.copies.check_free_space()

    def sweep(self, older_than_s: float = 3600.0) -> int:
        """Abort abandoned uploads, so that their parts cost nothing, and remove old local copies."""
        before = datetime.now(UTC) - timedelta(seconds=older_than_s)
        pages = self._client.get_paginator("list_multipart_uploads")
        bucket, swept = self.options.bucket, self.copies.sweep(older_than_s)
        with as_storage_error():
            for page in pages.paginate(Bucket=bucket, Prefix=self.options.prefix):
                for upload in page.get("Uploads", ()):
                    if upload["Initiated"] <= before:
                        self._abort(upload["Key"], upload["UploadId"])
                        swept += 1
        return swept

    @property
    def direct(self) -> Direct:
        return S3Direct(self.options)

    # -- requests

    @property
    def _client(self) -> S3Client:
        return client_for(self.options)

    def _name(self, key: str) -> str:
        return self.options.prefix + check_key(key)

    def _head(self, key: str) -> Answer:
        name = self._name(key)
        with as_storage_error(key):
            return dict(self._client.head_object(Bucket=self.options.bucket, Key=name))

    def _put_written(self, name: str, write: Callable[[BinaryIO], None]) -> None:
        with tempfile.SpooledTemporaryFile(_SPOOL_BYTES) as file:
            write(cast("BinaryIO", file))
            file.seek(0)
            self._put_stream(name, cast("BinaryIO", file))

    def _put_stream(self, name: str, stream: BinaryIO) -> None:
        """Upload long content in parts. A failed upload is aborted at once, one that a crash left by `sweep`."""
        part = self.options.part_bytes
        how = TransferConfig(multipart_threshold=part, multipart_chunksize=part, max_concurrency=4)
        beat = current_heartbeat()
        self._client.upload_fileobj(stream, self.options.bucket, name, Config=how, Callback=lambda sent: beat())

    def _open(self, name: str, start: int, stop: int | None, etag: str = "") -> Answer | None:
        """The answer to a GET of [start, stop); None if the blob ends before `start`."""
        more: dict[str, str] = {"IfMatch": etag} if etag else {}
        if start or stop is not None:
            more["Range"] = f"bytes={start}-{'' if stop is None else stop - 1}"
        try:
            with as_storage_error(name.removeprefix(self.options.prefix)):
                return dict(self._client.get_object(Bucket=self.options.bucket, Key=name, **more))
        except StorageError as error:
            if isinstance(error.__cause__, ClientError) and code_of(error.__cause__) in ("InvalidRange", "416"):
                return None
            raise

    def _pieces(self, name: str, answer: Answer, start: int, stop: int | None, chunk: int) -> Iterator[bytes]:
        end = start + answer["ContentLength"]
        at, resumes, beat = start, 0, current_heartbeat()
        try:
            while at < end:
                try:
                    with as_storage_error():
                        piece = answer["Body"].read(min(chunk, end - at))
                        if not piece:
                            raise ConnectionError("the answer ended before its bytes did")
                except StorageError:
                    if (resumes := resumes + 1) > _RESUMES:
                        raise
                    time.sleep(0.2 * 2**resumes)
                    if (again := self._open(name, at, end, answer["ETag"])) is not None:
                        answer["Body"].close()
                        answer = again
                    continue
                at += len(piece)
                beat()
                yield piece
        finally:
            answer["Body"].close()

    def _download(self, key: str, place: Path) -> None:
        with place.open("xb") as file:
            for piece in self.read(key):
                file.write(piece)

    def _abort(self, name: str, upload_id: str) -> None:
        with suppress(KeyError), as_storage_error(name):
            self._client.abort_multipart_upload(Bucket=self.options.bucket, Key=name, UploadId=upload_id)
