"""Signed URLs into and out of a bucket, so that gigabytes need not pass through the service."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import quote

from workers.blobs.keys import check_key
from workers.blobs.s3_client import S3Client, S3Options, as_storage_error, client_for


@dataclass(frozen=True)
class S3Direct:
    """Implements `workers.blobs.base.Direct`. Signing sends no request: the blob of a URL may not exist."""

    options: S3Options

    def download_url(self, key: str, filename: str, media_type: str, seconds: int = 3600) -> str:
        how = f"attachment; filename*=UTF-8''{quote(filename, safe='')}"
        more = {"ResponseContentDisposition": how, "ResponseContentType": media_type}
        return self._presign("get_object", key, seconds, **more)

    def _presign(self, call: str, key: str, seconds: int, **more: object) -> str:
        with as_storage_error():
            return str(self._client.generate_presigned_url(call, {**self._at(key), **more}, ExpiresIn=seconds))

    def _at(self, key: str) -> dict[str, str]:
        return {"Bucket": self.options.bucket, "Key": self.options.prefix + check_key(key)}

    @property
    def _client(self) -> S3Client:
        return client_for(self.options)
