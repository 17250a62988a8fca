"""The abstraction method: reproducible bytes, cuts, coherence, colour, SVG."""

from __future__ import annotations

import io
import re
import zipfile
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.colour.scheme import learn
from pipeline.colour.spaces import srgb_to_hsv, srgb_to_lab
from pipeline.errors import BadFrame, BadInput
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods import method
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession, plan
from pipeline.methods.abstraction.compositor import CompositedFrame
from pipeline.methods.abstraction.session import PipelinedRunner
from pipeline.methods.abstraction.sizes import sizes_of
from pipeline.methods.local import LocalContext, run_plan
from pipeline.scenes import SceneFrame, scene
from tests.pipeline.methods.frames import painted

SIZE = (96, 64)
CUT = 6
ABSTRACTION = method("abstraction")


@cache
def shots() -> list[Frame]:
    """Twelve frames with a hard cut in the middle."""
    made = scene("cut", SIZE, frames=2 * CUT, fps=10)
    return [made.image(index) for index in range(2 * CUT)]


def paint(frames: list[Frame], masks: dict[int, Plane] | None = None, **values: Any) -> list[CompositedFrame]:
    with PipelinedRunner(AbstractionSession(AbstractionParams(**values), SIZE)) as runner:
        return list(runner.run(frames, masks or {}))


def stacked(paintings: list[CompositedFrame]) -> NDArray[np.uint8]:
    return np.stack([painting.frame for painting in paintings])


# -- the same bytes


PALETTE = ("#101820", "#f4efe0", "#c0502a", "#2f6f8f", "#7aa05a")
VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "each frame on its own": {"temporal": "off"},
    "cuts by residuals alone": {"cut_sensitivity": 0},
    "lines off": {"lines": "off", "boundary_smoothing": 0},
    "broad red lines": {"line_colour": "#a02020", "line_width": 6},
    "the paper's own memory": {"steadiness": 0, "paint_memory": 0, "colour_half_life": 0, "importance_half_life": 0},
    "sharp edges": {"edges": "sharp"},
    "sharp edges, each frame on its own": {"edges": "sharp", "temporal": "off"},
    "sharp edges, cuts by residuals alone": {"edges": "sharp", "cut_sensitivity": 0},
    "sharp edges, broad red lines": {"edges": "sharp", "line_colour": "#a02020", "line_width": 6},
    "as printed": {"algorithm": "printed", "cut_sensitivity": 0},
    "a palette": {"palette": PALETTE},
    "sharp edges, a palette": {"edges": "sharp", "palette": PALETTE},
    "sharp edges, no memory": {"edges": "sharp", "paint_memory": 0, "boundary_smoothing": 0},
}


@pytest.mark.parametrize("values", VARIANTS.values(), ids=VARIANTS.keys())
def test_runs_of_any_length_equal_one_session(values: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "RUN_FRAMES", 4)
    session = AbstractionSession(AbstractionParams(**values), SIZE)
    wanted = np.stack([session.step(frame) for frame in shots()])
    context = LocalContext(AbstractionParams(**values), shots())
    tasks = run_plan(ABSTRACTION, context, shuffle=3)["abstract"]
    starts = sorted(task.emits[0] for task in tasks if task.emits)
    assert starts == ([0, 4, 8] if values.get("cut_sensitivity") == 0 else [0, 4, CUT, CUT + 4])
    np.testing.assert_array_equal(painted(context), wanted)


def test_runs_equal_one_session_with_reference_histogram_masks_and_svg(monkeypatch: pytest.MonkeyPatch) -> None:
    mask = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    mask[:, :40] = 255
    inputs = {"reference": [reds()], "importance": {1: mask, 7: mask[:, ::-1].copy()}}
    pages = []
    for run_frames in (96, 4):
        monkeypatch.setattr(plan, "RUN_FRAMES", run_frames)
        context = LocalContext(AbstractionParams(), shots(), inputs, artefacts=frozenset({"svg"}))
        run_plan(ABSTRACTION, context)
        pages.append((painted(context), svg_pages(context)))
    np.testing.assert_array_equal(pages[0][0], pages[1][0])
    assert pages[0][1] == pages[1][1] and len(pages[0][1]) == len(shots())


