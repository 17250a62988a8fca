"""Styles of the stroke library, beside the paper's table 1."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Style:
    """Stroke style: modifications of the values in table 1 of zhang2011patches.

    Attributes:
        length: factor on the table's lengths; 0 paints circles.
        radius: factor on the table's radii.
        opacity: 0..1.
        curvature: curvature filter f_c, 0..1: 1 = strokes follow the gradient's normal; lower values straighten them.
        jitter: colour jitter, added to the parameter `jitter`.
        saturation_shift: change of saturation, as a fraction of the full range.
        overlap: mean number of strokes on a pixel, see `LayerScheme`.
        threshold: factor on the approximation threshold T.
    """

    length: float = 1.0
    radius: float = 1.0
    opacity: float = 1.0
    curvature: float = 1.0
    jitter: float = 0.0
    saturation_shift: float = 0.0
    overlap: float = 3.0
    threshold: float = 1.0


STYLES: dict[str, Style] = {
    "hertzmann": Style(),
    "circles": Style(length=0.0, jitter=0.35, overlap=3.5, saturation_shift=0.05),
    "impressionist": Style(length=0.35, jitter=0.12, threshold=1.6, saturation_shift=0.08, overlap=3.5),
    "expressionist": Style(length=1.2, curvature=0.35, opacity=0.85, jitter=0.2, threshold=0.8, saturation_shift=0.12),
    "wash": Style(opacity=0.5, length=0.8, threshold=2.4, radius=1.3, jitter=0.04, overlap=5.0),
}
