"""Other work on hostile files that a child does: numbered images, and joining with the source's sound."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from pipeline.video.guard.nursery import Child, Died, begin
from pipeline.video.media import Limits
from pipeline.video.writer import Format

_BYTES_A_PIXEL = 8
"""RGBA of 16 bits."""


class GuardedImages(Mapping[int, "NDArray[Any]"]):
    """`NumberedImages`, each decoded by a child when it is asked for. Close it."""

    def __init__(self, path: Path, field: str, limits: Limits | None = None) -> None:
        limits = limits or Limits()
        self._task = {"path": str(Path(path).absolute()), "field": field, "limits": asdict(limits)}
        self._shared_bytes = _BYTES_A_PIXEL * limits.pixels
        self._child = self._begin()
        self._numbers = [int(number) for number in self._child.began[0]["numbers"]]

    def _begin(self) -> Child:
        return begin("images", self._task, self._shared_bytes)

    def __getitem__(self, number: int) -> NDArray[Any]:
        if number not in self._numbers:
            raise KeyError(number)
        try:
            answer, _ = self._child.ask({"number": int(number)})
        except Died:  # perhaps not the file's fault
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
    container: Format,
    sound: Path | None = None,
    progress: Callable[[float], None] = lambda done: None,
) -> None:
    """`join.join` in a child, since `sound` is what a user brought."""
    rows = [(start.numerator, start.denominator, str(path.absolute())) for start, path in segments]
    task = {"segments": rows, "out": str(out.absolute()), "format": container}
    task["sound"] = "" if sound is None else str(sound.absolute())
    child = begin("join", task, 1, told=lambda news: progress(float(news["news"])))
    child.close()
