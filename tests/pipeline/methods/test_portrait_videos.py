"""A video that is higher than wide has lines and strokes of the same width as the same video lying on its side."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.methods.abstraction.border_curves import BorderCurves
from pipeline.methods.abstraction.line_extractor import LineExtractor
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.sizes import analysis_blur_px, sizes_of
from pipeline.methods.multistyle import MultistyleParams
from pipeline.methods.multistyle.analyzer import StrokeAnalyzer
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.methods.tasks import no_clock

LANDSCAPES = [(320, 180), (854, 480), (1280, 720), (1920, 1080)]


@pytest.mark.parametrize("wide", LANDSCAPES)
def test_lines_and_borders_of_abstraction_have_the_same_width(wide: tuple[int, int]) -> None:
    found = []
    for size in (wide, wide[::-1]):
        sizes, params = sizes_of(AbstractionParams(), size), AbstractionParams()
        lines, borders = LineExtractor(params, sizes), BorderCurves(params, sizes)
        found.append(
            (sizes.curves, sizes.work == size, analysis_blur_px(sizes), lines.sigma_px, lines.shortest_px,
             borders.sigma_px, borders.limit_px, borders.reach_px)
        )  # fmt: skip
    assert found[0] == found[1]


@pytest.mark.parametrize("wide", LANDSCAPES[:2])
@pytest.mark.parametrize("style", ["van-gogh", "watercolor"])
def test_strokes_of_multistyle_have_the_same_width(wide: tuple[int, int], style: str) -> None:
    widest = []
    for width, height in (wide, wide[::-1]):
        params = MultistyleParams(style=style)
        analysis = StrokeAnalyzer(params, (width, height), 0, no_clock).step(np.full((height, width, 3), 90, np.uint8))
        widest.append([float(layer.profile.max()) for layer in analysis.layers])
    assert widest[0] == pytest.approx(widest[1], rel=0.02)


@pytest.mark.parametrize("wide", LANDSCAPES)
def test_strokes_of_patches_have_the_same_width(wide: tuple[int, int]) -> None:
    grids = [WorkingGrid.of(size) for size in (wide, wide[::-1])]
    assert grids[0].unit == grids[1].unit and grids[0].size == grids[1].size[::-1]
