"""Styles of the stroke library, beside the paper's table 1."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Style:
    """How strokes are made, beside table 1.

    Attributes:
        length: factor on the table's lengths; 0 paints circles.
        radius: factor on the table's radii.
        opacity: 0..1.
        curvature: the filter f_c: 1 = strokes follow the gradient's normal, towards 0 they stay straight.
        jitter: added to the parameter.
        saturation_shift: of the colours, part of the full range.
        overlap: see `Recipe`.
        threshold: factor on T.
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
