"""Regions of dim and hazy shots: the contrast of a shot, and the tolerances that follow it."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession
from pipeline.perception.cuts import thumbnail
from pipeline.perception.shot_contrast import SHOT_CONTRAST, contrast_after, spread

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


def test_the_spread_of_colours_is_their_standard_deviation_in_cielab_units() -> None:
    half = np.zeros((90, 160, 3), np.uint8)
    assert spread(thumbnail(half)) == 0
    half[:, 80:] = 255
    assert spread(thumbnail(half)) == pytest.approx(50, abs=0.5)


def test_the_contrast_follows_the_shot_and_starts_anew_with_the_next_one() -> None:
    full, dim = (thumbnail(street(lamp)) for lamp in (255, GREY))
    assert spread(full) > SHOT_CONTRAST.usual and spread(dim) < SHOT_CONTRAST.least * SHOT_CONTRAST.usual
    assert contrast_after(None, full) == 1 and contrast_after(None, dim) == SHOT_CONTRAST.least
    assert contrast_after(1.0, dim) == pytest.approx(1 - SHOT_CONTRAST.gain * (1 - SHOT_CONTRAST.least))


def test_a_figure_of_low_contrast_is_a_region_in_a_dim_shot_alone() -> None:
    assert seen(street()) == pytest.approx(GREY - FIGURE, abs=4)
    assert seen(street(), contrast_adaptation=0) < 4
    assert seen(street(lamp=255)) < 4


def test_in_a_fade_the_contrast_is_the_usual_one() -> None:
    analyzer = AbstractionSession(AbstractionParams(), SIZE).analyzer
    lights = (0.5, 0.5, 0.6, 0.7, 0.7)
    found = [analyzer.step((street() * light).astype(np.uint8)).contrast for light in lights]
    assert found == [SHOT_CONTRAST.least, SHOT_CONTRAST.least, 1, 1, SHOT_CONTRAST.least]


def test_a_session_continues_from_its_state_with_the_same_contrast() -> None:
    frames = [street(GREY + 30 * k) for k in range(4)]
    whole, first, second = (AbstractionSession(AbstractionParams(), SIZE) for _ in range(3))
    expected = [whole.step(frame) for frame in frames]
    for frame in frames[:2]:
        first.step(frame)
    second.restore(first.state())
    for frame, picture in zip(frames[2:], expected[2:], strict=True):
        np.testing.assert_array_equal(second.step(frame), picture)
