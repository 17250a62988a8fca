"""The method steady: flicker is removed, detail and moving objects are kept, cuts and masks are respected."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.errors import BadInput
from pipeline.frames import Frame
from pipeline.kernels.buffers import Buffers
from pipeline.methods.base import PlanContext, Task, VideoInfo
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.steady import Steady, SteadyFilter, SteadyParams, plan
from pipeline.methods.steady.confidence import TrustedMotion
from pipeline.methods.steady.detail import NO_AMOUNTS, amounts_of, sharpen
from pipeline.methods.steady.equation import age_weights
from pipeline.scenes import scene
from tests.pipeline.methods.frames import painted

SIZE = (96, 64)
BACKGROUND, OBJECT = (60, 140, 60), (200, 60, 40)


@cache
def texture() -> Frame:
    """A still image with detail at all scales."""
    draw = np.random.default_rng(1)
    layers = [cv2.resize(draw.random((64 // s, 96 // s, 3)), SIZE, interpolation=cv2.INTER_CUBIC) for s in (1, 4, 16)]
    picture: Frame = np.clip(255 * np.mean(layers, axis=0), 0, 255).astype(np.uint8)
    return picture


def still(frames: int = 12) -> list[Frame]:
    return [texture().copy() for _ in range(frames)]


def flickering(video: list[Frame], levels: float = 12) -> list[Frame]:
    """The video with independent noise and brightness in each frame."""
    draw = np.random.default_rng(2)
    noisy = (f + levels * (draw.standard_normal(f.shape) + draw.standard_normal()) for f in video)
    return [np.clip(frame, 0, 255).astype(np.uint8) for frame in noisy]


def moving_square(frames: int = 10) -> list[Frame]:
    """A textured square that moves over another texture by 3 px per frame."""
    video = []
    for index in range(frames):
        frame = (texture() // 4 + np.array(BACKGROUND, np.uint8)).astype(np.uint8)
        frame[20:44, 8 + 3 * index : 32 + 3 * index] = texture()[20:44, 8:32] // 4 + np.array(OBJECT, np.uint8)
        video.append(frame)
    return video


def run(
    video: list[Frame], styled: list[Frame], more: dict[str, Any] | None = None, **params: Any
) -> NDArray[np.uint8]:
    context = LocalContext(SteadyParams(**params), video, {"styled": styled, **(more or {})})
    run_plan(Steady(), context)
    return painted(context)


def change(frames: NDArray[np.uint8] | list[Frame]) -> float:
    """Root mean square of the difference between neighbouring frames, gray levels."""
    return float(np.sqrt(np.square(np.diff(np.asarray(frames, np.float32), axis=0)).mean()))


def test_flicker_of_a_still_scene_falls_below_a_quarter_and_its_detail_stays() -> None:
    styled = flickering(still())
    result = run(still(), styled)
    assert change(result) < 0.25 * change(styled)
    shapes = [np.abs(cv2.Sobel(f.astype(np.float32), cv2.CV_32F, 1, 0)).mean() for f in (result[-1], texture())]
    assert shapes[0] == pytest.approx(shapes[1], rel=0.1)


def test_a_styled_video_without_flicker_stays_as_it_is() -> None:
    result = run(still(4), still(4))
    assert np.abs(result.astype(int) - np.asarray(still(4))).max() <= 1


def test_strength_0_returns_the_styled_video() -> None:
    styled = flickering(moving_square(4))
    np.testing.assert_array_equal(run(moving_square(4), styled, strength=0, detail=0), styled)


def test_what_an_object_uncovers_has_no_trail() -> None:
    video = moving_square()
    result = run(video, flickering(video, levels=4))
    uncovered = np.s_[24:40, 10:28]
    for index in range(8, 10):
        difference = result[index][uncovered].astype(float) - video[index][uncovered]
        assert np.abs(difference.mean(axis=(0, 1))).max() < 20  # the colours of object and background differ by 140


def test_what_an_object_uncovers_gets_a_past_of_its_own_age() -> None:
    """For some frames the past weighs little, so that its errors are averaged out."""
    steady = SteadyFilter(SteadyParams(), SIZE)
    weights = [found.weight for frame in moving_square() if (found := steady.analyze(frame))]
    uncovered = [float(weight[24:40, 14:17].mean()) for weight in weights[2:]]  # by the fourth frame
    assert weights[0][24:40, 70:].min() > 39
    assert uncovered[0] < 2 and uncovered[1] < 8 and uncovered[2] < 15
    assert uncovered == sorted(uncovered)


def test_one_frame_of_low_confidence_does_not_end_a_long_past() -> None:
    long, short = (np.full((1, 4), frames, np.float32) for frames in (40, 5))
    trust = np.array([[1, 0.8, 0.1, 0]], np.float32)
    weights = [np.empty_like(trust) for _ in range(2)]
    for age, weight in zip((long, short), weights, strict=True):
        age_weights(age, trust, np.float32(40), weight)
    np.testing.assert_allclose(weights[0], 40 * trust, rtol=1e-6)
    np.testing.assert_allclose(weights[1], 0.6 * 40 * trust**1.25, rtol=1e-6)
    np.testing.assert_allclose(long, [[40, 41 * 0.8**0.25, 41 * 0.1**0.25, 0]], rtol=1e-5)


@pytest.mark.parametrize("params", [{}, {"look_ahead": 2}, {"detail": 0}], ids=str)
def test_the_bytes_are_the_same_on_any_number_of_processors(
    params: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    video, results = moving_square(7), []
    for processors in (1, 16):
        monkeypatch.setattr("pipeline.methods.steady.plan.usable_processors", lambda count=processors: count)
        results.append(run(video, flickering(video), **params))
    np.testing.assert_array_equal(*results)


def test_a_cut_starts_afresh() -> None:
    made = scene("cut", SIZE, frames=6, fps=6)
    video = [made.image(index) for index in range(6)]
    styled = flickering(video)
    context = LocalContext(SteadyParams(), video, {"styled": styled})
    tasks = run_plan(Steady(), context)["steady"]
    first = [task.args["start"] for task in tasks if not task.after]
    assert len(first) == 2 and first[0] == 0
    for start in first:
        np.testing.assert_array_equal(context.emitted[start], styled[start])


def test_colours_follow_the_styled_video_with_the_half_life() -> None:
    darker = [*still(1), *[(frame // 2).astype(np.uint8) for frame in still(13)]]
    slow, fast = (run(still(14), darker, colour_half_life=h)[-1].mean() for h in (0, 3))
    assert slow == pytest.approx(texture().mean(), abs=8)
    assert fast == pytest.approx(texture().mean() / 2, abs=8)


def test_a_mask_keeps_the_styled_frames_where_it_is_black() -> None:
    mask = np.zeros(SIZE[::-1], np.uint8)
    mask[:, 48:] = 255
    styled = flickering(still(6))
    result = run(still(6), styled, {"mask": {2: mask}})
    np.testing.assert_array_equal(result[2:, :, :48], np.asarray(styled)[2:, :, :48])
    assert change(result[2:, :, 56:]) < 0.5 * change(np.asarray(styled)[2:, :, 56:])
    assert np.any(result[1, :, :48] != styled[1][:, :48])  # before the first mask everything is steadied


@pytest.mark.parametrize("frames", [3, 4, 7])
def test_the_bytes_do_not_depend_on_the_length_of_runs(frames: int, monkeypatch: pytest.MonkeyPatch) -> None:
    video = moving_square(8)
    masks = {"mask": {2: np.full((8, 12), 200, np.uint8), 5: np.full((8, 12), 90, np.uint8)}}
    whole = run(video, flickering(video), masks)
    monkeypatch.setattr(plan, "RUN_FRAMES", frames)
    np.testing.assert_array_equal(run(video, flickering(video), masks), whole)


class KilledOnce(LocalContext[SteadyParams]):
    """A context whose process dies when frame 6 comes for the first time."""

    died = False

    def emit(self, index: int, frame: Frame) -> None:
        if index == 6 and not self.died:
            self.died = True
            raise SystemExit
        super().emit(index, frame)


def test_a_run_that_was_killed_is_repeated_with_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "RUN_FRAMES", 4)
    video = moving_square(8)
    context = KilledOnce(SteadyParams(), video, {"styled": flickering(video)})
    with pytest.raises(SystemExit):
        run_plan(Steady(), context)
    assert context.task is not None and context.task.args["start"] == 4
    context.emitted = {index: frame for index, frame in context.emitted.items() if index < 4}
    Steady.steps[1].run(context.task, context)
    np.testing.assert_array_equal(painted(context), run(video, flickering(video)))


def test_a_job_equals_the_filter_on_a_stream() -> None:
    video = moving_square(5)
    stream = SteadyFilter(SteadyParams(), SIZE)
    frames = [stream.step(source, styled) for source, styled in zip(video, flickering(video), strict=True)]
    np.testing.assert_array_equal(run(video, flickering(video)), frames)


@pytest.mark.parametrize("given", [4, 6])
def test_another_number_of_frames_is_an_error_that_names_both(given: int) -> None:
    with pytest.raises(BadInput, match=f"has {given} frames, the video has 5") as caught:
        run(still(5), still(given))
    assert caught.value.field == "inputs.styled" and caught.value.remedy


def test_a_scaled_styled_video_is_an_error_with_both_sizes_and_the_remedy() -> None:
    small = [np.ascontiguousarray(cv2.resize(frame, (48, 32))) for frame in still(3)]
    with pytest.raises(BadInput, match=r"48x32, the video is 96x64; its scale is 0\.5") as caught:
        run(still(3), small)
    assert "Scale the styled video to 96x64" in caught.value.remedy


def test_a_cropped_styled_video_is_an_error() -> None:
    cropped = [np.ascontiguousarray(frame[:48]) for frame in still(3)]
    with pytest.raises(BadInput, match="another aspect ratio") as caught:
        run(still(3), cropped)
    assert "cropped" in caught.value.remedy


def texture_of(picture: AnyArray) -> float:
    return float(np.abs(cv2.Laplacian(np.asarray(picture, np.float32), cv2.CV_32F)).mean())


def drifting_blots(frames: int = 24) -> tuple[list[Frame], list[Frame]]:
    """A source that drifts by fractions of a pixel, and a style with independent, hard-edged texture in each frame."""
    draw = np.random.default_rng(3)
    large = cv2.resize(draw.random((80, 112, 3)).astype(np.float32) * 255, (448, 320), interpolation=cv2.INTER_CUBIC)
    sources, styled = [], []
    for index in range(frames):
        shift = np.array([[1, 0, -0.4 * index - 10], [0, 1, -0.3 * index - 10]], np.float32)
        frame = cv2.warpAffine(large, shift, (192, 128), flags=cv2.INTER_CUBIC).clip(0, 255)
        noise = cv2.GaussianBlur(draw.standard_normal((128, 192)).astype(np.float32), (0, 0), 1)
        sources.append(frame.astype(np.uint8))
        styled.append((frame // 2 + 80 * (noise > 0)[..., None]).astype(np.uint8))
    return sources, styled


def steadied(sources: list[Frame], styled: list[Frame], detail: float) -> list[Frame]:
    steady = SteadyFilter(SteadyParams(detail=detail), (sources[0].shape[1], sources[0].shape[0]))
    return [steady.step(source, frame) for source, frame in zip(sources, styled, strict=True)]


def test_texture_that_averaging_would_blur_keeps_its_contrast_and_remains_steady() -> None:
    sources, styled = drifting_blots()
    plain, half, full = (steadied(sources, styled, share)[-6:] for share in (0, 0.5, 1))
    wanted = np.mean([texture_of(frame) for frame in styled[-6:]])
    amounts = [np.mean([texture_of(frame) for frame in frames]) / wanted for frames in (plain, half, full)]
    assert 1.2 * amounts[0] < amounts[1] and 1.2 * amounts[1] < amounts[2]
    assert amounts[0] < 0.35 and amounts[2] > 0.5
    assert change(full) < 0.5 * change(styled[-6:])


def motion_of(trust: NDArray[np.float32], offset: float) -> TrustedMotion:
    rows, columns = np.indices(trust.shape, np.float32) + np.float32(offset)
    return TrustedMotion((np.asarray(columns, np.float32), np.asarray(rows, np.float32)), trust)


def noise_picture() -> NDArray[np.float32]:
    picture = 128 + 30 * np.random.default_rng(3).standard_normal((64, 96, 3)).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.6), np.float32)


def amounts_for(result: NDArray[np.float32], styled: NDArray[np.float32]) -> NDArray[np.float32]:
    return amounts_of(result, styled, NO_AMOUNTS, Buffers())


def test_nothing_is_sharpened_where_the_motion_is_not_trusted() -> None:
    picture = noise_picture()
    amounts = amounts_for(picture, 128 + 2 * (picture - 128))
    trust = np.ones(picture.shape[:2], np.float32)
    trust[:, :20] = 0
    out = np.empty_like(picture)
    sharpen(picture, motion_of(trust, 0), amounts, 1, out)
    np.testing.assert_array_equal(out[:, :20], picture[:, :20])
    assert texture_of(out[:, 20:]) > 1.2 * texture_of(picture[:, 20:])


def test_sharpened_values_stay_between_those_of_the_neighbours() -> None:
    picture = noise_picture()
    out = np.empty_like(picture)
    everywhere = np.ones(picture.shape[:2], np.float32)
    sharpen(picture, motion_of(everywhere, 0), amounts_for(picture, 128 + 3 * (picture - 128)), 1, out)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    assert np.all(out <= cv2.dilate(picture, cross)) and np.all(out >= cv2.erode(picture, cross))


def test_a_picture_with_enough_texture_changes_only_between_pixels() -> None:
    """Half-way between pixels, the interpolation's response is corrected."""
    picture = noise_picture()
    out = np.empty_like(picture)
    everywhere = np.ones(picture.shape[:2], np.float32)
    sharpen(picture, motion_of(everywhere, 0), amounts_for(picture, picture), 1, out)
    np.testing.assert_allclose(out, picture, atol=1e-3)
    sharpen(picture, motion_of(everywhere, 0.5), amounts_for(picture, picture), 1, out)
    assert texture_of(out) > 1.02 * texture_of(picture)


