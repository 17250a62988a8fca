"""Flicker, detail and structure on pictures whose values are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.errors import BadFrame
from pipeline.frames import Frame
from pipeline.quality.coherence import detail, flicker_map, measure_pair, structure
from pipeline.quality.palette import PictureColours
from pipeline.quality.report import QualityReport, report_of
from pipeline.quality.sampling import SampleSize, affordable_sample, job_pairs, sampled_pairs, tile
from pipeline.scenes import scene

SIZE = (160, 96)


def pair_of(name: str = "shapes", first: int = 3) -> tuple[Frame, Frame]:
    drawn = scene(name, SIZE, frames=first + 2)
    return drawn.image(first), drawn.image(first + 1)


def flashing(pair: tuple[Frame, Frame], gray_levels: int) -> tuple[Frame, Frame]:
    """Two equal frames, the second brighter by a constant."""
    return pair[0], np.clip(pair[1].astype(int) + gray_levels, 0, 255).astype(np.uint8)


def test_the_source_is_as_steady_as_itself() -> None:
    assert measure_pair(pair_of(), pair_of()).flicker == pytest.approx(1)


def test_a_flash_is_an_error_of_its_own_size() -> None:
    dark = tuple(np.minimum(frame, 150) for frame in pair_of())
    still = (dark[0], dark[0])
    measured = measure_pair(still, flashing(still, 30))
    assert measured.source_error == 0
    assert measured.painted_error / measured.visible_px == pytest.approx(3 * (30 / 255) ** 2, rel=1e-6)


def test_what_moves_with_the_scene_does_not_flicker() -> None:
    """An inverted video that pans by whole pixels moves like its source."""
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


def test_frames_painted_alone_are_compared_with_the_same_pairs_of_the_result() -> None:
    pair, report = pair_of(), QualityReport()
    report.add(1, pair, flashing(pair, 10), alone=flashing(pair, 40))
    report.add(2, pair, flashing(pair, 80))
    found = report.summary()
    assert found["alone_pairs"] == 1
    assert found["alone_flicker"] == pytest.approx(measure_pair(pair, flashing(pair, 40)).flicker, rel=1e-3)
    expected = measure_pair(pair, flashing(pair, 10)).flicker / measure_pair(pair, flashing(pair, 40)).flicker
    assert found["flicker_of_alone"] == pytest.approx(expected, rel=1e-3)


def test_palette_distance_is_0_for_colours_of_the_picture_and_the_length_of_a_shift() -> None:
    picture = pair_of()[0]
    picture = (picture // 2).astype(np.uint8)
    palette = PictureColours(np.full((20, 20, 3), (90, 40, 10), np.uint8))
    assert palette.distance(np.full((30, 40, 3), (90, 40, 10), np.uint8)) == pytest.approx(0, abs=0.1)
    assert palette.distance(np.full((30, 40, 3), (93, 44, 10), np.uint8)) == pytest.approx(5, abs=0.1)
    report = QualityReport(palette=PictureColours(picture))
    report.add(1, (picture, picture), (picture, picture))
    assert report.summary()["palette_distance"] == pytest.approx(0, abs=1)
    assert "palette_distance" not in QualityReport().summary()


def test_what_a_report_measures_follows_from_what_the_render_costs() -> None:
    hd = (1280, 720)
    assert affordable_sample(40, hd, 0.1) == SampleSize(1, 0, faces=False)
    assert affordable_sample(150, hd, 0.1) == SampleSize(3, 0, faces=True)
    assert affordable_sample(600, hd, 0.1) == SampleSize(4, 1, faces=True)
    assert affordable_sample(600, hd, 0.1, stand_alone=False) == SampleSize(12, 0, faces=True)
    assert affordable_sample(10_000, hd, 2.0) == SampleSize(12, 3, faces=True), "at most 64 MiB of the source are kept"
    assert affordable_sample(10_000, (320, 180), 2.0) == SampleSize(60, 3, faces=True)


def test_a_jobs_pairs_are_frames_of_its_contact_sheet_where_these_suffice() -> None:
    sheet = [4, 12, 21, 29, 37, 46, 54, 62, 71, 79, 87, 96]
    assert job_pairs(100, sheet, 3) == [21, 54, 87] and job_pairs(100, sheet, 12) == sheet
    assert job_pairs(100, sheet, 20) == sampled_pairs(100, 20)
    assert job_pairs(2, [0, 1], 1) == [1]


def test_parts_of_sampled_pairs_go_through_the_whole_picture() -> None:
    rows, columns = np.mgrid[:720, :1280]
    place = np.stack([rows // 4, columns // 8, rows * 0], axis=-1).astype(np.uint8)
    parts = [tile(place, k) for k in range(40)]
    assert all(part.shape == (180, 320, 3) for part in parts)
    seen = np.zeros((4, 4), bool)
    for part in parts:
        seen[part[90, 160, 0] // 46, part[90, 160, 1] // 41] = True
    assert seen[1:3, 1:3].all() and seen.sum() >= 8
    assert tile(place[:100, :200], 3).shape == (100, 200, 3)


def test_figures_agree_with_a_direct_transcription_of_the_definitions() -> None:
    """Six pairs of generated scenes; the transcription shares no code with the measured functions."""
    for name, first in (("shapes", 2), ("shapes", 5), ("harbour", 2), ("harbour", 5), ("cut", 1), ("portrait", 3)):
        pair = pair_of(name, first)
        noise = np.random.default_rng(first).normal(0, 12, (2, *pair[0].shape))
        painted = tuple(np.clip(cv2.bilateralFilter(f, 5, 40, 5) + n, 0, 255).astype(np.uint8)
                        for f, n in zip(pair, noise, strict=True))  # fmt: skip
        given, made = _transcribed_error(pair, pair), _transcribed_error(pair, painted)
        assert measure_pair(pair, painted).flicker == pytest.approx(np.sqrt(made / given), rel=0.05), name
        expected = _transcribed_detail(painted[1]) / _transcribed_detail(pair[1])
        assert detail(painted[1]) / detail(pair[1]) == pytest.approx(expected, rel=0.05), name


def _transcribed_error(source: tuple[Frame, Frame], shown: tuple[Frame, Frame]) -> float:
    """Mean squared difference of visible pixels (lai2018learning, eq. 9 and 10; sundaram2010dense, eq. 5, 6)."""
    first, second = (cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in source)
    solver = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    back, forth = solver.calc(second, first, None), solver.calc(first, second, None)
    height, width = first.shape
    at = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float32) + back
    there = cv2.remap(forth, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    lengths = [(flow**2).sum(-1) for flow in (back + there, back, there)]
    slopes = sum((cv2.Sobel(back, cv2.CV_32F, *axis, scale=1 / 8) ** 2).sum(-1) for axis in ((1, 0), (0, 1)))
    seen = (lengths[0] <= 0.01 * (lengths[1] + lengths[2]) + 0.5) & (slopes <= 0.01 * lengths[1] + 0.002)
    seen &= (at >= 0).all(-1) & (at[..., 0] <= width - 1) & (at[..., 1] <= height - 1)
    warped = cv2.remap(shown[0], at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    return float(((shown[1].astype(float) - warped) ** 2).sum(-1)[seen].mean())


def _transcribed_detail(frame: Frame) -> float:
    gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return float(np.hypot(cv2.Sobel(gray, cv2.CV_32F, 1, 0), cv2.Sobel(gray, cv2.CV_32F, 0, 1)).mean())


def test_the_flicker_map_shows_where_the_paint_flashes() -> None:
    still = pair_of()
    before, now = (frame.copy() for frame in still)
    now[10:20, 10:20] = np.clip(now[10:20, 10:20].astype(int) + 60, 0, 255)
    measure, plane = flicker_map(still, (before, now))
    assert measure == measure_pair(still, (before, now))
    assert plane[12:18, 12:18].mean() > 0.15 and plane[30:, 30:].max() < 0.02
