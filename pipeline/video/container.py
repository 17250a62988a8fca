"""Safe opening of containers, their video stream and its decoder.

Only demuxers of self-contained formats are allowed, since a playlist could refer to other files or network addresses.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import av
from av.codec import CodecContext
from av.container import InputContainer
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream

from pipeline.errors import NoVideoStream
from pipeline.video.media import Limits, unreadable

_DEMUXERS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,flv,ogg,asf,ivf,obu,h264,hevc,m4v,mjpeg,nut,mxf,"
    "dv,rm,yuv4mpegpipe,mpegvideo,vc1,wtv,mp3,wav,flac,aac,ac3,aiff,caf,amr"
)
"""Allowed demuxers: video containers, and audio containers, to distinguish audio files from unreadable ones."""
_WITH_ALPHA: dict[str, Literal["libvpx", "libvpx-vp9"]] = {"vp8": "libvpx", "vp9": "libvpx-vp9"}
"""Decoders that also decode the separate alpha plane, which FFmpeg's native decoders ignore."""


def open_container(path: Path, limits: Limits) -> InputContainer:
    """Open a container for reading. Raises UnreadableMedia."""
    options = {"format_whitelist": _DEMUXERS, "protocol_whitelist": "file", "max_pixels": _most_pixels(limits)}
    try:
        return av.open(f"file:{path}", "r", options=options, metadata_errors="replace")
    except (av.FFmpegError, OSError, ValueError) as error:
        unreadable("The file cannot be opened: it is cut off, damaged, or of an unknown kind.", _reason(error))


def _most_pixels(limits: Limits) -> str:
    """Pixel limit for decoders. It is looser than `limits.pixels`, which we check, since decoders pad allocations."""
    return str(2 * limits.pixels + (1 << 20))


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or type(error).__name__


def video_stream(container: InputContainer) -> VideoStream:
    """The video stream of a container; ignores cover art.

    Raises:
        NoVideoStream: the container has no video stream.
        UnreadableMedia: there is no decoder for its codec.
    """
    streams = [s for s in container.streams.video if not s.disposition & s.disposition.attached_pic]
    if not streams:
        raise NoVideoStream(
            "The file holds no video stream.",
            field="file",
            value=", ".join(s.type for s in container.streams) or container.format.name,
            remedy="Upload a file with moving pictures.",
        )
    if streams[0].codec_context is None:
        unreadable("The video's codec is unknown.", container.format.name, "Re-encode it as H.264 in MP4.")
    return streams[0]


def decoder_of(stream: VideoStream, limits: Limits, threads: int) -> VideoCodecContext:
    """Create a decoder for the stream that rejects pictures far above the limits.

    Args:
        threads: decoding threads; 0 = one per core. The output of undamaged files does not depend on it.
    """
    context = stream.codec_context
    name = _WITH_ALPHA.get(context.name)
    if name and stream.metadata.get("alpha_mode") == "1":
        context = CodecContext.create(name, "r")
    context.options = {"max_pixels": _most_pixels(limits)}
    context.thread_type = "AUTO"
    context.thread_count = threads
    return context
