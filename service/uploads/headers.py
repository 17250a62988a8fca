"""Strict parsing of the headers of tus 1.0.0."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from email.utils import formatdate
from typing import Any

from starlette.datastructures import Headers

from pipeline.errors import BadParameter
from pipeline.video.sequence_options import SequenceOptions, options_of
from service.errors import BadRequest, ChecksumMismatch, UnsupportedMediaType, WrongVersion
from workers.filenames import check_filename

VERSION = "1.0.0"
EXTENSIONS = "creation,creation-with-upload,expiration,termination,checksum"
BODY_TYPE = "application/offset+octet-stream"
MAX_METADATA = 4096
HASHES: dict[str, Callable[[], Any]] = {
    "sha1": lambda: hashlib.sha1(usedforsecurity=False),
    "sha256": hashlib.sha256,
}


def check_version(headers: Headers) -> None:
    """Raise WrongVersion unless the client uses tus 1.0.0."""
    spoken = headers.get("tus-resumable")
    if spoken != VERSION:
        raise WrongVersion(
            f"The service supports tus {VERSION} only.",
            headers={"Tus-Version": VERSION},
            field="Tus-Resumable",
            value=spoken,
            remedy=f"Send the header 'Tus-Resumable: {VERSION}'.",
        )


def check_body_type(headers: Headers) -> None:
    """Raise UnsupportedMediaType unless the body has the media type of tus."""
    content_type = headers.get("content-type", "")
    if content_type.partition(";")[0].strip().lower() != BODY_TYPE:
        raise UnsupportedMediaType(
            "The body of an upload must have the media type of tus.",
            field="Content-Type",
            value=content_type,
            remedy=f"Send the header 'Content-Type: {BODY_TYPE}'.",
        )


def whole_number(headers: Headers, name: str) -> int:
    """The header `name` as a number of bytes. Raises BadRequest."""
    text = headers.get(name)
    if text is None or not (text.isascii() and text.isdecimal()) or len(text) > 18:
        raise BadRequest(
            f"{name} must be a number of bytes.",
            field=name,
            value=text,
            remedy=f"Send the header {name} with a number.",
        )
    return int(text)


def filename(metadata: str) -> str:
    """The name in Upload-Metadata (keys `filename` or `name`), or "upload". Raises BadParameter."""
    values = _metadata(metadata)
    return check_filename(values.get("filename") or values.get("name") or "upload")


def sequence_options(metadata: str) -> SequenceOptions | None:
    """Options of an image sequence in Upload-Metadata (keys `missing`, `fps`, `pattern`, `layer`, `view`), if any.

    Raises: BadParameter.
    """
    values = {name: value for name, value in _metadata(metadata).items() if name in SequenceOptions.model_fields}
    return options_of(values, "Upload-Metadata") if values else None


def _metadata(text: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for pair in text.split(",") if text.strip() else ():
        key, _, value = pair.strip().partition(" ")
        try:
            found[key] = base64.b64decode(value.strip(), validate=True).decode()
        except ValueError:  # not base64, or not UTF-8
            raise _bad_metadata(text) from None
    if len(text) > MAX_METADATA or "" in found:
        raise _bad_metadata(text)
    return found


def _bad_metadata(text: str) -> BadParameter:
    return BadParameter(
        "Upload-Metadata cannot be read.",
        field="Upload-Metadata",
        value=text,
        remedy="Send pairs of a key and a base64 value, joined by commas: filename Y2xpcC5tcDQ=.",
    )


@dataclass
class Checksum:
    """The checksum that the client announces for the body of one request."""

    hash: Any
    wanted: bytes

    @classmethod
    def of(cls, headers: Headers) -> Checksum | None:
        """Parse the header Upload-Checksum; None without it. Raises BadRequest (unknown algorithm, invalid base64)."""
        text = headers.get("upload-checksum")
        if text is None:
            return None
        algorithm, _, digest = text.partition(" ")
        try:
            return cls(HASHES[algorithm](), base64.b64decode(digest.strip(), validate=True))
        except (KeyError, ValueError):
            raise BadRequest(
                "Upload-Checksum cannot be read.",
                field="Upload-Checksum",
                value=text,
                remedy=f"Send one of {', '.join(HASHES)}, a space and the base64 digest.",
            ) from None

    def check(self) -> None:
        """Raise ChecksumMismatch."""
        if self.hash.digest() != self.wanted:
            raise ChecksumMismatch(
                "The body does not match its checksum.", field="Upload-Checksum", remedy="Send this piece again."
            )


def http_date(at: float) -> str:
    return formatdate(at, usegmt=True)