@pytest.mark.parametrize("at", [1, CUT - 1, CUT, CUT + 2])
@pytest.mark.parametrize("values", [{}, {"edges": "sharp"}, {"algorithm": "printed"}], ids=["soft", "sharp", "printed"])
def test_a_restored_session_continues_with_the_same_bytes(at: int, values: dict[str, Any]) -> None:
    params, scheme = AbstractionParams(**values), learn([reds()])
    one, two = (AbstractionSession(params, SIZE, scheme) for _ in range(2))
    for frame in shots()[:at]:
        one.step(frame)
    state = {key: array.copy() for key, array in one.state().items()}
    assert all(isinstance(array, np.ndarray) and array.dtype != object for array in state.values())
    two.restore(state)
    for frame in shots()[at:]:
        np.testing.assert_array_equal(one.step(frame), two.step(frame))


@pytest.mark.parametrize("edges", ["soft", "sharp"])
def test_a_state_is_not_changed_by_later_frames(edges: Any) -> None:
    session = AbstractionSession(AbstractionParams(edges=edges), SIZE)
    for frame in shots()[:3]:
        session.step(frame)
    state = session.state()
    kept = {key: array.copy() for key, array in state.items()}
    for frame in shots()[3:]:
        session.step(frame)
    for key, array in state.items():
        np.testing.assert_array_equal(array, kept[key])


@pytest.mark.parametrize("edges", ["soft", "sharp"])
def test_pipelining_and_opencv_threads_do_not_change_the_bytes(edges: Any) -> None:
    session = AbstractionSession(AbstractionParams(edges=edges), SIZE)
    wanted = np.stack([session.step(frame) for frame in shots()])
    before = cv2.getNumThreads()
    try:
        for threads in (1, 2):
            cv2.setNumThreads(threads)
            np.testing.assert_array_equal(stacked(paint(shots(), edges=edges)), wanted)
    finally:
        cv2.setNumThreads(before)


def test_the_method_is_causal() -> None:
    whole, half = paint(shots()), paint(shots()[:4])
    np.testing.assert_array_equal(stacked(whole[:4]), stacked(half))


def test_without_temporal_coherence_frames_are_independent() -> None:
    off = paint(shots(), temporal="off")
    for frame, painting in zip(shots(), off, strict=True):
        np.testing.assert_array_equal(painting.frame, paint([frame])[0].frame)
    ids = [set(painting.regions.ids[1:].tolist()) for painting in off]
    assert sum(map(len, ids)) == len(set.union(*ids)), "no name stands for two regions"


def test_a_change_of_size_within_a_video_is_rejected() -> None:
    session = AbstractionSession(AbstractionParams(), SIZE)
    session.step(shots()[0])
    with pytest.raises(BadFrame):
        session.step(np.zeros((48, 64, 3), np.uint8))


@pytest.mark.parametrize("edges", ["soft", "sharp"])
@pytest.mark.parametrize("size", [(16, 16), (17, 31), (200, 16)])
def test_any_size_is_painted(size: tuple[int, int], edges: Any) -> None:
    made = scene("harbour", size, frames=3, fps=6)
    session = AbstractionSession(AbstractionParams(edges=edges), size)
    for index in range(3):
        assert session.step(made.image(index)).shape == (size[1], size[0], 3)


@pytest.mark.parametrize(
    ("edges", "lines", "output", "curves"),
    [("soft", 720, 720, False), ("sharp", 120, 120, True), ("auto", 479, 479, False), ("auto", 480, 480, True),
     ("auto", 120, 240, True), ("soft", 120, 240, True)],
)  # fmt: skip
def test_auto_draws_curves_from_480_lines_and_every_mode_where_the_frame_is_enlarged(
    edges: Any, lines: int, output: int, curves: bool
) -> None:
    sizes = sizes_of(AbstractionParams(edges=edges), (2 * lines, lines), (2 * output, output))
    assert sizes.curves is curves
    assert sizes.work == (2 * lines, lines)


