"""Residual layer: paint follows the flow, is replaced where the picture changes, and fades to the next run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Plane
from pipeline.methods.patches.paint_source import NO_SOURCE, PaintSource
from pipeline.methods.patches.painted_patch import PaintedPatch
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_track import PatchTrack
from pipeline.methods.patches.residual_layer import (
    FADE_PAINTINGS,
    MAX_OPACITY_DECREASE,
    FirstPainting,
    ResidualLayer,
)
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.methods.patches.window_flow import flow_artefact
from pipeline.perception.cuts import is_cut, thumbnail
from tests.pipeline.methods.frames import painted
from tests.pipeline.methods.patch_scenes import paint, truth

SIZE = (160, 96)
GRID = WorkingGrid.of(SIZE)
PAINTER = HertzmannPainter.of("hertzmann", 1e9, 172, PatchesParams(), 0)


@dataclass
class UniformFlow:
    """Flow of a scene that moves to the right by `speed_px` px per frame, with constant reliability."""

    speed_px: float
    reliability: float = 1.0

    def backward(self, index: int, gap: int = 1) -> tuple[Flow, Plane]:
        return self._pair(-self.speed_px)

    def forward(self, index: int) -> tuple[Flow, Plane]:
        return self._pair(self.speed_px)

    def _pair(self, x: float) -> tuple[Flow, Plane]:
        flow = np.zeros((GRID.size[1], GRID.size[0], 2), np.float32)
        flow[..., 0] = x / GRID.ratio[0]
        return flow, np.full(flow.shape[:2], self.reliability, np.float32)


def texture(shift: float = 0.0, seed: int = 3) -> Frame:
    """Smooth blobs of colour, moved to the right by `shift` px."""
    noise = np.random.Generator(np.random.Philox(seed)).uniform(0, 255, (SIZE[1], SIZE[0] + 80, 3)).astype(np.float32)
    blobs = np.asarray(cv2.GaussianBlur(noise, (0, 0), 6), np.float32)
    blobs = 20 + 215 * (blobs - blobs.min()) / np.ptp(blobs)
    translation = np.array([[1.0, 0.0, shift - 40], [0.0, 1.0, 0.0]])
    moved = cv2.warpAffine(blobs, translation, SIZE, flags=cv2.INTER_CUBIC)
    return np.asarray(np.clip(moved, 0, 255), np.uint8)


def residual_layer(flow: UniformFlow) -> ResidualLayer:
    return ResidualLayer(PAINTER, cast(Any, flow), GRID)


ALL = np.ones((SIZE[1], SIZE[0]), np.float32)
LIMIT = np.full((SIZE[1], SIZE[0]), 20, np.float32)


def paint_all(frames: list[Frame], flow: UniformFlow, start: int = 0) -> list[NDArray[np.float32]]:
    """Paintings of successive frames that no patch covers."""
    layer, out = residual_layer(flow), []
    for index, frame in enumerate(frames, start=start):
        picture, painting = layer.paint(index, frame, ALL, LIMIT)
        layer.store(index, *(np.rint(np.clip(plane, 0, 255)).astype(np.uint8) for plane in (picture, painting)))
        out.append(painting)
    return out


def test_advected_strokes_follow_the_flow_and_stay_sharp_for_ten_frames() -> None:
    out = paint_all([texture(2.5 * index) for index in range(11)], UniformFlow(2.5))
    for step in range(0, 10, 2):  # two frames are whole pixels
        change = np.abs(out[step + 2][:, 45:-20] - out[step][:, 40:-25])
        assert change.mean() < 0.5
    sharpness = [np.abs(np.diff(part, axis=1)).mean() for part in (out[0][:, 40:-45], out[10][:, 65:-20])]
    assert sharpness[1] > 0.97 * sharpness[0]


def test_areas_revealed_at_the_border_are_painted_without_smearing() -> None:
    frames = [texture(4.0 * index) for index in range(6)]
    for frame, painting in zip(frames, paint_all(frames, UniformFlow(4.0)), strict=True):
        error = cv2.GaussianBlur(painting, (0, 0), 4) - cv2.GaussianBlur(frame.astype(np.float32), (0, 0), 4)
        assert np.abs(error).max() < 45


def test_changed_areas_are_repainted_without_a_ghost() -> None:
    """A bright square disappears while the flow is zero, so only the colours reveal the change."""
    before, after = texture(), texture()
    before[30:60, 60:90] = 255
    out = paint_all([before, after], UniformFlow(0.0))
    alone = PAINTER.paint_picture(after).astype(np.float32)
    assert np.abs(out[1][38:52, 68:82] - alone[38:52, 68:82]).mean() < 6
    assert np.abs(out[1][:, 110:] - out[0][:, 110:]).max() < 1


def test_partly_repainted_pixels_store_the_blended_picture() -> None:
    """After a small change of light, picture and painting are blended with the same weights."""
    layer, frame = residual_layer(UniformFlow(0.0)), texture()
    brighter = np.clip(frame.astype(int) + 14, 0, 255).astype(np.uint8)
    _, painting = layer.paint(0, frame, ALL, LIMIT)
    layer.store(0, frame, painting.astype(np.uint8))
    difference = [float(np.mean(plane - brighter)) for plane in layer.paint(1, brighter, ALL, LIMIT)]
    assert -12 < difference[0] < -1 and abs(difference[0] - difference[1]) < 1


def test_the_residual_opacity_decreases_slowly() -> None:
    layer, frame = residual_layer(UniformFlow(0.0)), texture()
    uncovered, opacities = np.zeros((SIZE[1], SIZE[0]), np.float32), []
    uncovered[30:60, 40:90] = 1
    for index in range(4):
        opacity = layer.limited_opacity(index, uncovered if index == 0 else np.zeros_like(uncovered))
        layer.store(index, frame, frame)
        opacities.append(float(opacity[45, 65]))
    np.testing.assert_allclose(opacities, 1 - MAX_OPACITY_DECREASE * np.arange(4), atol=1e-5)


def test_the_residual_opacity_of_disoccluded_pixels_is_not_limited() -> None:
    layer, frame = residual_layer(UniformFlow(0.0, reliability=0.0)), texture()
    layer.limited_opacity(0, ALL)
    layer.store(0, frame, frame)
    assert layer.limited_opacity(1, np.zeros_like(ALL)).max() == 0


def test_without_valid_flow_every_frame_is_painted_independently() -> None:
    frames = [texture(3.0 * index) for index in range(2)]
    out = paint_all(frames, UniformFlow(3.0, reliability=0.0))
    np.testing.assert_array_equal(out[1], PAINTER.paint_picture(frames[1]))


def test_advection_keeps_frame_and_position_of_the_source() -> None:
    source = PaintSource.identity(7, (SIZE[1], SIZE[0]))
    where = np.ones((SIZE[1], SIZE[0]), np.bool_)
    where[:10] = False
    advected = source.advect(UniformFlow(3.0).backward(8), GRID, where)
    assert (advected.frame[:10] == NO_SOURCE).all() and (advected.frame[10:] == 7).all()
    np.testing.assert_allclose(advected.position[20, 40], (37, 20), atol=1e-3)


def test_the_last_frames_of_a_run_fade_to_the_next_run() -> None:
    """The next run's first frame has another painting; the distance to it decreases evenly."""
    frame, target = texture(), np.roll(PAINTER.paint_picture(texture()), 3, axis=1)
    layer, distances = residual_layer(UniformFlow(0.0)), []
    for index in range(8):
        if index == 8 - FADE_PAINTINGS:
            layer.prepare_cross_fade(FirstPainting(8, frame, target, ALL, True), 1)
        _, painting = layer.paint(index, frame, ALL, LIMIT)
        layer.store(index, frame, np.rint(painting).astype(np.uint8))
        distances.append(float(np.abs(painting - target).mean()))
    steps = -np.diff([*distances[8 - FADE_PAINTINGS :], 0.0])
    assert distances[0] > 3 and steps.min() > 0.2 * distances[0] and steps.max() < 0.3 * distances[0]


