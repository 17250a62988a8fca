"""Safe opening of containers, and the frame index of a video (presentation times), read without decoding.

Only demuxers of self-contained formats are allowed, since a playlist could refer to other files or network addresses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal

import av
import numpy as np
from av.codec import CodecContext
from av.container import InputContainer
from av.stream import Discard
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream
from numpy.typing import NDArray

from pipeline.errors import NoVideoStream
from pipeline.video.media import SEQUENCE_FPS, Limits, unreadable

_DEMUXERS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,gif,apng,mpegts,mpeg,flv,ogg,asf,ivf,obu,h264,hevc,m4v,mjpeg,nut,mxf,"
    "dv,rm,yuv4mpegpipe,mpegvideo,vc1,wtv,mp3,wav,flac,aac,ac3,aiff,caf,amr"
)
"""Allowed demuxers: video containers, and audio containers, to distinguish audio files from unreadable ones."""
_SEEKABLE = ("mov,mp4,m4a,3gp,3g2,mj2", "matroska,webm", "avi")
"""Demuxers that give the same times after a seek as in a read from the start."""
_WITH_ALPHA: dict[str, Literal["libvpx", "libvpx-vp9"]] = {"vp8": "libvpx", "vp9": "libvpx-vp9"}
"""Decoders that also decode the separate alpha plane, which FFmpeg's native decoders ignore."""
_DEPENDENT = frozenset({"gif", "apng"})
"""Codecs whose pictures are drawn over the previous one, even if the packets are marked as keyframes."""


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


@dataclass(frozen=True)
class Index:
    """Presentation times of the frames of a video, in display order.

    `exact`: every frame has a time of its own, and the index of a decoded picture is the rank of its time. Otherwise
    `pts` is generated at the nominal rate, and the number of frames is an estimate.
    """

    pts: NDArray[np.int64]
    """Ticks of `time_base`, strictly increasing."""
    keys: NDArray[np.int64]
    """Frame indices at which decoding can start; decoding can always start at 0."""
    end: int
    """End of the last frame, ticks."""
    time_base: Fraction
    """Duration of a tick, seconds."""
    exact: bool

    @property
    def duration_s(self) -> float:
        return float((self.end - int(self.pts[0])) * self.time_base) if len(self.pts) else 0.0

    @property
    def fps(self) -> float:
        """Mean frame rate, frames per second. Excludes the duration of the last frame, which some files prolong."""
        steps, seconds = len(self.pts) - 1, float((int(self.pts[-1]) - int(self.pts[0])) * self.time_base)
        return steps / seconds if steps > 0 else float(SEQUENCE_FPS)

    def time(self, frame: int) -> int:
        """Start of `frame`, ticks; frames beyond the end have the duration of the last frame."""
        if frame < len(self.pts):
            return int(self.pts[frame])
        last = self.end - int(self.pts[-1])
        return self.end + (frame - len(self.pts)) * last

    def key_before(self, frame: int) -> int:
        """The last frame at or before `frame` at which decoding can start."""
        return int(self.keys[np.searchsorted(self.keys, frame, side="right") - 1])


def build_index(path: Path, limits: Limits) -> Index:
    """Build the index from the packets of the video stream, without decoding. Raises UnreadableMedia, NoVideoStream."""
    with open_container(path, limits) as container:
        stream = video_stream(container)
        for other in container.streams:
            if other.index != stream.index:
                other.discard = Discard.all
        packets = list(_shown(container, stream))
        seekable = container.format.name in _SEEKABLE and stream.codec_context.name not in _DEPENDENT
        times = [p[0] for p in packets]
        if packets and None not in times and len(set(times)) == len(times):
            return _exact(packets, stream.time_base or Fraction(1, 1000), seekable)
        return _estimated(len(packets), _nominal_rate(stream))


def _shown(container: InputContainer, stream: VideoStream) -> Iterator[tuple[int | None, int, bool]]:
    """(pts, duration, is keyframe) of every packet that yields a picture."""
    vp8 = stream.codec_context.name in ("vp8", "libvpx")
    try:
        for packet in container.demux(stream):
            hidden = packet.is_discard or (vp8 and packet.size > 0 and not memoryview(packet)[0] & 0x10)
            if packet.size and not hidden:
                yield packet.pts, packet.duration or 0, packet.is_keyframe
    except (av.FFmpegError, OSError):
        return  # truncated file: use the packets read so far


def _exact(packets: list[tuple[int | None, int, bool]], time_base: Fraction, seekable: bool) -> Index:
    table = sorted((pts or 0, duration, key) for pts, duration, key in packets)
    pts = np.array([row[0] for row in table], np.int64)
    keys = np.flatnonzero([row[2] for row in table]).astype(np.int64) if seekable else np.empty(0, np.int64)
    usual = int(np.median(np.diff(pts))) if len(pts) > 1 else max(1, round(1 / SEQUENCE_FPS / time_base))
    last = table[-1][1] or usual
    return Index(pts, np.union1d([0], keys), int(pts[-1]) + last, time_base, True)


def _estimated(count: int, rate: Fraction) -> Index:
    """Index of frames without times: `count` frames at the nominal rate."""
    return Index(np.arange(count, dtype=np.int64), np.zeros(1, np.int64), count, 1 / rate, False)


def _nominal_rate(stream: VideoStream) -> Fraction:
    return stream.average_rate or stream.guessed_rate or Fraction(SEQUENCE_FPS)