# -- cuts


def test_a_cut_resets_the_session() -> None:
    """A shot equals, with the detector on, a video of that shot alone, except for the region ids."""
    whole, alone = paint(shots()), paint(shots()[CUT:])
    np.testing.assert_array_equal(stacked(whole[CUT:]), stacked(alone))
    before = {int(name) for painting in whole[:CUT] for name in painting.regions.ids[1:]}
    assert not before & {int(name) for painting in whole[CUT:] for name in painting.regions.ids[1:]}


def test_without_cuts_residuals_cause_a_new_segmentation() -> None:
    """The paper claims that no detector is needed: the frame after the cut is as accurate as a first frame."""
    whole, alone = paint(shots(), cut_sensitivity=0), paint(shots()[CUT:])
    after, fresh, source = whole[CUT], alone[0], shots()[CUT]
    assert after.regions.residual > 0.85 * SIZE[0] * SIZE[1]
    assert distance(after.frame, fresh.frame) < 0.25 * distance(whole[CUT - 1].frame, fresh.frame)
    assert distance(after.frame, source) < 1.1 * distance(fresh.frame, source)
    old = np.isin(after.regions.ids, whole[CUT - 1].regions.ids[1:])
    assert after.regions.areas[old].sum() < 0.2 * SIZE[0] * SIZE[1]
    assert after.regions.labels.min() >= 1


def distance(one: Frame, other: Frame) -> float:
    return float(np.abs(one.astype(float) - other).mean())


# -- coherence


@cache
def pan() -> list[SceneFrame]:
    made = scene("harbour", SIZE, frames=8, fps=12)
    return [made.frame(index) for index in range(8)]


@pytest.mark.parametrize(("lines", "at_most"), [("off", 0.4), ("dog", 0.6)])
def test_temporal_coherence_reduces_flicker(lines: str, at_most: float) -> None:
    """Differences along the exact motion, where a point is visible in both frames, on a noisy pan."""
    truth = pan()
    rng = np.random.default_rng(0)
    noisy = [np.clip(t.image + rng.normal(0, 5, t.image.shape), 0, 255).astype(np.uint8) for t in truth]
    figures = {}
    for temporal in ("on", "off"):
        out = [painting.frame for painting in paint(noisy, lines=lines, temporal=temporal)]
        errors = [
            warp_error(out[i - 1], out[i], truth[i].velocity_previous, ~truth[i].occluded_previous) for i in range(1, 8)
        ]
        figures[temporal] = float(np.sqrt(np.mean(errors)))
    assert figures["on"] < at_most * figures["off"]


def warp_error(before: Frame, now: Frame, velocity: Flow, visible: Mask) -> float:
    x, y = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in now.shape[1::-1]))
    came = cv2.remap(before.astype(np.float32), x - velocity[..., 0], y - velocity[..., 1], cv2.INTER_LINEAR)
    return float(np.square(now - came).sum(-1)[visible].mean())


def test_a_still_noisy_picture_converges() -> None:
    rng = np.random.default_rng(2)
    clean = shots()[0]
    noisy = [np.clip(clean + rng.normal(0, 3, clean.shape), 0, 255).astype(np.uint8) for _ in range(12)]
    out = stacked(paint(noisy)).astype(float)
    assert (
        np.abs(np.diff(out[6:], axis=0)).mean()
        < 0.25 * np.abs(np.diff(np.stack(noisy[6:]).astype(float), axis=0)).mean()
    )


def test_a_fade_in_is_followed() -> None:
    """Frames after a fade from black are as detailed and accurate as without the fade."""
    full = shots()[0]
    frames = [(full * light).astype(np.uint8) for light in np.linspace(0, 1, 10)] + [full] * 4
    last, fresh = paint(frames, cut_sensitivity=0)[-1], paint([full])[0]
    assert len(last.regions.ids) > 0.6 * len(fresh.regions.ids)
    assert distance(last.frame, full) < 1.25 * distance(fresh.frame, full)


