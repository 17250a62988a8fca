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
from av.video.stream import VideoStream

from pipeline.video.container import decoder_of, open_container, video_stream
from pipeline.video.index import Index
from pipeline.video.media import Limits


class DamagedPass(Exception):
    """A decoding error in a pass that does not tolerate errors."""


class Pass:
    """A decoder that reads forwards from frame `start`, which is 0 or one of `index.keys`. The caller closes it.

    Args:
        errors: list to which decoding errors are appended; None = raise `DamagedPass` instead.
    """

    def __init__(self, path: Path, index: Index, start: int, limits: Limits, errors: list[str] | None) -> None:
        self._index = index
        self._errors = errors
        self._container = open_container(path, limits)
        # Error concealment may depend on the number of decoder threads; the output of undamaged files does not.
        self._stream = video_stream(self._container)
        self._decoder = decoder_of(self._stream, limits, threads=0 if errors is None else 1)
        self.position = start
        """Index of the next frame, if no frames are missing."""
        self._pictures = self._decode(self._packets(start))

    def close(self) -> None:
        self._pictures.close()
        self._container.close()

    def __iter__(self) -> Pass:
        return self

    def __next__(self) -> tuple[int, av.VideoFrame]:
        while True:
            picture = next(self._pictures)
            place = self._place(picture)
            if place is not None and place >= self.position:
                if place > self.position:
                    self._report(f"{place - self.position} pictures are missing before frame {place}")
                self.position = place + 1
                return place, picture

    @property
    def aspect(self) -> Fraction | None:
        """Sample aspect ratio (width / height of a stored pixel); None = unknown."""
        return self._stream.sample_aspect_ratio

    def _place(self, picture: av.VideoFrame) -> int | None:
        """Frame index of a picture: the rank of its time, or a running count if the index is not exact.

        None = its time is not in the index.
        """
        if not self._index.exact:
            return self.position
        at = int(np.searchsorted(self._index.pts, picture.pts)) if picture.pts is not None else len(self._index.pts)
        known = at < len(self._index.pts) and int(self._index.pts[at]) == picture.pts
        if not known:
            self._report(f"a picture at the unexpected time {picture.pts}")
        return at if known else None

    def _packets(self, start: int) -> Iterator[Packet[Any]]:
        if start:
            _seek(self._container, self._stream, int(self._index.pts[start]))
        try:
            yield from self._container.demux(self._stream)
        except (av.FFmpegError, OSError) as error:
            self._report(f"reading stopped: {error}")
            yield Packet()  # drains the decoder

    def _decode(self, packets: Iterator[Packet[Any]]) -> Generator[av.VideoFrame, None, None]:
        for packet in packets:
            last = packet.pts is None and not packet.size
            if not packet.size and not last:
                continue
            try:
                pictures = self._decoder.decode(None if last else packet)
            except (av.FFmpegError, ValueError) as error:
                self._report(f"packet at time {packet.pts}: {error}")
                continue
            for picture in pictures:
                if picture.is_corrupt:
                    self._report(f"picture at time {picture.pts} is damaged")
                yield picture

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
