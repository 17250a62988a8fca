"""Image sequences (a folder or zip of numbered images, or one still image) with the same interface as `Clip`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.frames import Frame, same_size
from pipeline.video.archive import natural_key, open_archive, read_entry
from pipeline.video.geometry import Geometry
from pipeline.video.index import Index
from pipeline.video.media import SEQUENCE_FPS, Limits, check_bytes, unreadable
from pipeline.video.shot_files import FRAMES, is_shot, pictures_of
from pipeline.video.stills import decode_rgb

_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp", ".exr"})
_IMAGE_BYTES = 1 << 30
Loader = tuple[str, Callable[[], bytes]]
"""Name of an image, and a function that returns its encoded bytes."""


class Sequence:
    """Images as the frames of a video at `SEQUENCE_FPS` frames per second.

    Args:
        loaders: one for each frame, in order.
        limits: limits of each image.
        close: releases the source of the images.
    """

    def __init__(self, loaders: list[Loader], limits: Limits, close: Callable[[], None]) -> None:
        self._loaders = loaders
        self._limits = limits
        self._close = close
        self.errors: list[str] = []
        self.unreadable: list[int] = []
        self.position: int | None = 0
        count = len(loaders)
        ticks = np.arange(count, dtype=np.int64)
        self.index = Index(ticks, ticks, count, Fraction(1, SEQUENCE_FPS), True)
        first = self._load(0)
        self.geometry = Geometry((first.shape[1], first.shape[0]))
        self.pixel_format = "rgb24"

    def close(self) -> None:
        self._close()

    def read(self, start: int, stop: int) -> Iterator[Frame]:
        """Yield the frames [start, stop). Raises BadFrame if the size of a frame differs from that of the first."""
        for at in range(start, min(stop, len(self._loaders))):
            self.position = at + 1
            yield same_size(self._load(at), self.geometry.size, self._loaders[at][0])

    def _load(self, at: int) -> Frame:
        name, load = self._loaders[at]
        return decode_rgb(load(), self._limits, name)


def open_still(path: Path, limits: Limits) -> Sequence:
    """Open one image as a video of one frame."""
    check_bytes(path.stat().st_size, min(limits.size_bytes, _IMAGE_BYTES))
    return Sequence([("image", path.read_bytes)], limits, lambda: None)


def open_folder(path: Path, limits: Limits) -> Sequence:
    """Open the images of a folder, ordered by the numbers in their names; for a shot, the images in `frames`."""
    below = [str(p.relative_to(path)) for p in (*path.glob("*"), *path.glob("*/*"))]
    found = path / FRAMES if is_shot(below) else path
    files = [p for p in found.iterdir() if p.suffix.lower() in _SUFFIXES and not p.name.startswith(".")]
    if not files:
        unreadable("The folder holds no images.", path, "Number PNG or JPEG frames in their names.")
    files.sort(key=lambda p: natural_key(p.name))
    return Sequence([(p.name, p.read_bytes) for p in files], limits, lambda: None)


def open_zip(path: Path, limits: Limits) -> Sequence:
    """Open the images of a zip, ordered by the numbers in their names; for a shot, the images in `frames`."""
    archive, members = open_archive(path, limits)
    try:
        frames = {member.filename: member for member in members}
        loaders: list[Loader] = [(name, partial(read_entry, archive, frames[name])) for name in pictures_of(frames)]
        return Sequence(loaders, limits, archive.close)
    except BaseException:
        archive.close()
        raise
