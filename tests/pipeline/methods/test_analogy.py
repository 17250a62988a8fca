"""Analogy: output colours are colours of the style, keyframes are exact, motion is coherent, inputs are validated."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest

from pipeline.compute import Device, device
from pipeline.errors import BadInput, DeviceError
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.analogy import Analogy, level_animation, synthesizer
from pipeline.methods.analogy.guided_stills import guided_still_params, guided_still_schedule, stretch_of_guides
from pipeline.methods.analogy.key_intervals import MAX_INTERVAL_FRAMES, interval_key, split_intervals
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import SweepTask, fine_levels, plan_synthesis, run_frames
from pipeline.methods.analogy.style_images import DEFAULT_PAIR, energy_of, paint_in_strokes
from pipeline.methods.base import VideoInfo
from pipeline.methods.local import LocalContext, run_plan
from pipeline.scenes import scene
from pipeline.scenes.shot import shot_files
from pipeline.synthesis import sweeps
from pipeline.synthesis.device_memory import operations
from pipeline.synthesis.refine import Rounds, refine
from pipeline.synthesis.sweeps import FirstFrame, SearchSchedule
from tests.pipeline.methods.frames import painted

pytestmark = pytest.mark.real("opencl")

SIZE = (96, 72)
QUICK = {"levels": 3, "iterations": 3}


@cache
def shot(count: int = 6) -> list[Frame]:
    made = scene("shapes", SIZE, frames=24, fps=24)
    return [made.image(index) for index in range(count)]


@cache
def painting() -> Frame:
    return paint_in_strokes(scene("portrait", (480, 320), frames=1).image(0))[40:200, 60:260].copy()


def rendered(inputs: dict[str, Any] | None = None, frames: list[Frame] | None = None, **params: Any) -> np.ndarray:
    chosen = method("analogy")
    given = {"style_output": [painting()]} if inputs is None else inputs
    context = LocalContext(parse_params(chosen, QUICK | params), frames or shot(), given)
    run_plan(chosen, context)
    return painted(context)


def palette(*pictures: np.ndarray) -> set[bytes]:
    return {colour.tobytes() for picture in pictures for colour in np.unique(picture[..., :3].reshape(-1, 3), axis=0)}


@pytest.mark.parametrize("params", [{}, {"rotation": "on"}, {"temporal": "off"}, {"colours": "lab"}], ids=str)
def test_every_output_colour_is_a_colour_of_the_style(params: dict[str, Any]) -> None:
    assert palette(rendered(**params)) <= palette(painting())


def test_a_scaled_painting_moves_by_fractions_of_a_pixel() -> None:
    """Each frame of a pan by half a pixel per frame is the one before it, moved by half a pixel.

    With `stroke_scale=0` pixels are copied, and jump by whole pixels. Both have colours of the painting only.
    """
    wide = cv2.GaussianBlur(shot()[0], (0, 0), 1)
    pan = [
        cv2.warpAffine(wide, np.array([[1, 0, 0.5 * k], [0, 1, 0]], np.float32), SIZE, borderMode=cv2.BORDER_REFLECT)
        for k in range(5)
    ]
    flicker = {}
    for scale in (1, 0):
        out = rendered(frames=pan, stroke_scale=scale)
        assert palette(out) <= palette(painting())
        moved = (out[:-1, :, 1:].astype(float) + out[:-1, :, :-1]) / 2
        flicker[scale] = np.abs(out[1:, :, 1:] - moved).mean()
    assert flicker[1] < 0.6 * flicker[0]


def test_the_result_correlates_with_the_scene() -> None:
    out, source = rendered()[2].astype(float).mean(-1), shot()[2].astype(float).mean(-1)
    assert np.corrcoef(out.ravel(), source.ravel())[0, 1] > 0.6


def test_a_still_shot_flickers_less_than_independent_frames() -> None:
    still = [shot()[0]] * 4
    coherent, independent = (
        np.abs(np.diff(rendered(frames=still, temporal=t).astype(int), axis=0)).mean() for t in ("on", "off")
    )
    assert coherent < 0.2 * independent


def test_the_number_of_threads_that_estimate_motion_does_not_change_the_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = []
    for ahead in (1, 4):
        monkeypatch.setattr(level_animation, "_AHEAD", ahead)
        frames.append(rendered())
    assert np.array_equal(*frames)


def test_a_single_frame_is_synthesised() -> None:
    assert rendered(frames=shot()[:1]).shape == (1, SIZE[1], SIZE[0], 3)


def test_the_occlusion_term_reduces_trails() -> None:
    """Disoccluded background, known from exact masks, does not keep the paint of the object in front of it."""
    from benchmarks.analogy_claims import trail

    made = scene("shapes", (160, 120), frames=6, fps=12)
    files = dict(shot_files(made))
    del files["shot.json"]
    source = [made.image(index) for index in range(6)]
    errors = {}
    for name in ("on", "off"):
        given = {"style": source[:1], "style_output": source[:1], "video.entries": files}
        errors[name] = trail(made, source, list(rendered(given, source, occlusion=name, steadiness=20)))
    assert errors["on"] < 0.85 * errors["off"]


def test_on_twos_each_painting_is_shown_for_two_frames_and_keyframes_keep_theirs() -> None:
    ones, twos = rendered(frames=shot(5)), rendered(frames=shot(5), on_twos="on")
    np.testing.assert_array_equal(twos, ones[[0, 0, 2, 2, 4]])
    keys = {1: key(1, 1), 4: key(4, 1)}
    out = rendered({"keyframes": keys}, shot(6), on_twos="on")
    np.testing.assert_array_equal(out[1], keys[1])
    np.testing.assert_array_equal(out[4], keys[4])


def test_boil_adds_flicker_that_is_reproducible() -> None:
    still = [shot()[0]] * 4
    coherent, boiling, again = (rendered(frames=still, boil=b) for b in (0.0, 0.7, 0.7))
    np.testing.assert_array_equal(boiling, again)
    flicker = [np.abs(np.diff(out.astype(int), axis=0)).mean() for out in (coherent, boiling)]
    assert flicker[1] > 3 * flicker[0]
    assert palette(boiling) <= palette(painting())


# -- keyframes


def key(index: int, shift: int) -> Frame:
    """A painting of a frame: its channels rolled by `shift`, and its colours quantised."""
    return np.ascontiguousarray(np.roll(shot(12)[index], shift, axis=-1) // 16 * 16)


def test_keyframes_are_reproduced_exactly_and_are_the_only_style() -> None:
    keys = {2: key(2, 1), 7: key(7, 1)}
    plain, blended = (rendered({"keyframes": keys}, shot(10), **given) for given in ({"key_blend": 0}, {}))
    for index, image in keys.items():
        np.testing.assert_array_equal(plain[index], image)
        np.testing.assert_array_equal(blended[index], image)
    assert palette(plain) <= palette(*keys.values())
    np.testing.assert_array_equal(blended[[0, 1, 8, 9]], plain[[0, 1, 8, 9]])
    assert (blended[3:7] != plain[3:7]).any(), "the default blends between the keyframes"


def test_the_default_style_is_painted_only_if_there_is_no_keyframe() -> None:
    cut = [*shot(6), *(255 - frame for frame in shot(6))]
    for keys, expected in (({2: key(2, 1), 9: key(9, 1)}, False), ({2: key(2, 1)}, False), ({}, True)):
        chosen = method("analogy")
        context = LocalContext(parse_params(chosen, QUICK), cut, {"keyframes": keys} if keys else {})
        run_plan(chosen, context)
        assert (("scan", DEFAULT_PAIR) in context.kept) == expected, context.results["scan"]


def test_blending_two_keyframes_keeps_them_and_makes_the_change_between_them_gradual() -> None:
    """The second keyframe is brighter by 60: without blending, every pixel jumps from one to the other."""
    still = [shot()[0]] * 9
    first = np.minimum(key(0, 1), 180)
    keys = {0: first, 8: first + 60}
    plain, blended = (rendered({"keyframes": keys}, still, **given) for given in ({"key_blend": 0}, {}))
    for index, image in keys.items():
        np.testing.assert_array_equal(blended[index], image)
    assert palette(plain) <= palette(*keys.values())
    jumps = [np.abs(np.diff(out.astype(int).mean(-1), axis=0)).max(0).mean() for out in (plain, blended)]
    assert jumps[1] < 0.5 * jumps[0]
    means = blended.mean((1, 2, 3)) - first.mean()
    np.testing.assert_allclose(means, np.linspace(0, 60, 9), atol=6)


def test_painted_pixels_of_a_partial_keyframe_are_exact_and_the_others_are_synthesised() -> None:
    alpha = np.zeros((SIZE[1], SIZE[0], 1), np.uint8)
    alpha[20:60, 10:80] = 255
    image = np.dstack([key(3, 1), alpha])
    out = rendered({"keyframes": {3: image}}, shot(6))
    np.testing.assert_array_equal(out[3][20:60, 10:80], image[20:60, 10:80, :3])
    assert palette(out) <= palette(image[20:60, 10:80])


def drawn(frames: list[Frame]) -> list[Frame]:
    """Line drawings of frames: contours are black."""
    return [np.where(cv2.Canny(f, 50, 150)[..., None] > 0, 0, 255).astype(np.uint8).repeat(3, 2) for f in frames]


@pytest.mark.parametrize("both", [False, True], ids=["keyframes only", "keyframes and a painting"])
def test_keyframes_with_lines_are_reproducible(both: bool) -> None:
    keys = {1: key(1, 1), 5: key(5, 1)}
    inputs: dict[str, Any] = {"keyframes": keys, "lines": drawn(shot(7))}
    if both:
        inputs |= {"style_output": [painting()], "style_lines": drawn([painting()])}
    first, second = rendered(inputs, shot(7)), rendered(inputs, shot(7))
    np.testing.assert_array_equal(first, second)
    for index, image in keys.items():
        np.testing.assert_array_equal(first[index], image)
    assert (first != rendered(inputs | {"lines": drawn(shot(8)[1:])}, shot(7))).any()


def test_the_change_at_a_keyframe_is_no_larger_than_elsewhere() -> None:
    out = rendered({"keyframes": {0: key(0, 1), 6: key(6, 1), 11: key(11, 1)}}, shot(12)).astype(int)
    steps = np.abs(np.diff(out, axis=0)).mean((1, 2, 3))
    assert max(steps[5:7]) < 1.5 * np.median(steps)


@pytest.mark.parametrize(
    ("keys", "field", "word"),
    [
        ({9: np.zeros((SIZE[1], SIZE[0], 3), np.uint8)}, "inputs.keyframes", "9"),
        ({1: np.zeros((10, 20, 3), np.uint8)}, "inputs.keyframes", "20x10"),
        ({1: np.zeros((SIZE[1], SIZE[0], 4), np.uint8)}, "inputs.keyframes", "transparent"),
    ],
    ids=["no such frame", "another size", "nothing painted"],
)
def test_an_invalid_keyframe_is_reported(keys: dict[int, np.ndarray], field: str, word: str) -> None:
    with pytest.raises(BadInput) as caught:
        rendered({"keyframes": keys})
    assert caught.value.field == field and word in str(caught.value) and caught.value.remedy


@pytest.mark.parametrize(
    ("begin", "end", "keys"),
    [
        (0, 10, [(0, True), (9, True)]),
        (5, 300, [(100, True)]),
        (0, 200, [(10, True), (180, True)]),
        (3, 9, [(5, False)]),
    ],
    ids=str,
)
def test_intervals_emit_every_frame_once_and_start_from_their_neighbour(
    begin: int, end: int, keys: list[tuple[int, bool]]
) -> None:
    found = dict(split_intervals(begin, end, keys))
    emitted = sorted(index for interval in found.values() for index in range(interval.first, interval.last))
    assert emitted == list(range(begin, end))
    for interval in found.values():
        assert (
            interval.start
            <= interval.first
            < interval.last
            <= interval.stop
            <= interval.start + MAX_INTERVAL_FRAMES + 1
        )
        assert interval.keys
        for index, start in interval.fixed:
            other = found[interval_key(start)]
            assert index in (other.start, other.last)
            assert interval.start <= index < interval.stop
    keys_in_order = list(found)
    for number, interval in enumerate(found.values()):
        assert {interval_key(start) for _, start in interval.fixed} <= set(keys_in_order[:number])


def test_a_keyframe_at_the_end_is_emitted_by_the_interval_before_it() -> None:
    parts = [interval for _, interval in split_intervals(0, 11, [(0, True), (10, True)])]
    assert [(part.first, part.last, part.keys) for part in parts] == [(0, 11, (0, 10))]


@pytest.mark.parametrize("end", [53, 96, 97, 150, 301])
def test_a_long_gap_is_continued_from_both_keyframes(end: int) -> None:
    """Each part but the middle one follows a keyframe or a part nearer to it; the middle part has both ends fixed."""
    parts = [part for _, part in split_intervals(0, end + 1, [(0, True), (end, True)]) if part.first < end]
    both = [part for part in parts if {part.start, part.last} <= {0, end} | {index for index, _ in part.fixed}]
    assert len(both) == 1 and both[0].last - both[0].first == MAX_INTERVAL_FRAMES
    assert abs(both[0].first - (end - both[0].last)) <= 1


def test_a_gap_in_parts_has_exact_keyframes_and_reaches_the_far_one_without_a_jump(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    keys = {0: key(0, 1), 11: key(11, 2)}
    monkeypatch.setattr("pipeline.methods.analogy.key_intervals.MAX_INTERVAL_FRAMES", 5)
    monkeypatch.setattr("pipeline.methods.analogy.key_intervals._MIN_INTERVAL_FRAMES", 5)
    out = rendered({"keyframes": keys}, shot(12))
    for index, image in keys.items():
        np.testing.assert_array_equal(out[index], image)
    near = [np.abs(out[index].astype(int) - keys[nearest]).mean() for index, nearest in ((2, 0), (9, 11))]
    far = [np.abs(out[index].astype(int) - keys[farthest]).mean() for index, farthest in ((2, 11), (9, 0))]
    assert max(near) < 0.7 * min(far)


# -- style and guides


def test_a_style_input_without_a_painting_is_rejected() -> None:
    with pytest.raises(BadInput) as caught:
        rendered({"style": [painting()]})
    assert caught.value.field == "inputs.style_output"


def test_a_style_pair_of_different_sizes_is_rejected() -> None:
    with pytest.raises(BadInput) as caught:
        rendered({"style_output": [painting()], "style": [painting()[:50]]})
    assert caught.value.field == "inputs.style" and "200x160" in caught.value.remedy


def test_a_guide_determines_the_positions_in_the_style() -> None:
    """The guide is dark in the left half of the style and bright in the right half, and selects between the two."""
    style = np.zeros((64, 96, 3), np.uint8)
    style[:, :48], style[:, 48:] = (200, 40, 40), (40, 40, 200)
    style_guide = np.where(np.arange(96) < 48, 0, 255).astype(np.uint8)[None, :, None].repeat(64, 0).repeat(3, 2)
    guide = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    guide[:30] = 255
    out = rendered(
        {"style_output": [style], "style_guide_a": [style_guide], "guide_a": [guide]},
        shot()[:1], guide_weight=0, guide_a_weight=4,
    )[0]  # fmt: skip
    assert (out[:26, :, 2] == 200).mean() > 0.97 and (out[34:, :, 0] == 200).mean() > 0.97


def test_hues_that_must_be_raised_beyond_the_limit_of_contrast_count_less(monkeypatch: pytest.MonkeyPatch) -> None:
    weights: list[float] = []

    def recorded(params: AnalogyParams, *args: Any, **more: Any) -> Any:
        weights.append(params.colour_weight)
        return energy_of(params, *args, **more)

    monkeypatch.setattr(synthesizer, "energy_of", recorded)
    frame, few = shot()[0], {"levels": 1, "iterations": 1, "colour_weight": 0.8}
    faint = np.rint(128 + 0.1 * (frame.astype(float) - 128)).astype(np.uint8)
    for given in (frame, faint):
        rendered({"style_output": [frame]}, [given], **few)
    assert weights[0] == 0.8 and weights[-1] < 0.4
    rendered({"style_output": [frame]}, [faint], tone_match="off", **few)
    assert weights[-1] == 0.8


def test_a_still_with_guides_has_settings_of_its_own_and_a_video_does_not() -> None:
    """The set values are scaled, so that they keep their effect."""
    plain, guides = shot()[:1], {"style_output": [painting()], "style": [painting()]}
    own = rendered(guides, plain)
    assert not np.array_equal(own, rendered(guides, plain, guided_stills="off"))
    assert not np.array_equal(own, rendered(guides, plain, texture_weight=4))
    assert np.array_equal(rendered(None, plain), rendered(None, plain, guided_stills="off"))
    few = {"temporal": "off", "levels": 2, "iterations": 1}
    assert np.array_equal(*(rendered(guides, shot(2), guided_stills=value, **few) for value in ("auto", "off")))
    assert Analogy().single_frame_params(AnalogyParams()).guided_stills == "off"


def test_coherence_and_variety_count_less_where_guides_change_faster_than_in_the_style() -> None:
    y, x = np.mgrid[:128, :128]
    guide = np.rint(127 + 100 * np.sin(x / 20) * np.cos(y / 25)).astype(np.uint8)[..., None]
    halved_guide = np.rint(127 + 100 * np.sin(x / 10) * np.cos(y / 12.5)).astype(np.uint8)[..., None]
    assert stretch_of_guides(guide, guide, (1.0,)) == 1
    assert stretch_of_guides(halved_guide, guide, (1.0,)) == pytest.approx(4, rel=0.2)
    both = np.concatenate([halved_guide, guide], -1), np.concatenate([guide, guide], -1)
    assert 1 < stretch_of_guides(*both, (1.0, 4.0)) < stretch_of_guides(*both, (4.0, 1.0)) < 4
    assert stretch_of_guides(guide, np.zeros_like(guide), (1.0,)) == 1
    equal, stretched = (guided_still_params(AnalogyParams(), stretch) for stretch in (0.5, 4.0))
    assert equal == guided_still_params(AnalogyParams(), 1.0)
    assert stretched.coherence_weight == pytest.approx(equal.coherence_weight / 8)
    assert stretched.variety_weight == pytest.approx(equal.variety_weight / 8)
    assert guided_still_params(AnalogyParams(variety_weight=900), 4.0).variety_weight == 900
    assert (equal.search_radius, stretched.search_radius) == (16, 128)


def test_a_guided_still_has_fewer_rounds_and_a_near_search_at_the_finest_level() -> None:
    schedule, params = SearchSchedule(6, 128.0, 3, 4), AnalogyParams()
    finest, coarser, third = (guided_still_schedule(schedule, params, level, False) for level in range(3))
    assert finest == replace(schedule, first=FirstFrame(3, 4.0, 1, near=True), settles=True)
    assert coarser == replace(schedule, first=FirstFrame(6, 128.0, 1, near=True), settles=True, votes=True)
    assert third == replace(coarser, first=FirstFrame(6, 128.0, 1))
    assert guided_still_schedule(schedule, params, 2, coarsest=True) == replace(schedule, votes=True)
    assert guided_still_schedule(schedule, params, 0, coarsest=True) == schedule
    wide = guided_still_schedule(schedule, AnalogyParams(search_radius=640), 0, False)
    assert wide.first is not None and wide.first.search_px == 20


def test_the_rounds_of_a_guided_still_are_those_of_its_schedule(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Rounds] = []

    def recorded(*args: Any) -> Any:
        made.append(args[-1])
        return refine(*args)

    monkeypatch.setattr(sweeps, "refine", recorded)
    rendered({"style_output": [painting()], "style": [painting()]}, shot()[:1], levels=1, iterations=4)
    assert [(rounds.count, rounds.votes) for rounds in made] == [(12, True), (3, False)]  # this picture has two levels
    assert [rounds.near for rounds in made] == [False, True]
    assert made[-1].search_px == 4


def test_a_guide_without_style_counterpart_is_rejected() -> None:
    with pytest.raises(BadInput) as caught:
        rendered({"style_output": [painting()], "guide_b": shot()})
    assert caught.value.field == "inputs.style_guide_b"


def test_lines_are_drawn_with_the_strokes_of_the_style() -> None:
    """The dark stroke in the middle of a uniform style appears at the line of the video."""
    style = np.full((64, 96, 3), 220, np.uint8)
    style[:, 44:52] = (90, 20, 20)
    marks = np.full_like(style, 255)
    marks[:, 47:49] = 0
    drawn = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    drawn[:, 30:32] = 0
    flat = np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)
    out = rendered(
        {"style_output": [style], "style_lines": [marks], "lines": [drawn]}, [flat], guide_weight=0, lines_weight=400
    )[0]
    dark = (out[..., 0] == 90).mean(0)
    assert dark[28:34].min() > 0.9 and dark[:20].max() < 0.1 and dark[42:].max() < 0.1


def test_lines_without_style_lines_are_rejected() -> None:
    with pytest.raises(BadInput) as caught:
        rendered({"style_output": [painting()], "lines": shot()})
    assert caught.value.field == "inputs.style_lines"


def test_given_directions_rotate_the_strokes_of_the_style() -> None:
    """A style of vertical stripes becomes horizontal stripes where the directions of the frame are horizontal."""
    style = np.full((96, 96, 3), 220, np.uint8)
    style[:, np.arange(96) % 8 < 4] = (90, 20, 20)
    upright, level = np.full_like(style, 128), np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)
    upright[..., 1], level[..., 0] = 255, 255
    flat = [np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)]
    given = {"style_output": [style], "directions": [level], "style_directions": [upright]}
    plain = rendered({"style_output": [style]}, flat, guide_weight=0)[0].astype(int)
    turned = rendered(given, flat, guide_weight=0)[0]
    along_x, along_y = (np.abs(np.diff(turned[8:-8, 8:-8].astype(int), axis=axis)).mean() for axis in (1, 0))
    assert along_y > 4 * along_x
    assert np.abs(np.diff(plain, axis=1)).mean() > 4 * np.abs(np.diff(plain, axis=0)).mean()


def test_keyframes_with_given_directions_are_reproduced() -> None:
    """Directions are halved with the frames of an interval at every level."""
    level = np.full((SIZE[1], SIZE[0], 3), (255, 128, 0), np.uint8)
    keys = {0: shot()[0][..., ::-1], 5: shot()[5][..., ::-1]}
    found = rendered({"keyframes": keys, "directions": [level] * 6}, levels=2)
    np.testing.assert_array_equal(found[[0, 5]], np.stack(list(keys.values())))


def test_directions_of_another_size_are_rejected() -> None:
    with pytest.raises(BadInput) as caught:
        rendered({"style_output": [painting()], "directions": [shot()[0][:20]] * 6})
    assert caught.value.field == "inputs.directions"


def test_the_sweeps_can_run_in_the_order_of_the_paper() -> None:
    chosen = method("analogy")
    last = {}
    for order in ("backward-first", "forward-first"):
        params = parse_params(chosen, QUICK | {"sweep_order": order})
        context = LocalContext(params, shot(), {"style_output": [painting()]})
        last[order] = run_plan(chosen, context)["synthesise"][-1].args["forward"]
        assert palette(painted(context)) <= palette(painting())
    assert last == {"backward-first": True, "forward-first": False}


@pytest.mark.parametrize(("rows", "fine"), [(719, 0), (720, 3)])
def test_large_frames_are_refined_fast(rows: int, fine: int) -> None:
    params = parse_params(method("analogy"), {})
    assert fine_levels(params, (1280, rows)) == fine


@pytest.mark.parametrize(
    ("params", "expected"),
    [
        ({}, [2, 2]),
        ({"refinement": "fast"}, [2, 1]),
        ({"refinement": "full"}, [2, 2]),
        ({"refinement": "fast", "sweeps": 2}, [4, 4]),
        ({"refinement": "fast", "sweep_order": "forward-first"}, [2, 2]),
    ],
    ids=str,
)
def test_fine_levels_have_one_forward_sweep_unless_more_is_asked_for(
    params: dict[str, Any], expected: list[int]
) -> None:
    tasks = plan_synthesis(scanned_plan(QUICK | {"levels": 2} | params))
    found = [SweepTask(**task.args) for task in tasks]
    assert [sum(sweep.level == level for sweep in found) for level in (1, 0)] == expected
    assert found[-1].last and found[-1].fine == (params == {"refinement": "fast"})


def scanned_plan(params: dict[str, Any]) -> Any:
    """What the plan of six frames depends on, after the scan of a shot without keyframes."""
    scan = {"video": {"frames": 6, "cuts": [], "keys": [], "layers": []}}
    video = VideoInfo(*SIZE, 6, 25.0, 6 / 25)
    return SimpleNamespace(params=parse_params(method("analogy"), params), video=video, results={"scan": scan})


def test_frames_that_continue_the_frame_before_have_fewer_rounds_than_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rounds: list[tuple[tuple[int, int], int]] = []
    fine: list[tuple[float, bool, int | None]] = []

    def counted(*args: Any) -> Any:
        size, given = args[2].size, args[-1]
        rounds.append((size, given.count))
        if size == SIZE:
            fine.append((given.search_px, given.near, given.full_rounds))
        return refine(*args)

    monkeypatch.setattr(sweeps, "refine", counted)
    rendered(iterations=4, refinement="fast")
    assert [count for size, count in rounds if size == SIZE] == [8, 2, 2, 2, 2, 2]
    assert [count for size, count in rounds if size != SIZE] == [8] * 6 + [2] * 5
    assert fine == [(16, False, 4)] + [(2, True, None)] * 5, "search radius, direct neighbours only, rounds everywhere"


def test_the_steadiness_of_coarse_levels_is_a_parameter() -> None:
    weights = {
        factor: [energy_of(AnalogyParams(steadiness=2, coarse_steadiness=factor), (), level).w_tc for level in range(3)]
        for factor in (0.25, 1.0)
    }
    assert weights == {0.25: [2, 0.5, 0.125], 1.0: [2, 2, 2]}


def test_a_preview_of_half_size_has_strokes_of_half_size() -> None:
    """The painting is scaled with the frame: its stripes keep their share of the picture."""
    style = np.full((160, 200, 3), 200, np.uint8)
    style[:, np.arange(200) % 16 < 8] = (150, 60, 60)
    widths = []
    for size in ((96, 72), (192, 144)):
        frames = [np.full((size[1], size[0], 3), 128, np.uint8)]
        out = rendered({"style_output": [style]}, frames, guide_weight=0)[0, ..., 1] > 130
        widths.append(size[0] / np.abs(np.diff(out.astype(int), axis=1)).sum(1).mean())
    assert 1.7 < widths[1] / widths[0] < 2.3


@pytest.mark.parametrize("params", [{}, {"rotation": "on", "variety_weight": 50}, {"temporal": "off"}], ids=str)
def test_a_frame_that_exceeds_device_memory_is_synthesised_in_bands_with_the_same_bytes(
    params: dict[str, Any], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    params = params | {"stroke_scale": 0}
    whole = rendered(**params)
    monkeypatch.setattr(device(), "memory_bytes", SMALL_BYTES)
    with caplog.at_level("WARNING", "pipeline"):
        np.testing.assert_array_equal(rendered(**params), whole)
    assert "96x72" in caplog.text and "in 2 bands" in caplog.text


SMALL_BYTES = 2_250_000
"""Memory of a device that holds the painting and half a frame."""


def test_keyframes_are_exact_in_bands(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    keys = {0: key(0, 1), 3: key(3, 1)}
    whole = rendered({"keyframes": keys}, shot(4), rotation="on")
    monkeypatch.setattr(device(), "memory_bytes", 1_750_000)
    with caplog.at_level("WARNING", "pipeline"):
        banded = rendered({"keyframes": keys}, shot(4), rotation="on")
    assert "in 2 bands" in caplog.text
    np.testing.assert_array_equal(banded, whole)
    assert all((banded[index] == image).all() for index, image in keys.items())


def test_a_style_that_exceeds_device_memory_is_rejected() -> None:
    small = cast(Device, SimpleNamespace(name="a GPU", memory_bytes=16 << 20))
    style = np.zeros((800, 1000, 3), np.uint8)
    with pytest.raises(DeviceError, match="1920x1080") as caught:
        operations(small, (1920, 1080), style, 20)
    assert "16 MiB" in str(caught.value) and caught.value.remedy


def test_the_coarse_levels_of_a_short_shot_are_one_task() -> None:
    chosen = method("analogy")
    context = LocalContext(parse_params(chosen, QUICK), shot(), {"style_output": [painting()]})
    tasks = run_plan(chosen, context)["synthesise"]
    assert len(tasks) == 5 and len(tasks[0].args["earlier"]) == 1
    assert not [name for _, name in context.kept if name.endswith("-edge")], "no artefact is saved that no task loads"


def test_runs_of_coarse_levels_have_more_frames_and_consist_of_whole_fine_runs() -> None:
    scan = {"video": {"frames": 40, "cuts": [], "keys": [], "layers": []}}
    video = VideoInfo(1920, 1080, 40, 25.0, 40 / 25)
    params = parse_params(method("analogy"), {})
    tasks = plan_synthesis(SimpleNamespace(params=params, video=video, results={"scan": scan}))
    sweeps_by_key = {task.key: SweepTask(**task.args) for task in tasks}
    frames = {level: {s.stop - s.start for s in sweeps_by_key.values() if s.level == level} for level in range(4)}
    assert frames == {3: {28, 12}, 2: {28, 12}, 1: {7, 5}, 0: {7, 5}}
    for sweep in sweeps_by_key.values():
        before = sweeps_by_key.get(sweep.previous, sweep)
        assert before.start <= sweep.start and sweep.stop <= before.stop, "one task has all frames of the sweep before"
    assert all(set(task.after) <= sweeps_by_key.keys() for task in tasks)


def test_the_length_of_a_run_depends_on_the_frame_size() -> None:
    assert run_frames((320, 180)) == 32 and 2 <= run_frames((3840, 2160)) < run_frames((1920, 1080)) < 32
