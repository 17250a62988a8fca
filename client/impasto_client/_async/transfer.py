"""Uploads (tus 1.0.0) and downloads (ranges, to a temporary file) that are resumed after a broken connection."""

from __future__ import annotations

import asyncio
import base64
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

import httpx

from impasto_client.errors import ServiceUnreachable
from impasto_client.files import Progress
from impasto_client.problems import error_of

CHUNK_BYTES = 8 << 20
TRIES = 6
AWAY = frozenset({502, 503, 504})
"""Statuses of answers that are handled like a broken connection."""
TUS = {"Tus-Resumable": "1.0.0"}


async def upload(http: httpx.AsyncClient, uploads: str, path: Path, progress: Progress) -> httpx.Response:
    """Send a file by tus in pieces of 8 MiB; after a broken connection, continue with the missing bytes.

    Returns the answer to the last piece. Raises: the service's error about the file, ServiceUnreachable.
    """
    total = path.stat().st_size
    name = base64.b64encode(path.name.encode()).decode()
    headers = {**TUS, "Upload-Length": str(total), "Upload-Metadata": f"filename {name}"}
    created = await http.post(uploads, headers=headers)
    await _refuse(created)
    url, done, response = str(created.url.join(created.headers["Location"])), 0, created
    failures = 0
    with path.open("rb") as file:
        while done < total:
            try:
                file.seek(done)
                response = await _send_piece(http, url, done, file.read(CHUNK_BYTES))
                done, failures = int(response.headers["Upload-Offset"]), 0
            except httpx.TransportError as error:
                failures = await _pause(failures, error)
                done = await _offset(http, url, done)
            progress(done, total)
    return response


async def _send_piece(http: httpx.AsyncClient, url: str, offset: int, piece: bytes) -> httpx.Response:
    headers = {**TUS, "Upload-Offset": str(offset), "Content-Type": "application/offset+octet-stream"}
    response = await http.patch(url, headers=headers, content=piece)
    if response.status_code in AWAY | {409}:  # the service is away, or has another offset: request the offset
        raise httpx.ReadError(f"the service answered {response.status_code}")
    await _refuse(response)
    return response


async def _offset(http: httpx.AsyncClient, url: str, last: int) -> int:
    try:
        response = await http.head(url, headers=TUS)
    except httpx.TransportError:
        return last
    return int(response.headers.get("Upload-Offset", last))


async def download(http: httpx.AsyncClient, url: str, target: Path, progress: Progress) -> None:
    """Fetch `url` into `target`, which appears whole or not at all; resumed with Range after a broken connection.

    Raises: the service's error, ServiceUnreachable, OSError.
    """
    part = _Part(target.with_name(f".{target.name}.part"))
    failures = 0
    try:
        while not part.whole:
            try:
                async for have, total in part.receive(http, url):
                    failures = 0
                    progress(have, total)
            except httpx.TransportError as error:
                failures = await _pause(failures, error)
        part.path.replace(target)
    finally:
        part.path.unlink(missing_ok=True)


@dataclass
class _Part:
    """The part of a file that has arrived, and the version of the file that it belongs to."""

    path: Path
    etag: str = ""
    have: int = 0
    whole: bool = False

    async def receive(self, http: httpx.AsyncClient, url: str) -> AsyncIterator[tuple[int, int]]:
        """Append the missing bytes, or start again if the file has changed; yields (received bytes, total bytes)."""
        headers = {"Accept-Encoding": "identity"}  # unencoded bytes, which a Range counts
        if self.have and self.etag:
            headers |= {"Range": f"bytes={self.have}-", "If-Range": self.etag}
        async with http.stream("GET", url, headers=headers) as response:
            if response.status_code in AWAY:
                raise httpx.ReadError(f"the service answered {response.status_code}")
            await _refuse(response)
            self.have = self.have if response.status_code == 206 else 0
            self.etag = response.headers.get("ETag", "")
            total = self.have + int(response.headers.get("Content-Length", 0))
            with self.path.open("ab" if self.have else "wb") as file:
                async for piece in response.aiter_raw():
                    file.write(piece)
                    self.have += len(piece)
                    yield self.have, total
        self.whole = True


async def _refuse(response: httpx.Response) -> None:
    if response.is_error:
        await response.aread()
        raise error_of(response)


async def _pause(failures: int, error: Exception) -> int:
    """Wait longer after each failure in a row; give up after `TRIES`. Returns the new count."""
    if failures + 1 >= TRIES:
        raise ServiceUnreachable(
            f"The connection broke {TRIES} times in a row: {error}.", remedy="Try again when the service is back."
        ) from error
    await asyncio.sleep(0.2 * 2**failures)
    return failures + 1
