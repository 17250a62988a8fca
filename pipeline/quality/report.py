"""The quality report: measures of sampled pairs of frames, and what they say of the whole video."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from pipeline.frames import Frame
from pipeline.quality.coherence import PairMeasure, detail, flicker, measure_pair, structure
from pipeline.quality.faces import FaceCounter
from pipeline.quality.sharpness import edge_widths

WORST = 3
"""How many of the pairs with the most flicker a report names."""


def sampled_pairs(frames: int, count: int) -> list[int]:
    """Second frames of at most `count` pairs (t - 1, t), evenly spread over a video of `frames` frames."""
    pairs = max(0, frames - 1)
    number = min(pairs, count)
    return sorted({1 + (2 * i + 1) * pairs // (2 * number) for i in range(number)})


@dataclass
class _Sample:
    frame: int
    pair: PairMeasure
    detail: float
    source_detail: float
    structure: float


@dataclass
class QualityReport:
    """Collects pairs of frames, then states the figures. Not thread-safe.

    Flicker of the whole is the root of the summed errors' quotient, as if all sampled pairs were one; detail is a
    quotient of means; edge widths and faces are those of the second frame of every pair.
    """

    _samples: list[_Sample] = field(default_factory=list)
    _widths: list[NDArray[np.float64]] = field(default_factory=list)
    _faces: FaceCounter = field(default_factory=FaceCounter)
    _found: int = 0
    _kept: int = 0

    def add(self, frame: int, source: tuple[Frame, Frame], painted: tuple[Frame, Frame]) -> None:
        """Measure frames `frame` - 1 and `frame`; all four pictures have one size. Raises: BadFrame."""
        pair = measure_pair(source, painted)
        self._samples.append(
            _Sample(frame, pair, detail(painted[1]), detail(source[1]), structure(source[1], painted[1]))
        )
        self._widths.append(edge_widths(painted[1]))
        faces = self._faces.count(source[1], painted[1])
        self._found += faces.found
        self._kept += faces.kept

    def summary(self) -> dict[str, JsonValue]:
        """The figures of the whole, rounded: flicker, detail, structure, edge widths (px), faces kept (share).

        A figure is null if nothing was measured: no pair, no edge, no face in the source.
        """
        if not self._samples:
            return {"pairs": 0, "flicker": None, "detail": None, "structure": None}
        widths = np.concatenate(self._widths)
        painted_error = sum(s.pair.painted_error for s in self._samples)
        source_error = sum(s.pair.source_error for s in self._samples)
        visible_px = max(1, sum(s.pair.visible_px for s in self._samples))
        return {
            "pairs": len(self._samples),
            "flicker": _rounded(flicker(painted_error, source_error)),
            "warp_error": _rounded(painted_error / visible_px, 8),
            "source_error": _rounded(source_error / visible_px, 8),
            "detail": _rounded(
                _quotient(sum(s.detail for s in self._samples), sum(s.source_detail for s in self._samples))
            ),
            "structure": _rounded(float(np.mean([s.structure for s in self._samples]))),
            "edge_width_px": _rounded(float(np.median(widths))) if len(widths) else None,
            "edge_width_p90_px": _rounded(float(np.quantile(widths, 0.9))) if len(widths) else None,
            "faces": self._found,
            "faces_kept": _rounded(self._kept / self._found) if self._found else None,
        }

    def as_json(self) -> dict[str, JsonValue]:
        """The summary, a row for each pair in the order of time, and the frames with the most flicker."""
        rows: list[JsonValue] = [
            {
                "frame": s.frame,
                "flicker": _rounded(s.pair.flicker),
                "detail": _rounded(_quotient(s.detail, s.source_detail)),
                "structure": _rounded(s.structure),
            }
            for s in sorted(self._samples, key=lambda sample: sample.frame)
        ]
        worst = sorted(self._samples, key=lambda s: (-s.pair.painted_error / max(s.pair.visible_px, 1), s.frame))
        return {**self.summary(), "samples": rows, "worst": [s.frame for s in worst[:WORST]]}


def report_of(pairs: Iterable[tuple[int, tuple[Frame, Frame], tuple[Frame, Frame]]]) -> QualityReport:
    """A report of (frame, source frames, painted frames)."""
    report = QualityReport()
    for frame, source, painted in pairs:
        report.add(frame, source, painted)
    return report


def _quotient(value: float, reference: float) -> float:
    return value / max(reference, 1e-12)


def _rounded(value: float, digits: int = 4) -> float:
    return round(value, digits)
