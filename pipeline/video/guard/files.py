"""Untrusted numbered images, and joining with the sound of an untrusted source, in decoder processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path

from pipeline.arrays import AnyArray
from pipeline.video.guard.decoder_process import DecoderDied, DecoderProcess, start_decoder
from pipeline.video.guard.wire import Message
from pipeline.video.media import Limits, Note, SourceOptions

_BYTES_A_PIXEL = 8
"""RGBA with 16 bits a channel."""


class GuardedImages(Mapping[int, AnyArray]):
    """`NumberedImages` whose images are decoded by a decoder process, on access. Close it."""

    def __init__(self, path: Path, field: str, limits: Limits | None = None) -> None:
        limits = limits or Limits()
        self._task = {"path": str(Path(path).absolute()), "field": field, "limits": asdict(limits)}
        self._shared_bytes = _BYTES_A_PIXEL * limits.pixels
        self._child = self._begin()
        self._numbers = [int(number) for number in self._child.began[0]["numbers"]]
        self.is_single = bool(self._child.began[0]["single"])
        """Whether this is one image without a number."""

    def _begin(self) -> DecoderProcess:
        return start_decoder("images", self._task, self._shared_bytes)

    def __getitem__(self, number: int) -> AnyArray:
        if number not in self._numbers:
            raise KeyError(number)
        try:
            answer, _ = self._child.ask({"number": int(number)})
        except DecoderDied:  # possibly not the file's fault: try once more
            self._child = self._begin()
            answer, _ = self._child.ask({"number": int(number)})
        return self._child.array(tuple(answer["shape"]), str(answer["dtype"]))

    def __iter__(self) -> Iterator[int]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def close(self) -> None:
        self._child.close()


def guarded_join(
    segments: Sequence[tuple[Fraction, Path]],
    out: Path,
    container: str,
    sound: Path | None = None,
    progress: Callable[[float], None] = lambda done: None,
    end_s: Fraction | None = None,
    options: SourceOptions | None = None,
    quality: int = 20,
) -> tuple[Note, ...]:
    """`join.join` in a decoder process, because `sound` is a user's file."""
    rows = [(start.numerator, start.denominator, str(path.absolute())) for start, path in segments]
    task: Message = {"segments": rows, "out": str(out.absolute()), "format": container, "quality": quality}
    task["sound"] = "" if sound is None else str(sound.absolute())
    task["end"] = None if end_s is None else (end_s.numerator, end_s.denominator)
    task["options"] = (options or SourceOptions()).as_json()
    child = start_decoder("join", task, 1, on_progress=lambda message: progress(float(message["progress"])))
    child.close()
    return tuple(Note(str(code), str(message)) for code, message in child.began[0]["notes"])
