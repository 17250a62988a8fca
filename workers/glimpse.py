"""One frame by a method that needs the whole film: its plan over that frame alone, in memory.

What holds still over time cannot be seen in one frame, so its time-wise part is switched off (`temporal=off`, where
the method has it). Everything is scaled alike: frame, paintings and guides, so that strokes are as large in the
picture as they will be in the film.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods.base import Arrays, Brief, Method, Note, VideoInfo


def glimpse(chosen: Method, params: Any, seed: int, pictures: Mapping[str, Frame]) -> Frame:
    """A frame as the method would paint it on its own.

    Args:
        params: the method's Params.
        pictures: `video`, uint8 (height, width, 3), and those of the method's other inputs that are pictures.
    """
    if getattr(params, "temporal", None) == "on":
        params = params.model_copy(update={"temporal": "off"})
    bench = _Bench(params, seed, pictures)
    notes: dict[str, dict[str, Note]] = {}
    for step in chosen.steps:
        bench.step = step.name
        tasks = step.plan(Brief(params, seed, bench.video, frozenset(pictures), notes))
        notes[step.name] = {task.key: step.run(task, bench) for task in tasks}
    return bench.painted[0]


class _Bench:
    """`pipeline.methods.base.Bench` over pictures: nothing outlives it."""

    def __init__(self, params: Any, seed: int, pictures: Mapping[str, Frame]) -> None:
        self.params, self.seed = params, seed
        height, width = pictures["video"].shape[:2]
        self.size = (width, height)
        self.video = VideoInfo(width, height, 1, 25.0, 0.04)
        self.step = ""
        self.painted: dict[int, Frame] = {}
        self._pictures = pictures
        self._saved: dict[tuple[str, str], dict[str, NDArray[Any]]] = {}

    def frames(self, name: str = "video", start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        return iter([self.image(name)][start:stop])

    def has(self, name: str) -> bool:
        return name in self._pictures

    def image(self, name: str) -> Frame:
        if name not in self._pictures:
            raise BadParameter(f"The input {name!r} is needed for this preview.", field=f"inputs.{name}")
        return self._pictures[name]

    def json(self, name: str) -> Any:
        return self.image(name)

    def images(self, name: str) -> Mapping[int, NDArray[Any]]:
        return {0: self.image(name)}

    def entries(self, name: str) -> Mapping[str, bytes]:
        return {}

    def show(self, frame: Frame) -> None:
        pass

    def save(self, name: str, arrays: Arrays) -> None:
        self._saved[self.step, name] = dict(arrays)

    def load(self, step: str, name: str) -> dict[str, NDArray[Any]]:
        return dict(self._saved[step, name])

    def save_file(self, name: str, data: bytes, media_type: str) -> None:
        pass

    def wants(self, artefact: str) -> bool:
        return False

    def emit(self, index: int, frame: Frame) -> None:
        self.painted[index] = frame

    def clock(self, stage: str) -> AbstractContextManager[None]:
        return nullcontext()

    def progress(self, done: float) -> None:
        pass
