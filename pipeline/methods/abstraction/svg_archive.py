"""Vector output: each frame as regions with boundary and colour (zhang2011online, section 7)."""

from __future__ import annotations

import io
import zipfile

import numpy as np

from pipeline.methods.abstraction.compositor import CompositedFrame, ink_rgb
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.regions.segmenter import Segmentation
from pipeline.vector.stroke_outlines import StrokeOutlines, stroke_outlines
from pipeline.vector.svg import DEFAULT_PASSES, Lines, Motion, to_svg
from pipeline.vector.transforms import outline_transforms, region_transforms, scaled

_EPOCH = (1980, 1, 1, 0, 0, 0)


class SvgArchive:
    """Zip with one SVG per frame, named by frame number; a region has the same id in all its frames, and its motion
    since the previous frame.

    Args:
        last: regions of the frame before the first one; None: there is none.
    """

    def __init__(self, key: str, params: AbstractionParams, last: Segmentation | None) -> None:
        self._last = last
        self._rgb = ink_rgb(params)
        self.name = f"svg-{key}.zip"
        self._bytes = io.BytesIO()
        self._zip = zipfile.ZipFile(self._bytes, "w", zipfile.ZIP_DEFLATED, compresslevel=6)

    def add(self, index: int, painting: CompositedFrame, delivered: bool) -> None:
        """The next frame; `delivered`: whether it is part of the result."""
        if delivered:
            self._write(index, painting)
        self._last = painting.regions

    def _write(self, index: int, painting: CompositedFrame) -> None:
        strokes = None if painting.lines is None else stroke_outlines(*painting.lines.strokes)
        lines = None if strokes is None else Lines(strokes, self._rgb, painting.analysis.params.line_opacity)
        page = to_svg(
            painting.labels, painting.colours, painting.regions.ids, lines=lines,
            smoothing=painting.borders or DEFAULT_PASSES, size=painting.frame.shape[1::-1],
            motion=self._motion(painting, strokes),
        )  # fmt: skip
        self._zip.writestr(zipfile.ZipInfo(f"{index:05d}.svg", _EPOCH), page)

    def _motion(self, painting: CompositedFrame, strokes: StrokeOutlines | None) -> Motion | None:
        regions, flow = painting.regions, painting.analysis.flow
        if flow is None or self._last is None:
            return None
        height, width = painting.frame.shape[:2]
        scale = width / flow.shape[1], height / flow.shape[0]
        moved = region_transforms(regions.labels, self._last.labels, regions.previous, flow)
        lines = np.empty((0, 2, 3)) if strokes is None else outline_transforms(strokes.arcs, flow, scale)
        return Motion(scaled(moved, scale), lines)

    def close(self) -> bytes:
        self._zip.close()
        return self._bytes.getvalue()
