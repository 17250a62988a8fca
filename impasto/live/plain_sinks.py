"""Opens the sink of a live stream by its name. Contains the sinks for a folder of frames and for no output."""

from __future__ import annotations

from impasto.delivery import OutputTarget, check_new, forget, swap, target
from impasto.live.sink import Sink
from impasto.live.sources import Source
from pipeline.errors import BadInput
from pipeline.formats import OUTPUTS
from pipeline.frames import Frame
from pipeline.video.numbering import number_by
from pipeline.video.stills import encode_png


def open_sink(text: str, source: Source, quality: int, overwrite: bool = True) -> Sink:
    """A sink by its name: a file, a folder (`DIR/`), rtmp://..., whip://...,
    `window`, or `none` (frames are counted, not kept). `overwrite`: whether a file or folder may be replaced.

    Raises: BadInput.
    """
    if text == "none":
        return NullSink()
    if text == "window":
        from impasto.live.window import Window  # needs the extra "window"

        return Window(source.size)
    if text.startswith(("whip://", "whips://")):
        from impasto.live.whip import WhipSink  # needs the extra "webrtc"

        return WhipSink(text, source.size)
    if "://" in text:
        from impasto.live.broadcast import Broadcast

        return Broadcast(text, source.size, source.fps)
    where = target(text)
    png_frames = where.kind == "frames" and number_by(where.pattern, "0000.png") is not None
    if not png_frames and OUTPUTS[where.format].sound is None:
        remedy = "Use a .mp4 or .webm file, or DIR/ for numbered frames."
        raise BadInput("The output is not a known sink.", field="--output", value=text, remedy=remedy)
    check_new(where.path, overwrite)
    if png_frames:
        return Frames(where)
    from impasto.live.video_file import VideoFileSink

    return VideoFileSink(where, source, quality)


class NullSink(Sink):
    """Discards frames, for measurements."""

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        return

    def finish(self, end_s: float) -> str:
        return "none"


class Frames(Sink):
    """A folder of PNGs, numbered from 0000 in the order of answers. It replaces one of an earlier run at the end."""

    def __init__(self, where: OutputTarget) -> None:
        self._where, self._count = where, 0
        self._part = where.path.with_name(f".{where.path.name}.part")

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        if not self._count:
            forget(self._part)
            self._part.mkdir(parents=True)
        (self._part / f"{self._count:04d}.png").write_bytes(encode_png(frame))
        self._count += 1

    def finish(self, end_s: float) -> str:
        if not self._count:
            return ""
        swap(self._part, self._where.path)
        return str(self._where.path)
