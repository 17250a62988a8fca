"""`GuardedReader`: the frames of an untrusted video, from a decoder process."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.frames import Plane
from pipeline.video.guard.decoder_process import DecoderDied, DecoderProcess, start_decoder
from pipeline.video.guard.wire import Message
from pipeline.video.index import FrameReader, Index
from pipeline.video.media import Limits, Note, SourceOptions
from pipeline.video.numbering import numbers_of_runs

FOREVER = 1 << 62
"""End of a read of all frames."""
_THUMBNAILS = 16
"""Thumbnails in one answer."""


class GuardedReader(FrameReader):
    """`VideoReader` for untrusted files: the decoder runs in a process of its own, which can be killed.

    It costs a fork at the start and a copy of each frame. Not thread-safe; close it.

    Args:
        options: how a video container is read.

    Raises: as `VideoReader`; also UnreadableMedia if the decoder hangs, crashes or needs too much memory.
    """

    def __init__(self, path: Path, limits: Limits | None = None, options: SourceOptions | None = None) -> None:
        limits = limits or Limits()
        self._task = {"path": str(Path(path).absolute()), "limits": asdict(limits)}
        options = options or SourceOptions()
        self._task["options"] = options.as_json()
        self._shared_bytes = 3 * limits.pixels * (4 if options.deep else 1)
        self._child = self._begin()
        about, data = self._child.began
        width, height = about["size"]
        self.size: tuple[int, int] = (int(width), int(height))
        """(width, height) of every frame, px."""
        self.rotation_deg = int(about["rotation_deg"])
        self.pixel_format = str(about["pixel_format"])
        self.has_alpha = bool(about["alpha"])
        """Whether pictures have opacity."""
        self._index = _index(about, data)
        self.errors: list[str] = []
        """Decoding errors so far."""
        self.unreadable: list[int] = []
        """Indices of the frames read so far that were incomplete or replaced by the frame before them."""
        self.position: int | None = about["position"]
        """The first frame that can be read without a seek, or None."""

    def close(self) -> None:
        self._child.close()

    @property
    def index(self) -> Index:
        return self._index

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes on what was chosen, corrected or assumed when the file was opened."""
        return self._index.notes

    def read(self, start: int = 0, stop: int | None = None) -> Iterator[AnyArray]:
        """Frames [start, stop) in order; fewer if the video ends earlier. Start another read only after this one."""
        if start < 0 or (stop is not None and stop < start):
            raise ValueError(f"no frames [{start}, {stop})")
        return self._frames(start, stop if stop is not None else FOREVER)

    def read_thumbnails(self, start: int = 0, stop: int | None = None) -> Iterator[Plane]:
        """Thumbnails (`pipeline.perception.cuts.thumbnail`) of the frames [start, stop), computed by the decoder's
        process, so that no frame is copied to this one. Otherwise as `read`."""
        end, more = stop if stop is not None else FOREVER, {"thumbnails": _THUMBNAILS}
        question: Message = {"start": start, "stop": end}
        while True:
            answer = self._asked(question | more, {"start": start, "stop": end} | more)
            self._note(answer)
            if answer.get("end"):
                return
            found = np.asarray(self._child.array(tuple(answer["shape"]), "f4"), np.float32)
            start, question = start + len(found), {}
            yield from found

    def _begin(self) -> DecoderProcess:
        return start_decoder("video", self._task, self._shared_bytes)

    def _frames(self, start: int, stop: int) -> Iterator[AnyArray]:
        question: Message = {"start": start, "stop": stop}
        while True:
            answer = self._asked(question, {"start": start, "stop": stop})
            start, question = start + 1, {}
            self._note(answer)
            if answer.get("end"):
                return
            yield self._child.array(tuple(answer["shape"]), str(answer["dtype"]))

    def _note(self, answer: Message) -> None:
        self.position = answer["position"]
        self.errors += answer["errors"]
        self.unreadable += answer["unreadable"]

    def _asked(self, question: Message, again: Message) -> Message:
        """The answer to `question`. If the process has died, a new one gets `again` once."""
        try:
            return self._child.ask(question)[0]
        except DecoderDied:
            self._child = self._begin()
            return self._child.ask(again)[0]


def _index(about: Message, data: bytes) -> Index:
    """The frame index, from the bytes of the answer."""
    times = np.frombuffer(data, "<i8").astype(np.int64)
    count = int(about["frames"])
    above, below = about["tick"]
    tick, incomplete = Fraction(above, below), frozenset(about["incomplete"])
    missing = tuple((frame, missed) for frame, missed in about["missing"])
    notes = tuple(Note(str(code), str(message)) for code, message in about["notes"])
    numbers = tuple(numbers_of_runs(about["numbers"]))
    end, exact = int(about["end"]), bool(about["exact"])
    return Index(times[:count], times[count:], end, tick, exact, missing, incomplete, notes=notes, numbers=numbers)
