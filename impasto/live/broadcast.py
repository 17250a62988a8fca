"""Sinks that stream to a server: FLV over RTMP, MPEG-TS over TCP, UDP and SRT."""

from __future__ import annotations

from fractions import Fraction
from urllib.parse import urlsplit

import av
from av.codec.context import Flags
from av.container import OutputContainer
from av.video.stream import VideoStream

from impasto.live.sink import Sink, upscaled
from impasto.live.sources import Size, check_protocol
from pipeline.errors import BadInput, ImpastoError
from pipeline.frames import Frame

TICKS = 1000
"""Ticks per second of FLV."""
SILENT_S = 10
"""Longest time without the server accepting data, seconds."""
_FORMATS = {"rtmp": "flv", "rtmps": "flv", "tcp": "mpegts", "udp": "mpegts", "srt": "mpegts"}


class OutputLost(ImpastoError):
    """The server no longer accepts the stream."""

    code = "output-lost"


class Broadcast(Sink):
    """FFmpeg's fifo muxer writes on a thread of its own: a slow server loses packets and never blocks the stream.
    (Without it a server that is silent stops the whole process, since PyAV connects with the interpreter locked.)

    The connection is made once and not tried before, because many servers take one sender only.

    Raises: BadInput (another scheme, no address); `put`, OutputLost, also where nobody takes connections.
    """

    def __init__(self, address: str, size: Size, fps: float) -> None:
        self._address, self._size = address, (size[0] - size[0] % 2, size[1] - size[1] % 2)
        kind = _format(address)
        check_protocol(address, "--output")
        try:
            _ = urlsplit(address).port
            self._file = _fifo(address, kind)
            self._stream = _h264(self._file, self._size, fps, headers_apart=kind != "mpegts")
            self._file.start_encoding()
        except (av.FFmpegError, OSError, ValueError) as error:
            raise BadInput(
                f"It cannot be streamed to: {error}.", field="--output", value=address,
                remedy="Check the address, and that the server accepts streams there.",
            ) from None  # fmt: skip
        self._last, self._lost = -1, False

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        at = round(when_s * TICKS)
        if at > self._last:
            picture = av.VideoFrame.from_ndarray(upscaled(frame, self._size), format="rgb24")
            picture.pts, picture.time_base, self._last = at, Fraction(1, TICKS), at
            self._send(picture)

    def _send(self, picture: av.VideoFrame | None) -> None:
        try:
            self._file.mux(self._stream.encode(picture))
        except (av.FFmpegError, OSError) as error:
            self._lost = True
            raise OutputLost(
                f"The server takes no more: {error}.", field="--output", value=self._address,
                remedy="Check the server and the address, then start again.",
            ) from None  # fmt: skip

    def finish(self, end_s: float) -> str:
        if not self._lost:
            self._send(None)
            self._file.close()
        return self._address


def _format(address: str) -> str:
    scheme = address.partition("://")[0]
    if scheme not in _FORMATS:
        remedy = f"Use an address that begins with one of: {', '.join(f'{name}://' for name in _FORMATS)}."
        raise BadInput("The address has no known streaming protocol.", field="--output", value=address, remedy=remedy)
    return _FORMATS[scheme]


def _fifo(address: str, kind: str) -> OutputContainer:
    options = {
        "fifo_format": kind, "format_opts": f"rw_timeout={SILENT_S * 1_000_000}", "drop_pkts_on_overflow": "1",
    }  # fmt: skip
    return av.open(address, "w", format="fifo", options=options)


def _h264(file: OutputContainer, size: Size, fps: float, headers_apart: bool) -> VideoStream:
    """An encoder stream without look-ahead or reordering."""
    rate = Fraction(fps).limit_denominator(1001)
    stream = file.add_stream("libx264", rate=rate, options={"preset": "veryfast", "tune": "zerolatency"})
    assert isinstance(stream, VideoStream)
    stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
    stream.codec_context.time_base = Fraction(1, TICKS)
    stream.codec_context.gop_size = max(1, round(2 * fps))
    if headers_apart:
        stream.codec_context.flags |= Flags.global_header
    return stream
