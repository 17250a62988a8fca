"""Flicker, detail and structure on pictures whose values are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.errors import BadFrame
from pipeline.frames import Frame
from pipeline.quality.coherence import detail, measure_pair, structure
from pipeline.quality.report import QualityReport, report_of, sampled_pairs
from pipeline.scenes import scene

SIZE = (160, 96)


def pair_of(name: str = "shapes", first: int = 3) -> tuple[Frame, Frame]:
    drawn = scene(name, SIZE, frames=first + 2)
    return drawn.image(first), drawn.image(first + 1)


def flashing(pair: tuple[Frame, Frame], grey_levels: int) -> tuple[Frame, Frame]:
    """The same pictures, the second brighter by a constant."""
    return pair[0], np.clip(pair[1].astype(int) + grey_levels, 0, 255).astype(np.uint8)


def test_the_source_is_as_steady_as_itself() -> None:
    assert measure_pair(pair_of(), pair_of()).flicker == pytest.approx(1)


def test_a_flash_is_an_error_of_its_own_size() -> None:
    dark = tuple(np.minimum(frame, 150) for frame in pair_of())
    still = (dark[0], dark[0])
    measured = measure_pair(still, flashing(still, 30))
    assert measured.source_error == 0
    assert measured.painted_error / measured.visible_px == pytest.approx(3 * (30 / 255) ** 2, rel=1e-6)


def test_what_moves_with_the_scene_does_not_flicker() -> None:
    """A picture that pans by whole pixels, inverted: it moves as its source does."""
    wide = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (96, 200, 3), np.uint8), (0, 0), 3)
    pan = (np.ascontiguousarray(wide[:, :160]), np.ascontiguousarray(wide[:, 4:164]))
    inverted = (255 - pan[0], 255 - pan[1])
    fixed = (inverted[0], inverted[0])
    assert measure_pair(pan, inverted).flicker == pytest.approx(1, abs=0.05)
    assert measure_pair(pan, fixed).flicker > 3, "paint that stays on the screen swims over the scene"


def test_blur_loses_detail_and_keeps_structure() -> None:
    frame = pair_of("harbour")[0]
    soft = cv2.GaussianBlur(frame, (0, 0), 2)
    assert detail(soft) < 0.7 * detail(frame)
    assert structure(frame, soft) > 0.75
    assert structure(frame, np.full_like(frame, 90)) == 0
    assert structure(frame, np.ascontiguousarray(frame[::-1])) < 0.5


def test_sizes_must_agree() -> None:
    first, second = pair_of()
    with pytest.raises(BadFrame):
        measure_pair((first, second), (first, second[:-16]))


def test_pairs_are_spread_evenly_over_the_video() -> None:
    assert sampled_pairs(11, 5) == [2, 4, 6, 8, 10]
    assert sampled_pairs(3, 10) == [1, 2]
    assert sampled_pairs(1, 10) == sampled_pairs(0, 10) == []


def test_a_report_names_the_worst_pairs() -> None:
    pair = pair_of()
    painted = {1: pair, 5: flashing(pair, 40), 9: flashing(pair, 10)}
    report = report_of((frame, pair, painted[frame]) for frame in painted).as_json()
    assert report["worst"] == [5, 9, 1] and report["pairs"] == 3
    assert report["flicker"] > 1
    assert [row["frame"] for row in report["samples"]] == [1, 5, 9]


def test_a_report_without_pairs_has_no_flicker() -> None:
    assert QualityReport().summary()["flicker"] is None
