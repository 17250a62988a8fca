"""One decoder pass over a container, from a keyframe on; yields (frame index, picture) in display order."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import InputContainer
from av.packet import Packet
from av.video.frame import PictureType
from av.video.stream import VideoStream

from pipeline.video.aperture import crop_of
from pipeline.video.container import decoder_of, open_container, video_stream
from pipeline.video.fields import Numbered, deinterlaced
from pipeline.video.index import Index
from pipeline.video.media import Limits, SourceOptions
from pipeline.video.packets import decoded


class DamagedPass(Exception):
    """A decoding error in a pass that does not tolerate errors."""


class NotAKey(Exception):
    """The picture at which a seek ended depends on earlier ones, whatever the container says."""


class Pass:
    """A decoder that reads forwards from frame `start`, which is 0 or one of `index.keys`. The caller closes it.

    Args:
        errors: list to which decoding errors are appended; None = raise `DamagedPass` instead.
        leads: whether the first frame, if it is interlaced, only serves as the neighbour of the second one; else
            `fields.EarlierNeeded` is raised, unless `start` is 0.
    """

    def __init__(
        self, path: Path, index: Index, start: int, limits: Limits, options: SourceOptions,
        errors: list[str] | None, leads: bool = False,
    ) -> None:  # fmt: skip
        self._index, self._start = index, start
        self._errors = errors
        self._container = open_container(path, limits)
        # Error concealment may depend on the number of decoder threads; the output of undamaged files does not.
        self._stream = video_stream(self._container, options.picture)
        self.crop = crop_of(self._container, self._stream)
        """Borders of each picture that the container says not to show."""
        self._decoder = decoder_of(self._stream, limits, threads=0 if errors is None else 1)
        self.failed: set[int] = set()
        """Frames whose packets could not be decoded."""
        self.position = start
        """Index of the next frame, if no frames are missing."""
        self._placed = self._place_all()
        self._pictures = deinterlaced(self._placed, options.fields, begins=start == 0, leads=leads)

    def close(self) -> None:
        self._placed.close()
        self._container.close()

    def __iter__(self) -> Pass:
        return self

    def __next__(self) -> Numbered:
        place, picture = next(self._pictures)
        self.position = place + 1
        return place, picture

    @property
    def aspect(self) -> Fraction | None:
        """Sample aspect ratio (width / height of a stored pixel); None = unknown."""
        return self._stream.sample_aspect_ratio

    @property
    def has_fields(self) -> bool:
        """Whether the container or the codec's header says that pictures are interlaced."""
        return self._decoder.field_order > 1

    def _place_all(self) -> Generator[Numbered, None, None]:
        at = self._next = self._start
        for picture in decoded(self._packets(), self._decoder, self._fail):
            place = self._place(picture, at)
            if place is None or place < at:
                continue
            if place > at and self._errors is None:
                raise DamagedPass(f"{place - at} packets before frame {place} contain no picture")
            if place == self._start > 0 and not picture.key_frame and picture.pict_type != PictureType.I:
                raise NotAKey
            if picture.is_corrupt:
                self._report(f"picture at time {picture.pts} is damaged")
            at = self._next = self._index.coded_from(place + 1)
            yield place, picture

    def _place(self, picture: av.VideoFrame, at: int) -> int | None:
        """Frame index of a picture that is shown at or after frame `at`: that of its stored time, or a running count if
        the index has none. None = its time is not in the index."""
        stored = self._index.stored
        if stored is None:
            return at
        place = self._frame_of(picture.pts, at)
        if place is None:
            self._report(f"a picture at the unexpected time {picture.pts}")
        return place

    def _frame_of(self, pts: int | None, at: int) -> int | None:
        """The first frame at or after `at` with this stored time; if there is none, an earlier one."""
        stored = self._index.stored
        if stored is None or pts is None:
            return None
        if at < len(stored) and stored[at] == pts:
            return at
        found = np.flatnonzero(stored == pts)
        return None if not len(found) else int(found[min(int(np.searchsorted(found, at)), len(found) - 1)])

    def _packets(self) -> Iterator[Packet[Any]]:
        if self._start and self._index.stored is not None:
            _seek(self._container, self._stream, int(self._index.stored[self._start]))
        try:
            yield from self._container.demux(self._stream)
        except (av.FFmpegError, OSError) as error:
            self._report(f"reading stopped: {error}")
            yield Packet()  # drains the decoder

    def _fail(self, packet: Packet[Any], why: str) -> None:
        self._report(f"packet at time {packet.pts}: {why}")
        place = self._frame_of(packet.pts, self._next)
        self.failed.add(self._next if place is None else place)

    def _report(self, text: str) -> None:
        if self._errors is None:
            raise DamagedPass(text)
        if len(self._errors) < 100:
            self._errors.append(text)


def _seek(container: InputContainer, stream: VideoStream, pts: int) -> None:
    try:
        container.seek(pts, stream=stream, backward=True, any_frame=False)
    except (av.FFmpegError, OSError) as error:
        raise DamagedPass(f"cannot seek: {error}") from error
