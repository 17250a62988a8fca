"""Start-up paid before the clocks run: kernels compiled and loaded, so that the first frame costs what others cost."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from pipeline.errors import ImpastoError
from pipeline.frames import Frame
from pipeline.methods.base import Method, Params

SIZE = (96, 64)
"""(width, height) of the practice frames, px."""
FRAMES = 4


def warm_up(chosen: Method, params: Params) -> None:
    """Let a causal method practise on a few small frames with the parameters that it will be given.

    What is compiled and loaded then stays in this process, for the workers of a local farm too. A method that is not
    causal, or that finds practice frames too small for its parameters, starts cold.
    """
    with contextlib.suppress(ImpastoError):
        if (session := chosen.stream(params, SIZE, 0, {})) is not None:
            for frame in _practice():
                session.step(frame)


def _practice() -> Iterator[Frame]:
    """A bright square that moves over a ramp: edges, motion and more than one region."""
    width, height = SIZE
    for index in range(FRAMES):
        frame = np.empty((height, width, 3), np.uint8)
        frame[...] = np.linspace(20, 120, width, dtype=np.uint8)[:, None]
        frame[16:48, 20 + 2 * index : 52 + 2 * index] = (230, 180, 60)
        yield frame
