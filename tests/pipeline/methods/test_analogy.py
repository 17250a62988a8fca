"""Analogy: nothing but the style's colours, keys as painted, steadier than frame by frame, trails gone with chi."""

from __future__ import annotations

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
from pipeline.methods.analogy.device_memory import operations
from pipeline.methods.analogy.exemplar import paint_in_strokes
from pipeline.methods.analogy.interval import MAX_INTERVAL_FRAMES, split_intervals
from pipeline.methods.analogy.plan import run_frames
from pipeline.methods.local import LocalContext, run_plan
from pipeline.scenes import scene
from pipeline.scenes.shot import shot_files
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
def test_every_colour_of_the_result_is_one_of_the_style(params: dict[str, Any]) -> None:
    assert palette(rendered(**params)) <= palette(painting())


def test_the_scene_reads_in_the_paint() -> None:
    out, source = rendered()[2].astype(float).mean(-1), shot()[2].astype(float).mean(-1)
    assert np.corrcoef(out.ravel(), source.ravel())[0, 1] > 0.6


def test_frames_of_a_shot_are_steadier_than_frames_on_their_own() -> None:
    still = [shot()[0]] * 4
    held, alone = (
        np.abs(np.diff(rendered(frames=still, temporal=t).astype(int), axis=0)).mean() for t in ("on", "off")
    )
    assert held < 0.2 * alone


def test_a_still_is_a_clip_of_one_frame() -> None:
    assert rendered(frames=shot()[:1]).shape == (1, SIZE[1], SIZE[0], 3)


def test_trails_vanish_with_the_occlusion_term() -> None:
    """Of exact masks: where the background has just come out, what was in front of it is not held on to."""
    from benchmarks.analogy_claims import trail

    made = scene("shapes", (160, 120), frames=6, fps=12)
    files = dict(shot_files(made))
    del files["shot.json"]
    source = [made.image(index) for index in range(6)]
    wrong = {}
    for name in ("on", "off"):
        given = {"style": source[:1], "style_output": source[:1], "video.entries": files}
        wrong[name] = trail(made, source, list(rendered(given, source, occlusion=name, steadiness=20)))
    assert wrong["on"] < 0.85 * wrong["off"]


def test_on_twos_each_painting_is_shown_for_two_frames_and_keys_stay() -> None:
    ones, twos = rendered(frames=shot(5)), rendered(frames=shot(5), on_twos="on")
    np.testing.assert_array_equal(twos, ones[[0, 0, 2, 2, 4]])
    keys = {1: key(1, 1), 4: key(4, 1)}
    out = rendered({"keyframes": keys}, shot(6), on_twos="on")
    np.testing.assert_array_equal(out[1], keys[1])
    np.testing.assert_array_equal(out[4], keys[4])


def test_boil_is_deliberate_flicker_that_repeats_exactly() -> None:
    still = [shot()[0]] * 4
    held, boiling, again = (rendered(frames=still, boil=b) for b in (0.0, 0.7, 0.7))
    np.testing.assert_array_equal(boiling, again)
    flicker = [np.abs(np.diff(out.astype(int), axis=0)).mean() for out in (held, boiling)]
    assert flicker[1] > 3 * flicker[0]
    assert palette(boiling) <= palette(painting())


# -- keyframes


