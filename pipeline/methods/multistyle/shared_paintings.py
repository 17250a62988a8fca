"""Paintings that two runs of frames need: temporal accumulation averages the first frames of a run with the paintings
of the last frames of the run before.

Both runs are often painted at the same time, in two threads of one process. Whichever paints such a frame first leaves
its painting here, and the other one takes it instead of painting the frame again. Elsewhere it is painted twice, with
the same bytes.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import TypeAlias

from pipeline.methods.multistyle.analysis import StrokeAnalysis, same
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.strokes.accumulation import Painting

MOST_PAINTINGS = 12
"""Maximum number of paintings that wait; the oldest are dropped. Three runs of the style with most accumulated frames
need as many."""

Origin: TypeAlias = tuple[MultistyleParams, tuple[int, int], int, int, bool]
"""Parameters, size (width, height) in px, random seed, number of the frame's analysis, whether it has 16 bits."""


class SharedPaintings:
    """Paintings that one run has made and the other one has not used yet. Thread-safe."""

    def __init__(self, most: int = MOST_PAINTINGS) -> None:
        self._most = most
        self._lock = threading.Lock()
        self._waiting: OrderedDict[int, tuple[Origin, StrokeAnalysis, Painting]] = OrderedDict()
        self._given = 0

    def put(self, origin: Origin, analysis: StrokeAnalysis, painting: Painting) -> None:
        """Leave a painting for the other run."""
        with self._lock:
            self._given += 1
            self._waiting[self._given] = origin, analysis, painting
            while len(self._waiting) > self._most:
                self._waiting.popitem(last=False)

    def take(self, origin: Origin, analysis: StrokeAnalysis) -> Painting | None:
        """The painting of the same analysis, which is removed; None if there is none."""
        with self._lock:
            candidates = [(at, *row) for at, row in self._waiting.items() if row[0] == origin]
        for at, _, known, painting in candidates:
            if same([known], [analysis]):
                with self._lock:
                    self._waiting.pop(at, None)
                return painting
        return None


SHARED = SharedPaintings()
"""The paintings of this process."""
