"""The quality report: measures of sampled pairs of frames, and estimates for the whole video."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from pipeline.frames import Frame
from pipeline.quality.coherence import PairMeasure, detail, flicker, measure_pair, structure
from pipeline.quality.faces import FaceCounter
from pipeline.quality.palette import PictureColours
from pipeline.quality.sampling import FACES_EVERY, tile
from pipeline.quality.sharpness import edge_widths

FramePair = tuple[Frame, Frame]
"""Frames t - 1 and t, uint8 (height, width, 3)."""
WORST = 3
"""Number of the pairs with the most flicker that a report names."""


@dataclass
class _Sample:
    frame: int
    pair: PairMeasure
    detail: float
    source_detail: float
    structure: float
    palette: float | None
    alone_error: float | None
    """Error of the same pair, painted frame by frame."""


@dataclass
class QualityReport:
    """Collects pairs of frames, then states the figures. Not thread-safe.

    Flicker of the whole is the root of the summed errors' quotient, as if all sampled pairs were one; detail is a
    quotient of means; edge widths and faces are those of the second frame of every pair.

    Attributes:
        sampled: measure flicker and edge widths in one part of each pair, at full resolution, and faces in one pair of
            six: about a sixth of the processor time at 1280x720.
        search_faces: search faces at all.
        palette: colours that the painting was to take on.
    """

    sampled: bool = False
    search_faces: bool = True
    palette: PictureColours | None = None
    _samples: list[_Sample] = field(default_factory=list)
    _widths: list[NDArray[np.float64]] = field(default_factory=list)
    _faces: FaceCounter = field(default_factory=FaceCounter)
    _found: int = 0
    _kept: int = 0

    def add(
        self, frame: int, source: FramePair, painted: FramePair, alone: FramePair | None = None
    ) -> None:  # fmt: skip
        """Measure frames `frame` - 1 and `frame`; all pictures have one size.

        Args:
            alone: the same frames, each painted by the method without the others.

        Raises: BadFrame.
        """
        ordinal = len(self._samples)
        before, after = self._parts(source, ordinal), self._parts(painted, ordinal)
        pair = measure_pair(before, after)
        alone_error = None if alone is None else measure_pair(before, self._parts(alone, ordinal)).painted_error
        self._samples.append(
            _Sample(
                frame, pair, detail(painted[1]), detail(source[1]), structure(source[1], painted[1]),
                None if self.palette is None else self.palette.distance(painted[1]), alone_error,
            )
        )  # fmt: skip
        self._widths.append(edge_widths(after[1]))
        if not self.search_faces or (self.sampled and ordinal % FACES_EVERY):
            return
        faces = self._faces.count(source[1], painted[1])
        self._found += faces.found
        self._kept += faces.kept

    def _parts(self, pair: FramePair, ordinal: int) -> FramePair:
        return (tile(pair[0], ordinal), tile(pair[1], ordinal)) if self.sampled else pair

    def summary(self) -> dict[str, JsonValue]:
        """The figures of the whole, rounded: flicker, detail, structure, edge widths (px), faces kept (share), and
        where they apply palette distance and the comparison with frames painted alone.

        A figure is null if nothing was measured: no pair, no edge, no face in the source; so is the number of faces if
        none were searched.
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
            "faces": self._found if self.search_faces else None,
            "faces_kept": _rounded(self._kept / self._found) if self._found else None,
            **self._palette_distance(),
            **self._against_frame_by_frame(),
        }

    def _palette_distance(self) -> dict[str, JsonValue]:
        distances = [s.palette for s in self._samples if s.palette is not None]
        return {"palette_distance": _rounded(float(np.mean(distances)), 2)} if distances else {}

    def _against_frame_by_frame(self) -> dict[str, JsonValue]:
        """Figures of the pairs that were also painted frame by frame: their number, the flicker of that painting, and
        the flicker of the result divided by it."""
        both = [(s.pair, s.alone_error) for s in self._samples if s.alone_error is not None]
        if not both:
            return {}
        alone_error = sum(error for _, error in both)
        return {
            "alone_pairs": len(both),
            "alone_flicker": _rounded(flicker(alone_error, sum(pair.source_error for pair, _ in both))),
            "flicker_of_alone": _rounded(flicker(sum(pair.painted_error for pair, _ in both), alone_error)),
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


def report_of(pairs: Iterable[tuple[int, FramePair, FramePair]]) -> QualityReport:
    """A report of (frame, source frames, painted frames)."""
    report = QualityReport()
    for frame, source, painted in pairs:
        report.add(frame, source, painted)
    return report


def _quotient(value: float, reference: float) -> float:
    return value / max(reference, 1e-12)


def _rounded(value: float, digits: int = 4) -> float:
    return round(value, digits)
