"""Animated images (animated PNG, WebP, AVIF, ...) with the same interface as `Clip`."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.formats.base import ImageFormat
from pipeline.frames import Frame
from pipeline.video.geometry import USUAL, Geometry
from pipeline.video.index import Index
from pipeline.video.media import Limits, Note, SourceOptions, opacity_notes
from pipeline.video.opacity import as_frame


class AnimatedImage:
    """The pictures of an animated image as the frames of a video with their own times. Reading backwards decodes from
    the first picture on.

    Raises: UnreadableMedia, MediaTooLarge.
    """

    def __init__(self, path: Path, form: ImageFormat, limits: Limits, options: SourceOptions = USUAL) -> None:
        self._options = options
        self._pictures = form.animation(path, limits)
        self.errors: list[str] = []
        self.unreadable: list[int] = []
        self.pixel_format = "rgba"
        starts = np.asarray(self._pictures.starts, np.int64)
        self.index = Index(
            starts, np.zeros(1, np.int64), self._pictures.end, Fraction(1, 1000), True,
            incomplete=self._pictures.incomplete,
        )  # fmt: skip
        self.position: int | None = 0
        self._frames: Iterator[AnyArray] = self._pictures.frames(0)
        first = next(self._frames)
        self.has_alpha = first.ndim == 3 and first.shape[2] == 4
        self.notes: tuple[Note, ...] = opacity_notes(self.has_alpha, options)
        self.geometry = Geometry((first.shape[1], first.shape[0]))
        self.position = 1

    def close(self) -> None:
        self._pictures.close()

    def read(self, start: int, stop: int) -> Iterator[Frame]:
        """Yield the frames [start, stop); fewer if the animation ends earlier."""
        if start != self.position:
            self._frames, self.position = self._pictures.frames(start), start
        for at in range(start, min(stop, len(self.index.pts))):
            picture = next(self._frames)
            self.position = at + 1
            if at in self.index.incomplete:
                self.unreadable.append(at)
            width, height = self.geometry.size
            yield as_frame(picture[:height, :width], self._options)  # pictures of a GIF can reach beyond its screen