@pytest.mark.real("opencl")
def test_tvl1_flow_keeps_ids_as_well() -> None:
    kept = {}
    for flow in ("tvl1", "dis-ultrafast"):
        out = paint(shots()[:3], flow=flow)
        kept[flow] = np.isin(out[2].regions.ids[1:], out[0].regions.ids[1:]).mean()
    assert kept["tvl1"] > 0.6 and kept["dis-ultrafast"] > 0.6


# -- importance, lines, colour


def test_an_importance_mask_gives_finer_regions_from_its_frame_on() -> None:
    one = np.ones((SIZE[1], SIZE[0]), np.float32)
    frames = shots()[:1]
    fine, coarse = paint(frames, {0: one})[0], paint(frames, {0: 0 * one})[0]
    assert len(fine.regions.ids) > 1.3 * len(coarse.regions.ids)
    masked = paint([frames[0]] * 2, {0: one}, temporal="off")
    np.testing.assert_array_equal(masked[1].frame, fine.frame)


def test_a_drawn_mask_moves_with_the_picture_and_leaves_the_rest_to_the_cues(monkeypatch: pytest.MonkeyPatch) -> None:
    """A textured square moves by 4 px a frame; what is drawn on it stays on it, in runs of any length."""
    draw = np.random.default_rng(3)
    ground, square = draw.integers(60, 90, (SIZE[1], SIZE[0], 3)), draw.integers(140, 250, (24, 24, 3))
    frames = []
    for k in range(8):
        frame = cv2.GaussianBlur(ground.astype(np.uint8), (0, 0), 1)
        frame[20:44, 6 + 4 * k : 30 + 4 * k] = cv2.GaussianBlur(square.astype(np.uint8), (0, 0), 1)
        frames.append(frame)
    drawing = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    drawing[22:42, 8:28] = 255
    drawing[22:42, 70:90] = (0, 0, 0, 255)
    alone = AbstractionParams(face_importance=0, saliency_importance=0, motion_importance=0)
    made = []
    for run_frames in (96, 3):
        monkeypatch.setattr(plan, "RUN_FRAMES", run_frames)
        context = LocalContext(alone, frames, {"importance": {1: drawing}})
        context.passes_wanted = frozenset({"importance"})
        run_plan(ABSTRACTION, context)
        made.append((painted(context), [context.made_passes[k]["importance"] for k in range(8)]))
    np.testing.assert_array_equal(made[0][0], made[1][0])
    maps = [cv2.resize(plane, SIZE) for plane in made[0][1]]
    assert maps[0].max() < 0.05 and maps[1][32, 18] > 0.95
    assert maps[7][32, 42] > 0.9 and maps[7][32, 10] < 0.1, "it has moved by 24 px with the square"
    assert maps[7][:, 60:].max() < 0.1 and maps[7][:10].max() < 0.1
    marks = ABSTRACTION.move_marks(alone, None, frames[0], frames[1], drawing)
    for k in range(2, 8):
        np.testing.assert_allclose(_importance_of(marks), np.clip(made[0][1][k - 1], 0, 1), atol=1e-6)
        marks = ABSTRACTION.move_marks(alone, marks, frames[k - 1], frames[k], None)
    assert ABSTRACTION.move_marks(alone, marks, frames[7], 255 - frames[7], None) is None, "a cut ends a drawing"
    opaque = ABSTRACTION.move_marks(alone, None, frames[0], frames[1], drawing[..., :3])
    assert ABSTRACTION.move_marks(alone, opaque, frames[7], 255 - frames[7], None) is opaque, "not a mask"


def _importance_of(marks: NDArray[np.float32] | None) -> NDArray[np.float32]:
    """Importance times its weight; the film has nothing else where all cues are off."""
    assert marks is not None
    return np.clip(marks[..., 0], 0, 1)


