"""A method's plan run over a few frames in memory, for previews: stopped as soon as nobody waits for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

from pipeline.frames import Frame
from pipeline.methods.base import Method
from pipeline.methods.local import LocalContext, iterate_plan

Check = Callable[[], None]
"""Raises Overtaken or Cancelled once nobody waits for the answer any more."""


class PreviewTaskContext(LocalContext[Any]):
    """A task context in memory that asks `check` whenever the method measures time or reports progress."""

    def __init__(self, check: Check, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._check = check

    def clock(self, stage: str) -> AbstractContextManager[None]:
        self._check()
        return super().clock(stage)

    def progress(self, done: float) -> None:
        self._check()


def painted(
    chosen: Method, params: Any, seed: int, video: Sequence[Frame], inputs: Mapping[str, Any], check: Check
) -> Iterator[tuple[int, Frame]]:
    """(index in `video`, frame) as the plan emits them.

    Args:
        inputs: as for `pipeline.methods.local.LocalContext`.
    """
    context = PreviewTaskContext(check, params, video, inputs, seed)
    for _ in iterate_plan(chosen, context):
        for index in sorted(context.emitted):
            yield index, context.emitted.pop(index)