def test_a_recursion_of_half_pixel_steps_keeps_coarse_waves_as_they_are() -> None:
    """OpenCV's cubic interpolation amplifies waves of 7 px by 3 % in each step of half a pixel."""
    still = motion_of(np.ones((64, 96), np.float32), 0)
    (columns, rows), trust = still.to, still.trust
    wave = np.repeat((128 + 40 * np.sin(columns * np.float32(2 * np.pi / 7)))[..., None], 3, -1)
    half = TrustedMotion((columns + np.float32(0.5), rows), trust)
    picture = wave
    for _ in range(6):
        moved = np.asarray(cv2.remap(picture, *half.to, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.float32)
        picture = np.empty_like(moved)
        sharpen(moved, half, NO_AMOUNTS, 1, picture)
    assert picture[20:40, 20:76].std() == pytest.approx(wave[20:40, 20:76].std(), rel=0.06)


def test_amounts_measure_both_bands_of_both_pictures() -> None:
    picture = noise_picture()
    amounts = amounts_for(picture, 128 + 2 * (picture - 128))
    assert amounts.shape == (4, 16, 24)
    np.testing.assert_allclose(amounts[2:], 2 * amounts[:2], rtol=0.01)
    light = cv2.transform(picture, np.array([[0.299, 0.587, 0.114]], np.float32))
    laplacian = cv2.Laplacian(light, cv2.CV_32F, borderType=cv2.BORDER_REPLICATE)
    assert amounts[0].mean() == pytest.approx(np.abs(laplacian).mean() / 4, rel=0.05)


def test_a_single_frame_with_more_texture_hardly_changes_the_amounts() -> None:
    picture = noise_picture()
    before = amounts_for(picture, picture)
    after = amounts_of(picture, 128 + 1.5 * (picture - 128), before, Buffers())
    np.testing.assert_allclose(after[2:], 1.05 * before[2:], rtol=0.01)
    np.testing.assert_allclose(after[:2], before[:2], rtol=1e-5)


def test_a_resized_filter_continues_with_its_amounts_of_texture() -> None:
    steady = SteadyFilter(SteadyParams(), SIZE)
    for source, styled in zip(still(3), flickering(still(3)), strict=True):
        steady.step(source, styled)
    half = steady.reconfigure(SteadyParams(), (48, 32))
    assert half.state()["amounts"].shape == (4, 8, 12)
    small = np.ascontiguousarray(cv2.resize(texture(), (48, 32)))
    assert half.step(small, small).shape == small.shape


def test_a_filter_that_goes_on_does_not_change_a_state_that_was_taken_before() -> None:
    steady, styled = SteadyFilter(SteadyParams(), SIZE), flickering(still(6))
    for frame in styled[:3]:
        steady.step(texture(), frame)
    taken = steady.state()
    kept = {name: plane.copy() for name, plane in taken.items()}
    after = steady.step(texture(), styled[3])
    assert all(np.array_equal(taken[name], plane) for name, plane in kept.items())
    other = SteadyFilter(SteadyParams(), SIZE)
    other.restore(taken)
    assert np.array_equal(other.step(texture(), styled[3]), after)
    assert all(np.array_equal(taken[name], plane) for name, plane in kept.items())


def test_the_second_pass_lowers_flicker_and_keeps_detail() -> None:
    styled = flickering(still())
    causal, both = run(still(), styled), run(still(), styled, look_ahead=3)
    assert len(both) == len(causal) and change(both) < 0.8 * change(causal)
    shapes = [np.abs(cv2.Sobel(f.astype(np.float32), cv2.CV_32F, 1, 0)).mean() for f in (both[4], texture())]
    assert shapes[0] == pytest.approx(shapes[1], rel=0.1)


def test_the_second_pass_uses_the_frames_of_the_next_run_but_not_those_behind_a_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(plan, "RUN_FRAMES", 5)
    made = scene("cut", SIZE, frames=18, fps=6)
    video = [made.image(index) for index in range(18)]
    styled = flickering(video)

    def two_passes(changed: int) -> tuple[list[Task], NDArray[np.uint8]]:
        """Tasks and result where one styled frame is dark; -1: none."""
        given = [np.zeros_like(frame) if index == changed else frame for index, frame in enumerate(styled)]
        context = LocalContext(SteadyParams(look_ahead=2), video, {"styled": given})
        return run_plan(Steady(), context)["steady"], painted(context)

    tasks, result = two_passes(-1)
    starts = {task.args["start"] for task in tasks}
    behind_cuts = [task.args["stop"] for task in tasks if task.args["last"] and task.args["stop"] in starts]
    next_runs = [task.args["stop"] for task in tasks if not task.args["last"]]
    assert behind_cuts and next_runs
    for index in behind_cuts:
        np.testing.assert_array_equal(two_passes(index)[1][:index], result[:index])
    for index in next_runs:
        assert not np.array_equal(two_passes(index)[1][index - 1], result[index - 1])


def test_the_second_pass_follows_the_mask() -> None:
    styled = flickering(still(6))
    mask = np.full((64, 96), 255, np.uint8)
    mask[:, 48:] = 0
    result = run(still(6), styled, {"mask": {0: mask}}, look_ahead=2)
    np.testing.assert_array_equal(result[:, :, 48:], np.asarray(styled)[:, :, 48:])
    assert change(result[:, :, :48]) < change(np.asarray(styled)[:, :, :48])


def test_frames_in_floating_point_declare_more_memory() -> None:
    plain = PlanContext(SteadyParams(), 0, VideoInfo(3840, 2160, 10, 25.0, 0.4))
    needs = [Steady().resources("steady", replace(plain, deep=deep)).memory_bytes for deep in (False, True)]
    assert needs[1] - needs[0] > 100 * 3840 * 2160