def test_a_drawing_does_not_hold_in_the_next_shot_and_a_full_mask_does() -> None:
    opaque = np.full((SIZE[1], SIZE[0], 4), 255, np.uint8)
    drawing = opaque.copy()
    drawing[:, : SIZE[0] // 2, 3] = 0
    films = []
    for given in ({}, {"importance": {0: drawing}}, {"importance": {0: opaque}}):
        context = LocalContext(AbstractionParams(), shots(), given)
        run_plan(ABSTRACTION, context)
        films.append(painted(context))
    plain, drawn, full = films
    assert (drawn[:CUT] != plain[:CUT]).any() and (full[CUT:] != plain[CUT:]).any()
    np.testing.assert_array_equal(drawn[CUT:], plain[CUT:])


def test_masks_are_decoded_at_their_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """One mask per frame must not keep a whole video of masks in memory in every run."""
    monkeypatch.setattr(plan, "RUN_FRAMES", 4)
    read: list[int] = []

    class Images(dict[int, NDArray[np.uint8]]):
        def __getitem__(self, number: int) -> NDArray[np.uint8]:
            read.append(number)
            return super().__getitem__(number)

    masks = Images({number: np.full((SIZE[1], SIZE[0]), 20 * number, np.uint8) for number in range(12) if number != 4})
    context = LocalContext(AbstractionParams(temporal="off"), shots(), {"importance": masks})
    run_plan(ABSTRACTION, context)
    assert read == [0, 1, 2, 3, 3, 5, 6, 7, 8, 9, 10, 11]
    expected_masks = {n: np.full((SIZE[1], SIZE[0]), 20 * n / 255, np.float32) for n in masks}
    np.testing.assert_array_equal(painted(context), stacked(paint(shots(), expected_masks, temporal="off")))


def test_lines_are_drawn_at_edges_and_can_be_switched_off() -> None:
    frames = shots()[:2]
    drawn, plain = paint(frames)[-1].frame.astype(int), paint(frames, lines="off")[-1].frame.astype(int)
    inked = drawn.sum(-1) < plain.sum(-1) - 60
    assert 0.01 < inked.mean() < 0.4
    edge = cv2.dilate(cv2.Canny(frames[1], 60, 120), np.ones((5, 5), np.uint8)) > 0
    assert edge[inked].mean() > 0.8
    red = paint(frames, line_colour="#ff0000")[-1].frame.astype(int)
    redder = red[..., 0] - red[..., 1:].max(-1) > drawn[..., 0] - drawn[..., 1:].max(-1) + 50
    assert redder[inked].mean() > 0.8


def test_regions_have_the_colours_of_a_palette_and_the_nearest_ones() -> None:
    plain, fixed = (paint(shots()[:1], lines="off", **values)[0] for values in ({}, {"palette": PALETTE}))
    given = np.array([list(bytes.fromhex(colour[1:])) for colour in PALETTE], np.uint8)
    assert {*map(tuple, fixed.colours)} <= {*map(tuple, given)}
    exact = (fixed.frame[..., None, :] == given).all(axis=-1).any(axis=-1)
    assert exact.mean() > 0.7, "only pixels at borders are mixed"
    apart = np.linalg.norm(srgb_to_lab(plain.colours / 255)[:, None] - srgb_to_lab(given / 255), axis=-1)
    np.testing.assert_array_equal(fixed.colours[1:], given[apart.argmin(axis=1)][1:])


def test_a_region_keeps_its_colour_of_the_palette_while_its_light_flickers() -> None:
    """A square whose lightness swings by 4 units about the middle of two colours of the palette."""

    def with_square(gray: int) -> Frame:
        frame = np.full((SIZE[1], SIZE[0], 3), 235, np.uint8)
        frame[20:44, 30:60] = gray
        return frame

    flickering = [with_square(124 if k % 2 else 114) for k in range(8)]
    values = {"lines": "off", "colour_half_life": 0, "stillness": 0, "steadiness": 0}
    palette = ("#606060", "#a0a0a0", "#f0f0f0")
    held, free = (
        {int(painting.frame[32, 45, 0]) for painting in paint(flickering, palette=palette, temporal=temporal, **values)}
        for temporal in ("on", "off")
    )
    assert free == {0x60, 0xA0} and len(held) == 1
    darker = [*flickering[1:3], *[with_square(80)] * 4]
    assert paint(darker, palette=palette, **values)[-1].frame[32, 45, 0] == 0x60, "it changes with the picture"


def test_a_session_goes_on_with_another_palette() -> None:
    session = AbstractionSession(AbstractionParams(palette=PALETTE, lines="off"), SIZE)
    for frame in shots()[:3]:
        session.step(frame)
    for palette in (PALETTE[:2], (), PALETTE[2:]):
        session = session.reconfigure(AbstractionParams(palette=palette, lines="off"), SIZE)
        session.step(shots()[3])
        if palette:
            found = {*map(tuple, session.regions.palette.fixed.last)}  # type: ignore[union-attr, arg-type]
            assert found <= {tuple(bytes.fromhex(colour[1:])) for colour in palette}


def test_a_reference_changes_hues() -> None:
    frames = shots()[:1]
    session = AbstractionSession(AbstractionParams(lines="off", hue_neighbourhood=180), SIZE, learn([reds()]))
    plain, moved = (
        srgb_to_hsv(frame / 255) for frame in (paint(frames, lines="off")[0].frame, session.step(frames[0]))
    )
    coloured = (plain[..., 1] > 0.2) & (plain[..., 2] > 0.2)
    warm = coloured & (from_red(plain) < 80)
    assert warm.mean() > 0.2 and from_red(plain)[warm].mean() > 20
    assert from_red(moved)[warm].mean() < 8


def from_red(hsv: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance to hue 0, degrees."""
    return np.asarray(np.abs((hsv[..., 0] + 180) % 360 - 180))


def test_a_histogram_takes_precedence_over_a_reference() -> None:
    histogram = {"hue": [1.0, *[0.0] * 35], "saturation_mean": 0.6, "saturation_std": 0.2, "value_mean": 0.5}
    blues = np.ascontiguousarray(reds()[..., ::-1])
    one = LocalContext(AbstractionParams(), shots()[:2], {"histogram": histogram, "reference": [blues]})
    two = LocalContext(AbstractionParams(), shots()[:2], {"histogram": histogram})
    for context in (one, two):
        run_plan(ABSTRACTION, context)
    np.testing.assert_array_equal(painted(one), painted(two))


def test_an_invalid_histogram_is_rejected_with_its_field() -> None:
    with pytest.raises(BadInput) as caught:
        run_plan(ABSTRACTION, LocalContext(AbstractionParams(), shots()[:1], {"histogram": {"hue": [1]}}))
    assert caught.value.field.startswith("inputs.histogram")


def reds() -> Frame:
    """A reference of reds and a little gray."""
    rng = np.random.default_rng(4)
    red = np.stack([rng.uniform(150, 255, (40, 40)), rng.uniform(0, 60, (40, 40)), rng.uniform(0, 60, (40, 40))], -1)
    red[:8] = 128
    return red.astype(np.uint8)


# -- vector output


def svg_pages(context: LocalContext) -> dict[str, bytes]:
    pages: dict[str, bytes] = {}
    for data in context.files.values():
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            pages |= {name: archive.read(name) for name in archive.namelist()}
    return pages


@pytest.mark.parametrize("edges", ["soft", "sharp"])
def test_svg_has_one_file_per_frame_with_permanent_ids(edges: Any) -> None:
    context = LocalContext(AbstractionParams(edges=edges), shots(), artefacts=frozenset({"svg"}))
    run_plan(ABSTRACTION, context)
    pages = svg_pages(context)
    assert sorted(pages) == [f"{index:05d}.svg" for index in range(len(shots()))]
    ids = [set(re.findall(rb'id="(r[0-9]+)"', pages[name])) for name in sorted(pages)]
    assert len(ids[2] & ids[3]) > 0.7 * len(ids[3])
    assert not ids[CUT - 1] & ids[CUT]


def test_svg_is_made_on_request_only() -> None:
    context = LocalContext(AbstractionParams(), shots()[:2])
    run_plan(ABSTRACTION, context)
    assert not context.files
