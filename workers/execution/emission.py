"""Checks and encodes the frames that a task emits as one segment, and makes a preview picture."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import ImpastoError
from pipeline.methods.tasks import Clock, no_clock
from pipeline.video.contact_sheet import fit
from pipeline.video.depth import as_uint16, check_picture, with_opacity
from pipeline.video.index import Index
from pipeline.video.stills import as_shown, encode_jpeg
from pipeline.video.writer import SegmentSpec, SegmentWriter, segment_writer

_PREVIEW_PX = 960
_MOST_WAITING = 3
"""Maximum number of frames that wait for the encoder, to bound the memory; `take` then waits."""
_THREAD_PX = 640 * 480
"""Frames of at least this size, px, are encoded in a separate thread. At 352x288 a thread would gain nothing."""


class EmitError(ImpastoError):
    """A method emitted other frames than its task announced: an error of the method, not of the user."""

    code = "bad-emission"


@dataclass(frozen=True)
class EmissionSource:
    """What an emission uses besides frames: a clock, and the opacity of each frame, gray; None: all are opaque."""

    clock: Clock = no_clock
    matte: Iterator[AnyArray] | None = None


class Emission:
    """Takes the frames [start, stop) of one task, each once and in order, and writes the segment at `path`.

    Frames are uint8, uint16 or float32 (h, w, 3); (h, w, 4) if the specification has opacity and the source gives none.
    Large frames are encoded on a thread of their own, while the method works on the next ones.

    Args:
        source: the clock of the encoding (stage "encode"), and the opacity of the frames.
    """

    def __init__(
        self,
        path: Path,
        spec: SegmentSpec,
        index: Index,
        span: tuple[int, int],
        source: EmissionSource = EmissionSource(),
    ) -> None:
        self._path = path
        self._spec = spec
        self._index = index
        self._start, self._stop = span
        self._clock, self._matte = source.clock, source.matte
        self._shown: AnyArray | None = None
        self._channels = 4 if spec.alpha and source.matte is None else 3
        self._keeps_float = spec.profile.is_float or bool(spec.colour)
        self._writer: SegmentWriter | None = None
        large = spec.size[0] * spec.size[1] >= _THREAD_PX
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="encoder") if large else None
        self._waiting: deque[Future[None]] = deque()
        self.next = self._start
        """Index of the next frame; at the end, one past the last frame."""

    def take(self, index: int, frame: AnyArray) -> None:
        """Encode frame `index`; keeps a copy of the frame.

        Raises: EmitError (out of order or range), BadFrame (not a frame of this video). Errors of the encoder may be
        raised with a later frame or in `finish`.
        """
        if index != self.next or index >= self._stop:
            raise EmitError(
                f"Frame {self.next} of [{self._start}, {self._stop}) must be emitted next.", field="emit", value=index
            )
        kept = self._checked(frame)
        if self._thread is None:
            self._encode(index, kept)
        else:
            self._wait_until(_MOST_WAITING - 1)
            self._waiting.append(self._thread.submit(self._encode, index, kept))
        if index in (self._start, self._stop - 1):
            self._shown = kept
        self.next = index + 1

    def _checked(self, frame: AnyArray) -> AnyArray:
        """A copy of the frame, as uint16 if the encoder has no use for floating point, to save half of the memory."""
        found = check_picture(frame, self._spec.size, self._channels)
        return as_uint16(found) if found.dtype == np.float32 and not self._keeps_float else found.copy()

    def _encode(self, index: int, frame: AnyArray) -> None:
        with self._clock("encode"):
            self._writer = self._writer or segment_writer(self._path, self._spec)
            times = self._index.time(index), self._index.time(index + 1)
            self._writer.write(self._index.number(index), self._with_opacity(frame), *times)

    def _with_opacity(self, frame: AnyArray) -> AnyArray:
        """The frame as painted, with the opacity of the source; opaque where the source has ended."""
        if self._matte is None:
            return frame
        height, width = frame.shape[:2]
        matte = next(self._matte, None)
        opacity = np.full((height, width), 255, np.uint8) if matte is None else matte[:height, :width, 0]
        return with_opacity(frame, opacity)

    def _wait_until(self, most: int) -> None:
        """Wait until at most this many frames wait for the encoder. Raises its errors."""
        while len(self._waiting) > most:
            self._waiting.popleft().result()

    def finish(self, ended_at: int | None) -> Path | None:
        """The finished segment, or None if there was no frame.

        Args:
            ended_at: the frame count of the input video, if the task read up to its end.

        Raises: EmitError if frames are missing although the video has them.
        """
        if self.next < self._stop and (ended_at is None or self.next < ended_at):
            raise EmitError(
                f"The task announced frames [{self._start}, {self._stop}).", field="emit", value=f"ended at {self.next}"
            )
        self._wait_until(0)
        if self._writer is None:
            return None
        with self._clock("encode"):
            self._writer.finish()
            self._writer.close()
        return self._path

    def close(self) -> None:
        if self._thread:
            self._thread.shutdown(cancel_futures=True)
        if self._writer:
            self._writer.close()

    def preview(self) -> bytes | None:
        """The last frame (the first, if the task ended before), scaled to fit 960 px; JPEG."""
        return encode_jpeg(fit(as_shown(self._shown), _PREVIEW_PX)) if self._shown is not None else None
