"""Masks of all methods: palettes, depths and sizes."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.methods import method
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession
from pipeline.methods.analogy.inputs import read_keyframe
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.masks import fitted, mask_plane
from pipeline.methods.multistyle.regions import label_map
from pipeline.methods.patches.scan import WorkingGrid, mask_map
from pipeline.scenes import scene
from tests.pipeline.methods.frames import painted

SIZE = (96, 64)
HALF = np.where(np.arange(96) < 40, 255, 0).astype(np.uint8)[None].repeat(64, 0)


def palette(colour: tuple[int, int, int]) -> np.ndarray:
    """The left part in one colour of a palette, as DAVIS exports it."""
    return np.where(HALF[..., None] > 0, np.array(colour, np.uint8), np.uint8(0))


@pytest.mark.parametrize("colour", [(128, 0, 0), (0, 128, 0), (0, 0, 128), (64, 0, 0), (255, 255, 0)], ids=str)
def test_every_colour_of_a_palette_but_black_is_foreground(colour: tuple[int, int, int]) -> None:
    image = palette(colour)
    np.testing.assert_array_equal(mask_plane(image), HALF / 255)
    grid = WorkingGrid.of(SIZE)
    assert (mask_map(image, grid, 0) == 1).mean() == pytest.approx(40 / 96, abs=0.02)
    key = read_keyframe(0, palette((9, 9, 9)), SIZE, image, "inputs.keyframes")
    assert key.painted is not None and (key.painted == HALF / 255).all()


def test_gray_masks_keep_their_values_at_every_depth() -> None:
    ramp = np.arange(96, dtype=np.uint8)[None].repeat(64, 0)
    expected = ramp / np.float32(255)
    tinted = np.dstack([ramp, ramp, np.maximum(ramp, 8) - 8])
    for image in (ramp, np.dstack([ramp] * 3), ramp.astype(np.uint16) * 257, expected[..., None]):
        np.testing.assert_allclose(mask_plane(image), expected, atol=1e-6)
    np.testing.assert_allclose(mask_plane(tinted), expected, atol=0.02)


def test_a_mask_is_scaled_or_refused() -> None:
    half_size = mask_plane(HALF[::2, ::2])
    np.testing.assert_allclose(fitted(half_size, SIZE, "here")[:, ::2][:, :19], 1)
    with pytest.raises(BadParameter, match="aspect ratio") as caught:
        fitted(half_size[:, :20], SIZE, "inputs.importance[3]")
    assert caught.value.field == "inputs.importance[3]" and "96x64" in caught.value.remedy


def test_importance_of_another_size_is_scaled() -> None:
    frames = [scene("cut", SIZE, frames=12, fps=10).image(index) for index in range(2)]
    results = []
    for mask in (HALF, HALF[::2, ::2], HALF.repeat(2, 0).repeat(2, 1)):
        context = LocalContext(AbstractionParams(), frames, {"importance": {0: mask}})
        run_plan(method("abstraction"), context)
        results.append(painted(context))
    for other in results[1:]:
        assert np.abs(other.astype(int) - results[0]).mean() < 3


def test_without_temporal_coherence_a_jump_of_brightness_changes_no_other_frame() -> None:
    frame = scene("cut", SIZE, frames=12, fps=10).image(0)
    dim = (frame // 6 + 20).astype(np.uint8)
    for before in (frame, 255 - frame, np.full_like(frame, 250)):
        session = AbstractionSession(AbstractionParams(temporal="off", cut_sensitivity=0), SIZE)
        session.step(before)
        alone = AbstractionSession(AbstractionParams(temporal="off", cut_sensitivity=0), SIZE)
        np.testing.assert_array_equal(session.step(dim), alone.step(dim))


def test_a_label_map_of_regions_in_colours_without_red_is_refused() -> None:
    assert (label_map(palette((128, 0, 0)), SIZE, "frame 0") == np.where(HALF > 0, 128, 0)).all()
    with pytest.raises(BadParameter, match="without red"):
        label_map(palette((0, 128, 0)), SIZE, "frame 0")
