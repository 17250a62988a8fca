"""The frame index of a video: presentation times of its frames."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.video.media import SEQUENCE_FPS, Note

_NO_TIME = np.iinfo(np.int64).min
Gap = tuple[int, int]
"""(frame, count): `count` frames are missing before frame number `frame` of the file."""


@dataclass(frozen=True)
class Index:
    """Presentation times of the frames of a video, in display order.

    `exact`: the number of frames is known. Otherwise `pts` is generated at the nominal rate, and the number of frames
    is an estimate.
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
    missing: tuple[Gap, ...] = ()
    """Gaps in which frames of the file are missing."""
    incomplete: frozenset[int] = frozenset()
    """Indices of frames whose data are cut off."""
    stored: NDArray[np.int64] | None = None
    """Times of the pictures in the file, ticks of the stream, by which decoded pictures are recognised; None: they are
    counted."""
    repeats: frozenset[int] = frozenset()
    """Frames without a picture of their own in an undamaged file, which show the picture before."""
    notes: tuple[Note, ...] = ()
    """Notes about streams that were chosen, and times that were corrected or assumed."""
    numbers: tuple[int, ...] = ()
    """Numbers of the frames of an image sequence; empty: frames are counted from 0."""

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

    def number(self, frame: int) -> int:
        """Number of a frame in the source: in file names of an image sequence, otherwise its index."""
        return self.numbers[frame] if frame < len(self.numbers) else frame

    def coded_from(self, frame: int) -> int:
        """The first frame at or after `frame` that has a picture of its own."""
        while frame in self.repeats:
            frame += 1
        return frame

    def key_before(self, frame: int) -> int:
        """The last frame at or before `frame` at which decoding can start."""
        return int(self.keys[max(0, int(np.searchsorted(self.keys, frame, side="right")) - 1)])

    def without_keys(self) -> Self:
        """The index for reads that always begin at the start."""
        return replace(self, keys=np.zeros(1, np.int64))

    def without_holes(self) -> Self:
        """The index of frames of one tick each, with a repeated frame in each hole between two pictures."""
        first, last = int(self.pts[0]), int(self.pts[-1])
        places, pts = self.pts - first, np.arange(first, last + 1, dtype=np.int64)
        stored = None if self.stored is None else np.full(len(pts), _NO_TIME)
        if stored is not None:
            stored[places] = self.stored
        return replace(
            self,
            pts=pts,
            keys=places[self.keys],
            missing=tuple((int(places[at]) if at < len(places) else len(pts), count) for at, count in self.missing),
            incomplete=frozenset(int(places[frame]) for frame in self.incomplete),
            stored=stored,
            repeats=frozenset(range(len(pts))) - frozenset(places.tolist()),
        )

    def without_first(self, count: int) -> Self:
        """The index without the first `count` frames, of which no picture can be decoded."""
        noun = "picture was" if count == 1 else "pictures were"
        message = f"{count} {noun} left out before the first one that can be decoded: the file begins within a group."
        return replace(
            self,
            pts=self.pts[count:],
            keys=np.union1d([0], np.maximum(self.keys - count, 0)),
            missing=tuple((max(0, frame - count), gap) for frame, gap in self.missing),
            incomplete=frozenset(frame - count for frame in self.incomplete if frame >= count),
            stored=None if self.stored is None else self.stored[count:],
            repeats=frozenset(frame - count for frame in self.repeats if frame >= count),
            notes=(*self.notes, Note("left-out", message)),
        )


class FrameReader(ABC):
    """Base class of readers of frames: frame count, times and frame rate from the index, and closing."""

    @property
    @abstractmethod
    def index(self) -> Index:
        """Presentation times of the frames."""

    @abstractmethod
    def close(self) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    @property
    def frames(self) -> int:
        """Number of frames; an estimate if `index.exact` is false."""
        return len(self.index.pts)

    @property
    def timestamps(self) -> NDArray[np.int64]:
        """Presentation time of each frame, ticks of `time_base`."""
        return self.index.pts

    @property
    def time_base(self) -> Fraction:
        """Duration of a tick, seconds."""
        return self.index.time_base

    @property
    def fps(self) -> float:
        """Mean frame rate, frames per second."""
        return self.index.fps
