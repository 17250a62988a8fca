"""`VideoReader`: the frames of anything that shows pictures, by exact index, one at a time."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.video.clip import Clip
from pipeline.video.container import Index
from pipeline.video.headers import IMAGE_TYPES, image_header, is_still, sniff
from pipeline.video.media import Limits, check_bytes, unreadable
from pipeline.video.sequence import Sequence, open_folder, open_still, open_zip


class VideoReader:
    """Reads a video container, a GIF, a folder or zip of numbered images, or one still image (a video of one frame).

    Frames come as shown: turned by rotation metadata, with square pixels, composited over white, sRGB from the
    stream's own matrix and range; a picture whose size changes mid-stream is scaled to the first one's. Reading on
    where the last read stopped never seeks. Memory is bounded by a few frames. Not thread-safe. Close it.

    Raises: UnreadableMedia, NoVideoStream, MediaTooLarge.
    """

    def __init__(self, path: Path, limits: Limits | None = None) -> None:
        self._source: Clip | Sequence = _open(Path(path), limits or Limits())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._source.close()

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of every frame, px."""
        return self._source.geometry.size

    @property
    def rotation_deg(self) -> int:
        return self._source.geometry.rotation_deg

    @property
    def pixel_format(self) -> str:
        """How pictures are stored (FFmpeg's name)."""
        return self._source.pixel_format

    @property
    def frames(self) -> int:
        """How many frames there are; an estimate if `index.exact` is false."""
        return len(self._source.index.pts)

    @property
    def index(self) -> Index:
        """Presentation times, without decoding."""
        return self._source.index

    @property
    def timestamps(self) -> NDArray[np.int64]:
        """When each frame is shown, ticks of `time_base`."""
        return self._source.index.pts

    @property
    def time_base(self) -> Fraction:
        """Seconds a tick."""
        return self._source.index.time_base

    @property
    def fps(self) -> float:
        """Mean rate."""
        return self._source.index.fps

    @property
    def errors(self) -> list[str]:
        """What would not decode so far; the frames concerned repeat the one before."""
        return self._source.errors

    @property
    def position(self) -> int | None:
        """The first frame that can be read without a seek, or None."""
        return self._source.position

    def read(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        """Frames [start, stop) in order; fewer if the video ends earlier. Start another read only after this one."""
        if start < 0 or (stop is not None and stop < start):
            raise ValueError(f"no frames [{start}, {stop})")
        return self._source.read(start, stop if stop is not None else _FOREVER)


_FOREVER = 1 << 62


def _open(path: Path, limits: Limits) -> Clip | Sequence:
    if path.is_dir():
        return open_folder(path, limits)
    check_bytes(path.stat().st_size, limits.size_bytes)
    with path.open("rb") as stream:
        media_type = sniff(stream)
        still = media_type in IMAGE_TYPES and is_still(image_header(stream, media_type))
    if media_type == "application/json":
        unreadable("The file is JSON, not pictures.")
    if media_type == "application/zip":
        return open_zip(path, limits)
    return open_still(path, limits) if still else Clip(path, limits)
