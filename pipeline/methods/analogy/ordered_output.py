"""Emission of frames in order, while a thread finishes their paintings."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from pipeline.arrays import AnyArray
from pipeline.synthesis.images import Bytes


class OrderedOutput:
    """Emits the frames of a run in order, each as soon as its painting is finished. The end of the context emits the
    remaining frames.

    Args:
        frames: the frame numbers, ascending.
        shown: frame number -> number of the frame whose painting it shows.
        paint: makes the painting of a frame from its data; runs on a thread of its own.
        emit: receives each frame number and its painting, on the caller's thread.
    """

    def __init__(
        self, frames: range, shown: Callable[[int], int], paint: Callable[[int, AnyArray], Bytes],
        emit: Callable[[int, Bytes], None],
    ) -> None:  # fmt: skip
        self._waiting, self._shown, self._paint, self._emit = list(frames[::-1]), shown, paint, emit
        self._paintings: dict[int, Future[Bytes]] = {}
        self._thread = ThreadPoolExecutor(1, "impasto-colours")

    def add(self, index: int, rendered: AnyArray) -> None:
        """Paint frame `index` from its data on the thread, and emit the frames that are finished."""
        self._paintings[index] = self._thread.submit(self._paint, index, rendered)
        self.emit_finished()

    def emit_finished(self, wait: bool = False) -> None:
        """Emit the frames whose paintings are finished. `wait`: also those that are not, when they are."""
        while self._waiting:
            painting = self._paintings.get(self._shown(self._waiting[-1]))
            if painting is None or not (wait or painting.done()):
                return
            self._emit(self._waiting.pop(), painting.result())

    def __enter__(self) -> OrderedOutput:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        try:
            if kind is None:
                self.emit_finished(wait=True)
        finally:
            self._thread.shutdown(cancel_futures=True)