@pytest.mark.parametrize("frames_per_painting", [5, 3])
def test_a_painting_that_spans_the_end_of_a_run_does_not_change(frames_per_painting: int) -> None:
    frames = [shot.image for shot in truth()]
    output = painted(paint(frames, frames_per_painting=frames_per_painting))
    for index, frame in enumerate(output):
        np.testing.assert_array_equal(frame, output[index // frames_per_painting * frames_per_painting])


def test_frames_after_a_cut_do_not_depend_on_frames_before_it() -> None:
    first, second = [texture(2.0 * index, 9) for index in range(3)], [shot.image for shot in truth()[:4]]
    size = second[0].shape[1], second[0].shape[0]
    first = [np.asarray(cv2.resize(255 - frame // 8, size), np.uint8) for frame in first]
    both = paint([*first, *second])
    assert is_cut(thumbnail(first[-1]), thumbnail(second[0]))
    np.testing.assert_array_equal(painted(both)[3:], painted(paint(second)))


def test_arrays_that_are_read_together_are_in_one_artefact() -> None:
    assert [flow_artefact(14, gap, 2) for gap in (0, 1, 4)] == ["flow-0000014", "flow-0000014", "far-0000014"]
    assert [flow_artefact(13, gap, 2) for gap in (0, 1, 4)] == ["flow-0000002", "over-0000002", "over-0000002"]


@pytest.mark.parametrize("change", range(8, 40))
def test_a_run_loads_every_period_that_its_frames_show(change: int) -> None:
    """A second period begins at frame `change`; both are cross-faded around it."""

    class Artefacts:
        def load(self, step: str, name: str) -> dict[str, NDArray[Any]]:
            if "period" in name:
                picture = np.full((8, 8, 3), 9, np.uint8)
                return {"panorama": picture, "painting": picture}
            return {"at": np.zeros((0, 6), np.int32), "matrix": np.zeros((0, 3, 3)), "shift": np.zeros((0, 2))}

    track = PatchTrack("s0-l2-f0", 2, 0, 48, 0, 48, 20, False, False, 64, False)
    result = {"periods": [[0, change], [change, 48]], "origin": [0, 0]}
    patch = PaintedPatch.load(track, result, 12, 24, cast(Any, Artefacts()))
    for index in range(12, 24):
        picture, _ = patch.sample(index, np.ones((2, 2), np.float32), np.ones((2, 2), np.float32))
        np.testing.assert_allclose(picture, 9, atol=1e-4)
