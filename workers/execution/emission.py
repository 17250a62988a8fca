"""Frames that a task emits: checked, encoded as one segment, and a picture of how far it has come."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import ImpastoError
from pipeline.frames import Frame, check_frame
from pipeline.video.contact import fit
from pipeline.video.index import Index
from pipeline.video.stills import encode_jpeg
from pipeline.video.writer import SegmentSpec, SegmentWriter, segment_writer

_PREVIEW_PX = 960


class EmitError(ImpastoError):
    """A method emitted other frames than its task announced. An error of the method, not of the user."""

    code = "bad-emission"


class Emission:
    """Takes the frames [start, stop) of one task, each once and in order, and writes the segment at `path`."""

    def __init__(self, path: Path, spec: SegmentSpec, index: Index, span: tuple[int, int]) -> None:
        self._path = path
        self._spec = spec
        self._index = index
        self._start, self._stop = span
        self._shown: Frame | None = None
        self._writer: SegmentWriter | None = None
        self.next = self._start
        """Index of the frame that must come next; in the end, one past the last that came."""

    def take(self, index: int, frame: Frame) -> None:
        """Encode frame `index`. Raises EmitError (out of order or range), BadFrame (not a frame of this video)."""
        if index != self.next or index >= self._stop:
            raise EmitError(
                f"Frame {self.next} of [{self._start}, {self._stop}) is to be emitted next.", field="emit", value=index
            )
        self._writer = self._writer or segment_writer(self._path, self._spec)
        self._writer.write(index, check_frame(frame), self._index.time(index), self._index.time(index + 1))
        if index in (self._start, self._stop - 1):
            self._shown = frame.copy()
        self.next = index + 1

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
        if self._writer is None:
            return None
        self._writer.finish()
        self._writer.close()
        return self._path

    def close(self) -> None:
        if self._writer:
            self._writer.close()

    def preview(self) -> bytes | None:
        """The last frame (the first, if the task ended before), scaled to fit 960 px; JPEG."""
        return encode_jpeg(fit(self._shown, _PREVIEW_PX)) if self._shown is not None else None
