"""A cache of propagators of painted keys: one for each combination of shot, method, parameters and size."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import overload

from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.base import KeyPropagator
from workers.previews.context import PreviewContext
from workers.previews.model import LayerSources
from workers.previews.warm import WarmFrames

PROXY_SIDE_PX = 480
"""Longest side of the frames that a propagator works on."""
_EMPTY_BYTES = 1 << 10


@dataclass(frozen=True)
class _WarmPropagator:
    """A cached propagator; None if the method has none."""

    propagator: KeyPropagator | None
    turn: threading.Lock = field(default_factory=threading.Lock)

    @property
    def size_bytes(self) -> int:
        return _EMPTY_BYTES + (self.propagator.size_bytes if self.propagator else 0)


class ProxyFrames(Sequence[Frame]):
    """Frames of a video scaled to fit `side_px`, each decoded on access."""

    def __init__(self, frames: WarmFrames, video: str, side_px: int) -> None:
        self._frames, self._video, self._side_px = frames, video, side_px

    def __len__(self) -> int:
        return self._frames.info(self._video).frames

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        return self._frames.frames(self._video, index, index + 1, self._side_px)[0]


@contextmanager
def propagator_of(context: PreviewContext, layer: LayerSources, side_px: int) -> Iterator[KeyPropagator | None]:
    """The layer's propagator, for exclusive use until the block ends; None if the method has none.

    Raises: the errors of the context's check, while another call uses the propagator.
    """
    name = _name(context, layer, side_px)
    warm = context.cache.get(name, lambda: _made(context, layer, side_px), lambda made: made.size_bytes)
    while not warm.turn.acquire(timeout=0.02):
        context.check()
    try:
        yield warm.propagator
    finally:
        context.cache.put(name, warm, warm.size_bytes)
        warm.turn.release()


def forget_propagator(context: PreviewContext, layer: LayerSources, side_px: int) -> None:
    """Drop the layer's propagator: the next call makes a new one."""
    context.cache.drop(_name(context, layer, side_px))


def _made(context: PreviewContext, layer: LayerSources, side_px: int) -> _WarmPropagator:
    chosen = method(layer.method)
    frames = ProxyFrames(context.frames, layer.video, side_px)
    return _WarmPropagator(chosen.propagator(parse_params(chosen, layer.params), frames, layer.seed))


def _name(context: PreviewContext, layer: LayerSources, side_px: int) -> Hashable:
    params = repr(sorted(layer.params.items()))
    return "propagator", context.query.project, layer.id, layer.video, layer.method, params, layer.seed, side_px
