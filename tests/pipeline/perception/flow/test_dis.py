"""Dense inverse search: OpenCV's presets by their numbers, and thin pictures, which OpenCV alone reads beyond."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.perception.flow.dis import PRESETS, Preset, dis
from tests.pipeline.perception.flow.test_flow import pair

OPENCVS: dict[Preset, int] = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}


@pytest.mark.parametrize("preset", OPENCVS)
@pytest.mark.parametrize("size", [(97, 130), (240, 321)], ids=str)
def test_the_presets_are_opencvs(size: tuple[int, int], preset: Preset) -> None:
    previous, current = pair(*size)
    theirs = cv2.DISOpticalFlow.create(OPENCVS[preset]).calc(previous, current, None)  # type: ignore[call-overload]
    np.testing.assert_array_equal(dis(previous, current, preset), theirs)


@pytest.mark.parametrize("finer", [False, True])
@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("size", [(16, 16), (17, 131), (131, 17), (16, 400)], ids=str)
def test_thin_pictures_have_a_finite_flow(size: tuple[int, int], preset: Preset, finer: bool) -> None:
    flow = dis(*pair(*size), preset, finer)
    assert flow.shape == (*size, 2)
    assert np.isfinite(flow).all()
