"""Access to the frames of a video container by exact frame index.

Frame i is the picture shown from the i-th presentation time on. A frame that cannot be decoded is replaced by the frame
before it and reported in `errors`, so that frame indices and sound stay synchronous. A packet without a picture ("not
coded") repeats the frame before it; that is no damage.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import av

from pipeline.arrays import AnyArray
from pipeline.video.decoder import DamagedPass, NotAKey, Pass
from pipeline.video.fields import EarlierNeeded, Numbered, is_interlaced
from pipeline.video.geometry import Geometry, geometry_of, has_alpha, to_frame
from pipeline.video.index import Index
from pipeline.video.index_builder import build_index
from pipeline.video.media import Limits, Note, SourceOptions, check_size, opacity_notes, unreadable
from pipeline.video.wide_colour import colour_notes, wide_signal


class Clip:
    """Frames of a container, decoded forwards, with seeks to keyframes. One decoder stays open between reads.

    A damaged file is always decoded from its start, by a single thread, so that error concealment does not depend on
    the frame at which reading starts. So is a file whose frames are counted.
    """

    def __init__(self, path: Path, limits: Limits, options: SourceOptions | None = None) -> None:
        self._path = path
        self._limits = limits
        self._options = options or SourceOptions()
        self.errors: list[str] = []
        self.unreadable: list[int] = []
        self._forget()
        self.index: Index = build_index(path, limits, self._options)
        self._tolerant = self.index.stored is None
        self._interlaced = False
        """Whether a frame may depend on the one before it."""
        first = self._first()
        check_size(first.width, first.height, limits)
        self._wide = wide_signal(first)
        self.pixel_format, self.has_alpha = first.format.name, has_alpha(first)
        self._stored_size = first.width, first.height
        assert self._pass is not None
        self.geometry: Geometry = geometry_of(first, self._pass.aspect, self._pass.crop)

    def _first(self) -> av.VideoFrame:
        """The first picture; frames before it that have none are removed from the index."""
        first = self._retried(0)
        if first is None or self._current is None or self._pass is None:
            unreadable("No picture of the video can be decoded: it is cut off or damaged.")
        place = self._current[0]
        if place and not self._pass.failed.intersection(range(place)) and not self.index.incomplete:
            self.index = self.index.without_first(place)
            self._tolerant = self.index.stored is None
            self.close()
            first = self._retried(0) or first
        assert self._pass is not None
        self._interlaced = is_interlaced(first, self._options.fields) or self._pass.has_fields
        return first

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes about streams that were chosen, and times that were corrected or assumed."""
        found = [*self.index.notes]
        if self._interlaced and self._options.fields == "auto":
            found.append(Note("deinterlaced", "The video is interlaced: its fields were made into frames."))
        if self._stored_size != self.geometry.shown_of(self._stored_size):
            shown, whole = (f"{w}x{h}" for w, h in (self.geometry.shown_of(self._stored_size), self._stored_size))
            found.append(Note("cropped", f"The container crops the pictures: {shown} of {whole} px are shown."))
        return (*found, *colour_notes(self._wide, self._options), *opacity_notes(self.has_alpha, self._options))

    def _forget(self) -> None:
        self._pass: Pass | None = None
        self._current: Numbered | None = None
        """The last picture at or before the requested frame (or the first picture of the video)."""
        self._ahead: Numbered | None = None
        """The picture after `_current`, if it was decoded already to detect a gap."""

    def close(self) -> None:
        if self._pass:
            self._pass.close()
        self._forget()

    @property
    def position(self) -> int | None:
        """Index of the first frame that can be read without a seek; None = no decoder is open."""
        if self._current:
            return self._current[0]
        return self._pass.position if self._pass else None

    def read(self, start: int, stop: int) -> Iterator[AnyArray]:
        """Yield the frames [start, stop); fewer if the video ends earlier."""
        for at in range(start, min(stop, len(self.index.pts)) if self.index.exact else stop):
            picture = self._retried(at)
            if picture is None:
                return
            if not self._is_intact(at):
                self.unreadable.append(at)
            yield to_frame(picture, self.geometry, self._options)

    def _is_intact(self, at: int) -> bool:
        """Whether nothing of frame `at`, whose picture was just found, is lost."""
        assert self._current is not None and self._pass is not None
        found, picture = self._current
        lost = at in self._pass.failed or at in self.index.incomplete
        return not lost and not (found == at and picture.is_corrupt)

    def _retried(self, at: int) -> av.VideoFrame | None:
        try:
            return self._picture(at)
        except DamagedPass:
            self._tolerant = True
        except NotAKey:
            self.index = self.index.without_keys()
        except EarlierNeeded:
            self._interlaced = True
        self.close()
        return self._retried(at)

    def _picture(self, at: int) -> av.VideoFrame | None:
        """The picture shown at frame `at`: the last one at or before it, otherwise the first one of the video."""
        source = self._pass_to(at)
        while self._current is None or self._current[0] < at:
            self._ahead = self._ahead or next(source, None)
            if self._ahead is None:
                return self._after_end()
            if self._ahead[0] > at and self._current is not None:
                break
            self._current, self._ahead = self._ahead, None
        return self._current[1]

    def _after_end(self) -> av.VideoFrame | None:
        """The picture to show if the decoder ends before the requested frame; None = the video ends here."""
        if not self.index.exact or self._current is None:
            return None
        if not self._tolerant:
            raise DamagedPass("the last pictures are missing")
        return self._current[1]

    def _pass_to(self, at: int) -> Pass:
        """The open decoder pass if decoding on reaches `at` fastest, otherwise a new one from the keyframe before."""
        wanted = at - 1 if self._interlaced else at
        key = 0 if self._tolerant or not len(self.index.pts) else self.index.key_before(wanted)
        reached = self.position
        if self._pass is None or reached is None or at < reached or key > self._pass.position:
            self.close()
            errors = self.errors if self._tolerant else None
            self._pass = Pass(self._path, self.index, key, self._limits, self._options, errors, self._interlaced)
        return self._pass
