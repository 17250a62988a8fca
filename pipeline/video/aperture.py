"""The part of each stored picture that is shown: clean aperture of MP4 and MOV, PixelCrop of Matroska.

FFmpeg's demuxers read both; PyAV hands them on only in FFmpeg's description of the file.
"""

from __future__ import annotations

import re
from typing import Any

import av.logging
from av.container import InputContainer
from av.video.stream import VideoStream

from pipeline.video.container import MATROSKA, MOV, logging_at

Crop = tuple[int, int, int, int]
"""Pixels that are not shown: left, top, right, bottom."""
_CROPPING = re.compile(r"^ +Frame Cropping: (\d+)/(\d+)/(\d+)/(\d+)$", re.MULTILINE)
"""Left, right, top, bottom: `dump_cropping` in FFmpeg's libavformat/dump.c."""


def crop_of(container: InputContainer, stream: VideoStream) -> Crop | None:
    """The crop that the container asks for; None: none, or one that leaves nothing."""
    if container.format.name not in (MOV, MATROSKA):
        return None
    described: Any = container  # PyAV's types lack `dumps_format`
    with logging_at(av.logging.INFO):
        streams = re.split(r"^ +Stream #0:(\d+)", described.dumps_format(), flags=re.MULTILINE)
    about = dict(zip(streams[1::2], streams[2::2], strict=True)).get(str(stream.index), "")
    found = _CROPPING.search(about)
    left, right, top, bottom = map(int, found.groups()) if found else (0, 0, 0, 0)
    context = stream.codec_context
    fits = left + right < context.width and top + bottom < context.height
    return (left, top, right, bottom) if fits and any((left, top, right, bottom)) else None
