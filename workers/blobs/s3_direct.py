"""Signed URLs into and out of a bucket, so that gigabytes need not pass through the service."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from urllib.parse import quote

from pipeline.errors import BadInput
from workers.blobs.keys import check_key
from workers.blobs.s3_client import Answer, S3Client, S3Options, as_storage_error, client_for


@dataclass(frozen=True)
class S3Direct:
    """Implements `workers.blobs.base.Direct`. Signing sends no request: the blob of a URL may not exist."""

    options: S3Options

    def download_url(self, key: str, filename: str, media_type: str, seconds: int = 3600) -> str:
        how = f"attachment; filename*=UTF-8''{quote(filename, safe='')}"
        more = {"ResponseContentDisposition": how, "ResponseContentType": media_type}
        return self._presign("get_object", key, seconds, **more)

    def upload_url(self, key: str, seconds: int = 3600) -> str:
        return self._presign("put_object", key, seconds)

    def begin(self, key: str) -> str:
        with as_storage_error():
            return str(self._client.create_multipart_upload(**self._at(key))["UploadId"])

    def part_url(self, key: str, upload_id: str, number: int, seconds: int = 3600) -> str:
        return self._presign("upload_part", key, seconds, UploadId=upload_id, PartNumber=number)

    def complete(self, key: str, upload_id: str) -> None:
        parts = self._parts(key, upload_id)
        if not parts:
            raise BadInput("The upload has no parts.", field="upload", value=upload_id, remedy="Put its parts first.")
        with as_storage_error(key):
            self._client.complete_multipart_upload(
                **self._at(key), UploadId=upload_id, MultipartUpload={"Parts": parts}
            )

    def abort(self, key: str, upload_id: str) -> None:
        with suppress(KeyError), as_storage_error(key):
            self._client.abort_multipart_upload(**self._at(key), UploadId=upload_id)

    def _parts(self, key: str, upload_id: str) -> list[Answer]:
        pages = self._client.get_paginator("list_parts")
        with as_storage_error(key):
            found = list(pages.paginate(**self._at(key), UploadId=upload_id).search("Parts[]"))
        return [{"PartNumber": part["PartNumber"], "ETag": part["ETag"]} for part in found if part]

    def _presign(self, call: str, key: str, seconds: int, **more: object) -> str:
        with as_storage_error():
            return str(self._client.generate_presigned_url(call, {**self._at(key), **more}, ExpiresIn=seconds))

    def _at(self, key: str) -> dict[str, str]:
        return {"Bucket": self.options.bucket, "Key": self.options.prefix + check_key(key)}

    @property
    def _client(self) -> S3Client:
        return client_for(self.options)
