"""A sink that writes a video file with the times and the sound of the source."""

from __future__ import annotations

import shutil
import tempfile
from fractions import Fraction
from pathlib import Path

import av

from impasto.delivery import OutputTarget, swap
from impasto.live.sink import Sink, upscaled
from impasto.live.sources import Sound, Source
from pipeline.frames import Frame
from pipeline.video.audio import audio_of
from pipeline.video.container import open_container
from pipeline.video.join import join
from pipeline.video.media import Limits
from pipeline.video.writer import SegmentSpec, SegmentWriter, segment_writer

TICKS = 90_000
"""Ticks per second of frame times in the file."""


class VideoFileSink(Sink):
    """Writes a video file, which appears whole or not at all. A dropped frame is replaced by a longer one before it."""

    def __init__(self, where: OutputTarget, source: Source, quality: int) -> None:
        self._where, self._sound = where, source.sound
        self._spec = SegmentSpec(where.format, source.size, Fraction(1, TICKS), source.fps, quality)
        self._scratch: Path | None = None
        self._writer: SegmentWriter | None = None
        self._pending: tuple[int, Frame] | None = None
        self._first = 0

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        start = round(when_s * TICKS)
        if self._pending is None:
            self._begin(start)
        elif start > self._pending[0]:
            self._write(start)
        else:
            return  # of two frames with the same time, the first is shown
        self._pending = (start, upscaled(frame, self._spec.size))

    def _begin(self, start: int) -> None:
        """Write beside the output, on the same disk, so that a rename finishes it."""
        folder = self._where.path.parent
        folder.mkdir(parents=True, exist_ok=True)
        self._scratch = Path(tempfile.mkdtemp(prefix=f".{self._where.path.name}.", dir=folder))
        self._writer = segment_writer(self._scratch / "pictures", self._spec).__enter__()
        self._first = start

    def _write(self, stop: int) -> None:
        assert self._pending is not None and self._writer is not None
        self._writer.write(self._writer.frames, self._pending[1], self._pending[0], stop)

    def finish(self, end_s: float) -> str:
        if self._pending is None or self._writer is None or self._scratch is None:
            return ""
        try:
            end = max(round(end_s * TICKS), self._pending[0] + 1)
            self._write(end)
            self._writer.__exit__(None, None, None)
            self._bind(self._scratch, Fraction(end, TICKS))
        finally:
            shutil.rmtree(self._scratch, ignore_errors=True)
        return str(self._where.path)

    def _bind(self, scratch: Path, end_s: Fraction) -> None:
        start_s, sound = Fraction(self._first, TICKS), None
        if self._sound is not None:
            sound = sound_until(self._sound, end_s, scratch / "sound.nut")
            start_s += self._sound.first_s
        join([(start_s, scratch / "pictures")], scratch / "whole", self._spec.format, sound, whole=False)
        swap(scratch / "whole", self._where.path)


def sound_until(sound: Sound, end_s: Fraction, scratch: Path) -> Path:
    """The sound up to the time at which the pictures end, seconds from their first; cut into `scratch` if need be."""
    if end_s > sound.length_s - 1 / Fraction(100):
        return sound.path
    try:
        with open_container(sound.path, Limits()) as source, av.open(str(scratch), "w", format="nut") as target:
            if (stream := audio_of(source)) is None:
                return sound.path
            copy = target.add_stream_from_template(stream)
            for packet in source.demux(stream):
                if packet.pts is None or packet.time_base is None:
                    continue
                if packet.pts * packet.time_base >= sound.first_s + end_s:
                    break
                packet.stream = copy
                target.mux(packet)
    except (av.FFmpegError, OSError):
        return sound.path  # sound that is too long is better than none
    return scratch
