"""Files over HTTP: single ranges (RFC 9110), entity tags, HEAD, and headers that make user content inert."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import quote

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from service.context.depends import ServiceContext
from service.errors import RangeNotSatisfiable
from service.streaming import StreamedResponse, in_threads
from workers.farm_parts.stored_file import StoredFile

CONTENT_CSP = "sandbox; default-src 'none'; img-src 'self'; media-src 'self'; style-src 'unsafe-inline'"
"""A user's file that is opened as a page (an SVG, for example) runs no scripts."""

_RANGE = re.compile(r"bytes=\s*(\d{0,18})\s*-\s*(\d{0,18})\s*")


@dataclass(frozen=True)
class ByteRange:
    """Bytes [start, stop)."""

    start: int
    stop: int


def wanted(headers: Headers, size: int, etag: str) -> ByteRange | None:
    """The requested range; None: the whole file, also where RFC 9110, 14.2, allows to ignore the range.

    Raises: RangeNotSatisfiable.
    """
    asked = _RANGE.fullmatch(headers.get("range", ""))
    if asked is None or asked.groups() == ("", ""):
        return None
    if headers.get("if-range", etag) != etag:
        return None
    first, last = asked.groups()
    if first and last and int(last) < int(first):
        return None
    start = int(first) if first else max(0, size - int(last))
    stop = min(size, int(last) + 1) if first and last else size
    if start >= stop:
        raise RangeNotSatisfiable(
            f"The file has {size} bytes.",
            headers={"Content-Range": f"bytes */{size}"},
            field="Range",
            value=headers["range"],
            remedy=f"Ask for bytes within 0-{max(0, size - 1)}.",
        )
    return ByteRange(start, stop)


def not_modified(headers: Headers, etag: str) -> bool:
    """Whether If-None-Match holds the tag (weak comparison, RFC 9110, 13.1.2)."""
    tags = [tag.strip().removeprefix("W/") for tag in headers.get("if-none-match", "").split(",")]
    return "*" in tags or etag in tags


def disposition(filename: str, attachment: bool) -> str:
    """Content-Disposition with an ASCII name and, where that loses something, the real one (RFC 6266)."""
    kind = "attachment" if attachment else "inline"
    plain = re.sub(r"[^A-Za-z0-9 ._()-]", "_", filename) or "file"
    full = "" if plain == filename else f"; filename*=UTF-8''{quote(filename, safe='')}"
    return f'{kind}; filename="{plain}"{full}'


def serve(context: ServiceContext, served: StoredFile, request: Request, attachment: bool = False) -> Response:
    """Answer a GET or HEAD for a file of the farm. A download may be redirected to the blob store."""
    files = context.farm.files
    if attachment and request.method == "GET" and (url := files.direct_url(served)):
        return RedirectResponse(url, 307, {"Cache-Control": "private, no-store"})
    etag = '"' + served.etag.strip('"') + '"'
    headers = {
        "ETag": etag,
        "Accept-Ranges": "bytes",
        "Cache-Control": "private, no-cache",
        "Content-Disposition": disposition(served.filename, attachment),
        "Content-Security-Policy": CONTENT_CSP,
    }
    if not_modified(request.headers, etag):
        return Response(status_code=304, headers=headers)
    span = wanted(request.headers, served.size_bytes, etag) if request.method == "GET" else None
    start, stop = (span.start, span.stop) if span else (0, served.size_bytes)
    headers["Content-Length"] = str(stop - start)
    if span:
        headers["Content-Range"] = f"bytes {start}-{stop - 1}/{served.size_bytes}"
    if request.method == "HEAD":
        return Response(headers=headers, media_type=served.media_type)
    body = in_threads(files.read(served, start, stop), context.download_threads)
    return StreamedResponse(body, 206 if span else 200, headers, served.media_type)
