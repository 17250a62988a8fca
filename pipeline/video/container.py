"""Safe opening of containers, the choice of their streams, and decoders.

Only demuxers of self-contained formats are allowed, since a playlist could refer to other files or network addresses.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import av
import av.logging
from av.audio.stream import AudioStream
from av.codec import CodecContext
from av.container import InputContainer
from av.filter.context import FilterContext
from av.stream import Disposition
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream

from pipeline.errors import BadParameter, NoVideoStream
from pipeline.video.media import Limits, Note, unreadable

MOV, AVI, MATROSKA, MPEGTS = "mov,mp4,m4a,3gp,3g2,mj2", "avi", "matroska,webm", "mpegts"
"""FFmpeg's names of demuxers."""
_DEMUXERS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,flv,ogg,asf,ivf,obu,h264,hevc,m4v,mjpeg,nut,mxf,"
    "dv,rm,yuv4mpegpipe,mpegvideo,vc1,wtv,mp3,wav,flac,aac,ac3,aiff,caf,amr"
)
"""Allowed demuxers: video containers, and audio containers, to distinguish audio files from unreadable ones."""
_WITH_ALPHA: dict[str, Literal["libvpx", "libvpx-vp9"]] = {"vp8": "libvpx", "vp9": "libvpx-vp9"}
"""Decoders that also decode the separate alpha plane, which FFmpeg's native decoders ignore."""
_NO_FILM = Disposition.attached_pic | Disposition.timed_thumbnails
_SECONDARY = Disposition.still_image | Disposition.dependent | Disposition.metadata


@contextmanager
def logging_at(level: int) -> Iterator[None]:
    """FFmpeg reports messages of this level, each of them, while the block runs."""
    before, repeats = av.logging.get_level(), av.logging.get_skip_repeated()
    av.logging.set_level(level)
    av.logging.set_skip_repeated(False)
    try:
        yield
    finally:
        av.logging.set_level(before)
        av.logging.set_skip_repeated(repeats)


def open_container(path: Path, limits: Limits) -> InputContainer:
    """Open a container for reading. Raises UnreadableMedia."""
    options = {"format_whitelist": _DEMUXERS, "protocol_whitelist": "file", "max_pixels": _most_pixels(limits)}
    try:
        return av.open(f"file:{path}", "r", options=options, metadata_errors="replace")
    except (av.FFmpegError, OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or type(error).__name__
        unreadable("The file cannot be opened: it is cut off, damaged, or of an unknown kind.", why)


def _most_pixels(limits: Limits) -> str:
    """Pixel limit for decoders. It is looser than `limits.pixels`, which we check, since decoders pad allocations."""
    return str(2 * limits.pixels + (1 << 20))


def film_streams(container: InputContainer) -> list[VideoStream]:
    """Video streams without cover art and thumbnails."""
    return [stream for stream in container.streams.video if not stream.disposition & _NO_FILM]


def video_stream(container: InputContainer, chosen: int | None = None) -> VideoStream:
    """The video stream to read.

    Args:
        chosen: its number among `film_streams`; None: the one that FFmpeg prefers (by default flag, number of pictures
            and bit rate), but a still or auxiliary stream only if there is no other.

    Raises:
        NoVideoStream: the container has no video stream.
        BadParameter: there is no stream of this number.
        UnreadableMedia: there is no decoder for its codec.
    """
    streams = film_streams(container)
    if not streams:
        raise NoVideoStream(
            "The file contains no video stream.",
            field="file",
            value=", ".join(s.type for s in container.streams) or container.format.name,
            remedy="Upload a file with moving pictures.",
        )
    if chosen is not None:
        found = _numbered(streams, chosen)
    else:
        known = [stream for stream in streams if stream.codec_context is not None] or streams
        usual = [stream for stream in known if not stream.disposition & _SECONDARY] or known
        best = container.streams.best("video")
        found = next((stream for stream in usual if best is not None and stream.index == best.index), usual[0])
    if found.codec_context is None:
        unreadable("The video's codec is unknown.", container.format.name, "Re-encode it as H.264 in MP4.")
    return found


def _numbered(streams: list[VideoStream], number: int) -> VideoStream:
    if not 0 <= number < len(streams):
        count = f"{len(streams)} video {'stream' if len(streams) == 1 else 'streams'}"
        raise BadParameter(
            f"The file has {count}.", field="source.picture", value=number, remedy=f"Use 0 to {len(streams) - 1}."
        )
    return streams[number]


def choice_notes(container: InputContainer, found: VideoStream) -> tuple[Note, ...]:
    """Which of several video streams is read."""
    streams = film_streams(container)
    if len(streams) < 2:
        return ()
    number = next(at for at, stream in enumerate(streams) if stream.index == found.index)
    context = found.codec_context
    what = f"{context.name}, {context.width}x{context.height}"
    default = ", the default" if found.disposition & Disposition.default else ""
    message = f"The file has {len(streams)} video streams: stream {number} ({what}{default}) was read."
    return (Note("stream-choice", message),)


def sound_streams(container: InputContainer) -> list[AudioStream]:
    """The sound tracks that can be decoded."""
    return [stream for stream in container.streams.audio if stream.codec_context is not None]


def finished(sink: FilterContext) -> Iterator[Any]:
    """The frames that a filter graph has finished."""
    while True:
        try:
            yield sink.pull()
        except (BlockingIOError, EOFError):
            return


def has_alpha_plane(stream: VideoStream) -> bool:
    """Whether a Matroska track says that its packets have an alpha plane of their own. Muxers write the key of this tag
    in lower or upper case."""
    return any(name.lower() == "alpha_mode" and value == "1" for name, value in stream.metadata.items())


def decoder_of(stream: VideoStream, limits: Limits, threads: int) -> VideoCodecContext:
    """Create a decoder for the stream that rejects pictures far above the limits.

    Args:
        threads: decoding threads; 0 = one per core. The output of undamaged files does not depend on it.
    """
    context = stream.codec_context
    name = _WITH_ALPHA.get(context.name)
    if name and has_alpha_plane(stream):
        context = CodecContext.create(name, "r")
    context.options = {"max_pixels": _most_pixels(limits)}
    context.thread_type = "AUTO"
    context.thread_count = threads
    return context
