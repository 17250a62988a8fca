"""Runs a method's plan over a few frames in memory, for previews; stops when the client leaves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager

from pipeline.frames import Frame
from pipeline.methods.base import AnyParams, Method
from pipeline.methods.local import FrameSource, Input, LocalContext, iterate_plan

Check = Callable[[], None]
"""Raises Overtaken or Cancelled once the answer is no longer needed."""


class PreviewTaskContext(LocalContext[AnyParams]):
    """A task context in memory that calls `check` whenever the method measures time or reports progress."""

    def __init__(
        self, check: Check, params: AnyParams, video: Sequence[Frame] | FrameSource, inputs: Mapping[str, Input],
        seed: int, artefacts: frozenset[str] = frozenset(),
    ) -> None:  # fmt: skip
        super().__init__(params, video, inputs, seed, artefacts)
        self._check = check

    def clock(self, stage: str) -> AbstractContextManager[None]:
        self._check()
        return super().clock(stage)

    def progress(self, done: float) -> None:
        self._check()


def painted(
    chosen: Method, params: AnyParams, seed: int, video: Sequence[Frame], inputs: Mapping[str, Input], check: Check
) -> Iterator[tuple[int, Frame]]:
    """(index in `video`, frame) as the plan emits them.

    Args:
        inputs: as for `pipeline.methods.local.LocalContext`.
    """
    context = PreviewTaskContext(check, params, video, inputs, seed)
    for _ in iterate_plan(chosen, context):
        for index in sorted(context.emitted):
            yield index, context.emitted.pop(index)
