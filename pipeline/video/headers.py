"""Media type of a file from its first bytes, never from its name."""

from __future__ import annotations

from typing import BinaryIO

from pipeline.formats import image_format
from pipeline.video.media import unreadable

_MAGIC = (
    (b"PK\x03\x04", "application/zip"),
    (b"PK\x05\x06", "application/zip"),
    (b"\x1aE\xdf\xa3", "video/x-matroska"),
)
_PROGRAMS = (b"MZ", b"\x7fELF", b"#!", b"\xca\xfe\xba\xbe", b"\xcf\xfa\xed\xfe", b"\xce\xfa\xed\xfe", b"\xfe\xed\xfa")


def sniff(stream: BinaryIO) -> str:
    """Detect the media type: an image type, zip, JSON, Matroska, AVI or MP4; "" = unknown, try the demuxers.

    Raises:
        UnreadableMedia: the file is a program, or text that is not JSON.
    """
    head = stream.read(4096)
    stream.seek(0)
    if form := image_format(head):
        return form.media_type
    for magic, media_type in _MAGIC:
        if head.startswith(magic):
            return "video/webm" if media_type == "video/x-matroska" and b"webm" in head[:64] else media_type
    if head[:4] == b"RIFF":
        return "video/x-msvideo" if head[8:12] == b"AVI " else ""
    if head[4:8] == b"ftyp":
        return "video/quicktime" if head[8:12] == b"qt  " else "video/mp4"
    return _text_or_program(head)


def _text_or_program(head: bytes) -> str:
    if head.startswith(_PROGRAMS):
        unreadable("The file is a program, not media.", repr(head[:4]))
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text[:1] in (b"{", b"["):
        return "application/json"
    if not head.startswith(b"YUV4MPEG2") and _is_text(head):
        unreadable("The file is text, not media.")  # its content is not quoted: it may be private
    return ""


def _is_text(head: bytes) -> bool:
    try:
        head[:1024].decode("utf-8")
    except UnicodeDecodeError as error:
        return error.start > 1000 and b"\0" not in head
    return b"\0" not in head
