"""Receives one file of a multipart/form-data body: streamed to disk and hashed on the way."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import BinaryIO

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from service.errors import BadRequest, UnsupportedMediaType
from workers.filenames import check_filename

FIELD = "file"


class FileReceiver:
    """Parses a body that is passed to it in pieces: writes the part named `file` to `path`, and refuses a second one.

    Raises: UnsupportedMediaType (not multipart), BadRequest (malformed, or without that part), BadParameter (invalid
    file name).
    """

    def __init__(self, content_type: str, path: Path) -> None:
        kind, options = parse_options_header(content_type)
        if kind != b"multipart/form-data":
            raise UnsupportedMediaType(
                "Assets are uploaded as multipart/form-data.",
                field="Content-Type",
                value=content_type,
                remedy="Use a form with one file field named 'file', for example curl -F file=@clip.mp4.",
            )
        self.path = path
        self.filename = ""
        self._hash = hashlib.sha256()
        self._out: BinaryIO | None = None
        self._headers: dict[bytes, bytes] = {}
        self._name, self._value = b"", b""
        self._ended = False
        self._parser = _parser(options.get(b"boundary", b""), self)

    @property
    def sha256(self) -> str:
        return self._hash.hexdigest()

    def feed(self, chunk: bytes) -> None:
        try:
            self._parser.write(chunk)
        except FormParserError as error:
            raise _broken(str(error)) from None

    def finish(self) -> None:
        if not self._ended:
            raise _broken("it ends too early")
        if not self.filename:
            raise BadRequest("The form contains no file.", field=FIELD, remedy="Give one file field named 'file'.")

    def close(self) -> None:
        if self._out:
            self._out.close()
            self._out = None

    # Callbacks of the parser, in the order of the calls.

    def part_begin(self) -> None:
        self._headers = {}

    def header_field(self, data: bytes, start: int, end: int) -> None:
        self._name += data[start:end]

    def header_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def header_end(self) -> None:
        self._headers[self._name.lower()] = self._value
        self._name, self._value = b"", b""

    def headers_finished(self) -> None:
        _, options = parse_options_header(self._headers.get(b"content-disposition", b""))
        if options.get(b"name") != FIELD.encode() or b"filename" not in options:
            raise BadRequest(
                "The form contains something that is not the file.",
                field=options.get(b"name", b"").decode("utf-8", "replace"),
                remedy="Give one file field named 'file' and nothing else.",
            )
        if self.filename:
            raise BadRequest("The form contains two files.", field=FIELD, remedy="Upload one file at a time.")
        self.filename = check_filename(_text(options[b"filename"]))
        self._out = self.path.open("wb")

    def part_data(self, data: bytes, start: int, end: int) -> None:
        assert self._out is not None
        piece = data[start:end]
        self._hash.update(piece)
        self._out.write(piece)

    def part_end(self) -> None:
        self.close()

    def end(self) -> None:
        self._ended = True


def _parser(boundary: bytes, to: FileReceiver) -> MultipartParser:
    if not boundary:
        raise _broken("it has no boundary")
    try:
        return MultipartParser(
            boundary,
            {
                "on_part_begin": to.part_begin,
                "on_header_field": to.header_field,
                "on_header_value": to.header_value,
                "on_header_end": to.header_end,
                "on_headers_finished": to.headers_finished,
                "on_part_data": to.part_data,
                "on_part_end": to.part_end,
                "on_end": to.end,
            },
        )
    except FormParserError as error:
        raise _broken(str(error)) from None


def _broken(why: str) -> BadRequest:
    return BadRequest("The form cannot be read.", field="body", remedy=f"Correct it: {why}.")


def _text(name: bytes) -> str:
    try:
        return name.decode()
    except UnicodeDecodeError:
        return name.decode("latin-1")
