"""Writing of animated images (WebP, AVIF) with Pillow, from segments of lossless pictures, one picture in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipeline.formats.base import Profile, Progress, Segments
from pipeline.video.container import open_container
from pipeline.video.media import Limits

TICK = Fraction(1, 1000)
LOSSLESS_PICTURES: dict[str, Any] = {
    "codec": "png", "codec_options": lambda quality: {"compression_level": "1"}, "pixel_format": "rgb24",
    "segment_container": "mov",
}  # fmt: skip
"""Fields of a profile whose segments hold pictures for `joined_by`."""


def animated(name: str, title: str, help_text: str) -> Profile:
    """The one profile of an animated image with opacity."""
    return Profile(
        name=name, title=title, help=help_text, alpha_format="rgba", low_bytes_per_pixel=0.01, bytes_per_pixel=1,
        **LOSSLESS_PICTURES,
    )  # fmt: skip


def joined_by(plugin: str, options: Callable[[int], dict[str, Any]]) -> Callable[[Segments, Path, Progress, int], None]:
    """A function that writes an animation that is repeated without end; `options`: of Pillow, for a quality 0..51."""

    def join(segments: Segments, out: Path, progress: Progress, quality: int) -> None:
        film = _Film(segments, progress)
        film.save(out, plugin, save_all=True, loop=0, duration=film.durations, **options(quality))

    return join


class _Film(Image.Image):
    """The pictures of segments as one image of many frames, which Pillow asks for in order."""

    def __init__(self, segments: Segments, progress: Progress) -> None:
        super().__init__()
        self._segments, self._progress = segments, progress
        self.durations = _durations_ms(segments)
        """Duration of each frame, ms."""
        self.n_frames = len(self.durations)
        self.is_animated = self.n_frames > 1
        self._pictures: Iterator[Image.Image] = iter(())
        self._next = -1
        self.seek(0)

    def tell(self) -> int:
        return self._next - 1

    def seek(self, frame: int) -> None:
        if frame >= self.n_frames:
            raise EOFError
        if frame == self.tell():
            return
        if frame != self._next:
            self._pictures, self._next = _pictures(self._segments), 0
        for picture in self._pictures:
            self._next += 1
            if self._next > frame:
                self.im, self._mode, self._size = picture.im, picture.mode, picture.size
                break
        self._progress(frame / self.n_frames)


def _pictures(segments: Segments) -> Iterator[Image.Image]:
    for _start, path in segments:
        with open_container(path, Limits()) as source:
            for picture in source.decode(source.streams.video[0]):
                yield Image.fromarray(np.asarray(picture.to_ndarray(), np.uint8))


def _durations_ms(segments: Segments) -> list[int]:
    """Duration of each frame, ms: the difference of its rounded end and start, so that rounding does not add up."""
    edges: list[Fraction] = []
    for start, path in segments:
        with open_container(path, Limits()) as source:
            for packet in source.demux(source.streams.video[0]):
                if packet.size:
                    at = start + (packet.pts or 0) * packet.time_base
                    edges.append(at)
                    end = at + (packet.duration or 0) * packet.time_base
    ticks = [round((edge - edges[0]) / TICK) for edge in (*edges, end)]
    return [max(1, later - earlier) for earlier, later in pairwise(ticks)]