def key(index: int, shift: int) -> Frame:
    """A painting over a frame: its colours turned and coarsened."""
    return np.ascontiguousarray(np.roll(shot(12)[index], shift, axis=-1) // 16 * 16)


def test_painted_keys_are_matched_and_nothing_else_is_used() -> None:
    keys = {2: key(2, 1), 7: key(7, 1)}
    out = rendered({"keyframes": keys}, shot(10))
    for index, image in keys.items():
        np.testing.assert_array_equal(out[index], image)
    assert palette(out) <= palette(*keys.values())


def test_what_is_painted_of_a_partial_key_is_matched_and_the_rest_is_found() -> None:
    alpha = np.zeros((SIZE[1], SIZE[0], 1), np.uint8)
    alpha[20:60, 10:80] = 255
    image = np.dstack([key(3, 1), alpha])
    out = rendered({"keyframes": {3: image}}, shot(6))
    np.testing.assert_array_equal(out[3][20:60, 10:80], image[20:60, 10:80, :3])
    assert palette(out) <= palette(image[20:60, 10:80])


def drawn(frames: list[Frame]) -> list[Frame]:
    """Line art of frames: black where a contour is."""
    return [np.where(cv2.Canny(f, 50, 150)[..., None] > 0, 0, 255).astype(np.uint8).repeat(3, 2) for f in frames]


@pytest.mark.parametrize("both", [False, True], ids=["keys alone", "a painting as well"])
def test_keys_and_lines_together_give_the_same_bytes_again(both: bool) -> None:
    keys = {1: key(1, 1), 5: key(5, 1)}
    inputs: dict[str, Any] = {"keyframes": keys, "lines": drawn(shot(7))}
    if both:
        inputs |= {"style_output": [painting()], "style_lines": drawn([painting()])}
    first, second = rendered(inputs, shot(7)), rendered(inputs, shot(7))
    np.testing.assert_array_equal(first, second)
    for index, image in keys.items():
        np.testing.assert_array_equal(first[index], image)
    assert (first != rendered(inputs | {"lines": drawn(shot(8)[1:])}, shot(7))).any()


def test_the_step_across_a_key_is_no_larger_than_elsewhere() -> None:
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
def test_a_wrong_key_is_named(keys: dict[int, np.ndarray], field: str, word: str) -> None:
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
def test_pieces_cover_a_shot_once_and_hold_on_to_their_neighbours(
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
        if interval.task:
            other = found[interval.task]
            assert interval.held in (other.start, other.last) and interval.start <= interval.held < interval.stop


# -- style and guides


def test_a_style_without_its_painting_is_refused() -> None:
    with pytest.raises(BadInput) as caught:
        rendered({"style": [painting()]})
    assert caught.value.field == "inputs.style_output"


def test_a_pair_of_two_sizes_is_refused() -> None:
    with pytest.raises(BadInput) as caught:
        rendered({"style_output": [painting()], "style": [painting()[:50]]})
    assert caught.value.field == "inputs.style" and "200x160" in caught.value.remedy


def test_a_guide_of_the_users_decides_what_goes_where() -> None:
    """The style's left half is marked dark, its right half bright; so the mark puts either where it is asked for."""
    style = np.zeros((64, 96, 3), np.uint8)
    style[:, :48], style[:, 48:] = (200, 40, 40), (40, 40, 200)
    mark = np.where(np.arange(96) < 48, 0, 255).astype(np.uint8)[None, :, None].repeat(64, 0).repeat(3, 2)
    wish = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    wish[:30] = 255
    out = rendered(
        {"style_output": [style], "style_guide_a": [mark], "guide_a": [wish]},
        shot()[:1], guide_weight=0, guide_a_weight=4,
    )[0]  # fmt: skip
    assert (out[:26, :, 2] == 200).mean() > 0.97 and (out[34:, :, 0] == 200).mean() > 0.97


def test_a_guide_without_its_counterpart_is_refused() -> None:
    with pytest.raises(BadInput) as caught:
        rendered({"style_output": [painting()], "guide_b": shot()})
    assert caught.value.field == "inputs.style_guide_b"


def test_lines_are_drawn_with_the_strokes_of_the_style() -> None:
    """A dark stroke down the middle of an even style: it goes where the video's line is."""
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


def test_lines_of_the_video_alone_are_refused() -> None:
    with pytest.raises(BadInput) as caught:
        rendered({"style_output": [painting()], "lines": shot()})
    assert caught.value.field == "inputs.style_lines"


@pytest.mark.parametrize("params", [{}, {"rotation": "on", "variety_weight": 50}, {"temporal": "off"}], ids=str)
def test_a_frame_that_does_not_fit_is_painted_in_bands_to_the_same_bytes(
    params: dict[str, Any], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    whole = rendered(**params)
    monkeypatch.setattr(device(), "memory_bytes", SMALL_BYTES)
    with caplog.at_level("WARNING", "pipeline"):
        np.testing.assert_array_equal(rendered(**params), whole)
    assert "96x72" in caplog.text and "in 2 bands" in caplog.text


SMALL_BYTES = 2_250_000
"""Of a device on which the painting and half a frame fit."""


def test_keyframes_are_matched_in_bands_as_well(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    keys = {0: key(0, 1), 3: key(3, 1)}
    whole = rendered({"keyframes": keys}, shot(4), rotation="on")
    monkeypatch.setattr(device(), "memory_bytes", 1_750_000)
    with caplog.at_level("WARNING", "pipeline"):
        banded = rendered({"keyframes": keys}, shot(4), rotation="on")
    assert "in 2 bands" in caplog.text
    np.testing.assert_array_equal(banded, whole)
    assert all((banded[index] == image).all() for index, image in keys.items())


def test_what_does_not_fit_into_the_device_in_any_way_is_said() -> None:
    small = cast(Device, SimpleNamespace(name="a card", memory_bytes=16 << 20))
    style = np.zeros((800, 1000, 3), np.uint8)
    with pytest.raises(DeviceError, match="1920x1080") as caught:
        operations(small, (1920, 1080), style, 20)
    assert "16 MiB" in str(caught.value) and caught.value.remedy


def test_the_coarse_levels_of_a_short_shot_are_one_task() -> None:
    chosen = method("analogy")
    context = LocalContext(parse_params(chosen, QUICK), shot(), {"style_output": [painting()]})
    tasks = run_plan(chosen, context)["synthesise"]
    assert len(tasks) == 5 and len(tasks[0].args["before"]) == 1
    assert not [name for _, name in context.kept if name.endswith("-edge")], "nothing is kept that no task asks for"


def test_a_run_has_as_many_frames_as_memory_allows() -> None:
    assert run_frames((320, 180)) == 32 and 2 <= run_frames((3840, 2160)) < run_frames((1920, 1080)) < 32
