"""Regions of dim and hazy shots: the contrast of a shot and of its places, and the tolerances that follow it."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession
from pipeline.segmentation.contrast import GAIN, LEAST, Contrast, contrast_after
from pipeline.segmentation.cuts import thumbnail

SIZE = (160, 120)
GREY, FIGURE = 100, 80


def street(lamp: int = GREY) -> Frame:
    """A figure before a street, darker by 8 CIELAB units, and a wall on the right of the given level."""
    frame = np.full((SIZE[1], SIZE[0], 3), GREY, np.uint8)
    frame[40:100, 40:64] = FIGURE
    frame[:, 110:] = lamp
    return frame


def seen(frame: Frame, **values: float) -> float:
    """How much darker the figure is than the street in the cartoon, gray levels."""
    session = AbstractionSession(AbstractionParams(lines="off", **values), SIZE)
    for _ in range(3):
        painted = session.step(frame).astype(float)
    return float(painted[70, 20].mean() - painted[70, 52].mean())


def test_a_shot_of_two_colours_has_the_usual_contrast_and_a_uniform_one_the_least() -> None:
    half = np.zeros((90, 160, 3), np.uint8)
    assert contrast_after(None, thumbnail(half)).shot == LEAST
    half[:, 80:] = 255
    found = contrast_after(None, thumbnail(half))
    assert found.shot == 1 and found.places.shape == (18, 32)
    np.testing.assert_allclose(found.places[:, [15, 16]], 1, atol=1e-6)  # beside the edge
    np.testing.assert_allclose(found.places[:, [0, 31]], LEAST, atol=1e-6)


def test_the_contrast_follows_the_shot_and_starts_anew_with_the_next_one() -> None:
    full, dim = (thumbnail(street(lamp)) for lamp in (255, GREY))
    first, other = contrast_after(None, full), contrast_after(None, dim)
    assert first.shot == 1 and other.shot == LEAST
    after = contrast_after(first, dim)
    assert after.shot == pytest.approx(1 - GAIN * (1 - LEAST))
    np.testing.assert_allclose(after.places, (1 - GAIN) * first.places + GAIN * other.places, atol=1e-6)


def test_without_weight_the_contrast_is_the_usual_one_everywhere() -> None:
    low = Contrast(0.5, np.full((18, 32), 0.25, np.float32))
    assert low.weighted(0).shot == 1 and (low.weighted(0).places == 1).all()
    assert low.weighted(0.5).shot == 0.75 and (low.weighted(0.5).places == 0.625).all()


@pytest.mark.parametrize("lamp", [GREY, 255])
def test_a_figure_of_low_contrast_is_a_region_in_a_dim_shot_and_in_a_dim_part_of_a_bright_one(lamp: int) -> None:
    assert seen(street(lamp)) == pytest.approx(GREY - FIGURE, abs=4)
    assert seen(street(lamp), contrast_adaptation=0) < 4


def test_a_session_continues_from_its_state_with_the_same_contrast() -> None:
    frames = [street(GREY + 30 * k) for k in range(4)]
    whole, first, second = (AbstractionSession(AbstractionParams(), SIZE) for _ in range(3))
    expected = [whole.step(frame) for frame in frames]
    for frame in frames[:2]:
        first.step(frame)
    second.restore(first.state())
    for frame, picture in zip(frames[2:], expected[2:], strict=True):
        np.testing.assert_array_equal(second.step(frame), picture)
