"""What belongs to no patch: paint goes along with the flow, gives way to what is new, and meets the next run's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Plane
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.links import artefact_of
from pipeline.methods.patches.lives import Life
from pipeline.methods.patches.painted import Painted
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.remainder import FADE, NOWHERE, RETURNS, Carried, Remainder
from pipeline.segmentation.cuts import is_cut, thumbnail
from tests.pipeline.methods.frames import painted
from tests.pipeline.methods.patch_scenes import paint, truth

SIZE = (160, 96)
GRID = Grid.of(SIZE)
PAINTER = Painter.of("hertzmann", 1e9, 172, PatchesParams(), 0)


@dataclass
class Moves:
    """Links of a world that moves by so many px a frame, as one."""

    x: float
    sure: float = 1.0

    def back(self, index: int, gap: int = 1) -> tuple[Flow, Plane]:
        return self._pair(-self.x)

    def ahead(self, index: int) -> tuple[Flow, Plane]:
        return self._pair(self.x)

    def _pair(self, x: float) -> tuple[Flow, Plane]:
        flow = np.zeros((GRID.size[1], GRID.size[0], 2), np.float32)
        flow[..., 0] = x / GRID.ratio[0]
        return flow, np.full(flow.shape[:2], self.sure, np.float32)


def texture(shift: float = 0.0, seed: int = 3) -> Frame:
    """Blobs of colour, smooth, moved to the right by `shift` px."""
    noise = np.random.Generator(np.random.Philox(seed)).uniform(0, 255, (SIZE[1], SIZE[0] + 80, 3)).astype(np.float32)
    blobs = np.asarray(cv2.GaussianBlur(noise, (0, 0), 6), np.float32)
    blobs = 20 + 215 * (blobs - blobs.min()) / np.ptp(blobs)
    way = np.array([[1.0, 0.0, shift - 40], [0.0, 1.0, 0.0]])
    moved = cv2.warpAffine(blobs, way, SIZE, flags=cv2.INTER_CUBIC)
    return np.asarray(np.clip(moved, 0, 255), np.uint8)


def remainder(moves: Moves) -> Remainder:
    return Remainder(PAINTER, cast(Any, moves), GRID)


ALL = np.ones((SIZE[1], SIZE[0]), np.float32)
LIMIT = np.full((SIZE[1], SIZE[0]), 20, np.float32)


def played(frames: list[Frame], moves: Moves, start: int = 0) -> list[NDArray[np.float32]]:
    """The frames, painted one after the other, of which no patch has anything."""
    mine, out = remainder(moves), []
    for index, frame in enumerate(frames, start=start):
        picture, shown = mine.paint(index, frame, ALL, LIMIT)
        mine.keep(index, *(np.rint(np.clip(plane, 0, 255)).astype(np.uint8) for plane in (picture, shown)))
        out.append(shown)
    return out


def test_strokes_go_along_with_the_flow_and_are_as_sharp_after_ten_frames() -> None:
    out = played([texture(2.5 * index) for index in range(11)], Moves(2.5))
    for step in range(0, 10, 2):  # two frames are whole pixels
        change = np.abs(out[step + 2][:, 45:-20] - out[step][:, 40:-25])
        assert change.mean() < 0.5
    sharp = [np.abs(np.diff(part, axis=1)).mean() for part in (out[0][:, 40:-45], out[10][:, 65:-20])]
    assert sharp[1] > 0.97 * sharp[0]


def test_what_is_revealed_at_the_border_is_painted_and_nothing_is_smeared() -> None:
    frames = [texture(4.0 * index) for index in range(6)]
    for frame, shown in zip(frames, played(frames, Moves(4.0)), strict=True):
        near = cv2.GaussianBlur(shown, (0, 0), 4) - cv2.GaussianBlur(frame.astype(np.float32), (0, 0), 4)
        assert np.abs(near).max() < 45


def test_what_looks_otherwise_is_painted_anew_without_a_ghost() -> None:
    """A bright square that is gone: flow says that nothing moves, and only the colours tell."""
    before, after = texture(), texture()
    before[30:60, 60:90] = 255
    out = played([before, after], Moves(0.0))
    alone = PAINTER.picture(after).astype(np.float32)
    assert np.abs(out[1][38:52, 68:82] - alone[38:52, 68:82]).mean() < 6
    assert np.abs(out[1][:, 110:] - out[0][:, 110:]).max() < 1


def test_what_is_half_old_is_not_taken_for_new() -> None:
    """Light that changes a little: a part of that is shown, and what is remembered was made from that part."""
    mine, frame = remainder(Moves(0.0)), texture()
    lit = np.clip(frame.astype(int) + 14, 0, 255).astype(np.uint8)
    _, shown = mine.paint(0, frame, ALL, LIMIT)
    mine.keep(0, frame, shown.astype(np.uint8))
    behind = [float(np.mean(plane - lit)) for plane in mine.paint(1, lit, ALL, LIMIT)]
    assert -12 < behind[0] < -1 and abs(behind[0] - behind[1]) < 1


def test_a_patch_takes_back_slowly_what_it_has_lost() -> None:
    mine, frame = remainder(Moves(0.0)), texture()
    lost, shares = np.zeros((SIZE[1], SIZE[0]), np.float32), []
    lost[30:60, 40:90] = 1
    for index in range(4):
        left = mine.lingers(index, lost if index == 0 else np.zeros_like(lost))
        mine.keep(index, frame, frame)
        shares.append(float(left[45, 65]))
    np.testing.assert_allclose(shares, 1 - RETURNS * np.arange(4), atol=1e-5)


def test_but_at_once_what_was_behind_something() -> None:
    mine, frame = remainder(Moves(0.0, sure=0.0)), texture()
    mine.lingers(0, ALL)
    mine.keep(0, frame, frame)
    assert mine.lingers(1, np.zeros_like(ALL)).max() == 0


def test_where_no_flow_leads_back_every_frame_is_painted_alone() -> None:
    frames = [texture(3.0 * index) for index in range(2)]
    out = played(frames, Moves(3.0, sure=0.0))
    np.testing.assert_array_equal(out[1], PAINTER.picture(frames[1]))


def test_carried_paint_knows_where_it_is_from() -> None:
    here = Carried.here(7, (SIZE[1], SIZE[0]))
    where = np.ones((SIZE[1], SIZE[0]), np.bool_)
    where[:10] = False
    there = here.follow(Moves(3.0).back(8), GRID, where)
    assert (there.origin[:10] == NOWHERE).all() and (there.origin[10:] == 7).all()
    np.testing.assert_allclose(there.place[20, 40], (37, 20), atol=1e-3)


def test_the_last_frames_of_a_run_fade_over_to_the_next_one() -> None:
    """The next run's first frame is a painting of its own; what is shown comes nearer to it, step by step."""
    frame, target = texture(), np.roll(PAINTER.picture(texture()), 3, axis=1)
    mine, far = remainder(Moves(0.0)), []
    for index in range(8):
        if index == 8 - FADE:
            mine.turn_to(8, frame, target, 1)
        _, shown = mine.paint(index, frame, ALL, LIMIT)
        mine.keep(index, frame, np.rint(shown).astype(np.uint8))
        far.append(float(np.abs(shown - target).mean()))
    steps = -np.diff([*far[8 - FADE :], 0.0])
    assert far[0] > 3 and steps.min() > 0.2 * far[0] and steps.max() < 0.3 * far[0]


@pytest.mark.parametrize("hold", [5, 3])
def test_a_patch_held_over_the_end_of_a_run_is_the_same(hold: int) -> None:
    frames = [shot.image for shot in truth()]
    held = painted(paint(frames, hold=hold))
    for index, frame in enumerate(held):
        np.testing.assert_array_equal(frame, held[index // hold * hold])


def test_nothing_crosses_a_cut() -> None:
    """Frames after a cut are what they would be in a film of their own."""
    first, second = [texture(2.0 * index, 9) for index in range(3)], [shot.image for shot in truth()[:4]]
    size = second[0].shape[1], second[0].shape[0]
    first = [np.asarray(cv2.resize(255 - frame // 8, size), np.uint8) for frame in first]
    both = paint([*first, *second])
    assert is_cut(thumbnail(first[-1]), thumbnail(second[0]))
    np.testing.assert_array_equal(painted(both)[3:], painted(paint(second)))


def test_what_is_read_together_lies_together() -> None:
    assert [artefact_of(14, gap, 2, 12) for gap in (0, 1, 4)] == ["flow-0000014", "flow-0000014", "far-0000014"]
    assert [artefact_of(13, gap, 2, 12) for gap in (0, 1, 4)] == ["flow-0000002", "over-0000002", "over-0000002"]


@pytest.mark.parametrize("change", range(8, 40))
def test_a_run_has_the_looks_of_its_frames_and_of_the_one_after_them(change: int) -> None:
    """Wherever one age of a patch fades over into the next."""

    class Kept:
        def load(self, step: str, name: str) -> dict[str, NDArray[Any]]:
            if "age" in name:
                rendering = np.full((8, 8, 3), 9, np.uint8)
                return {"panorama": rendering, "painting": rendering}
            return {"at": np.zeros((0, 6), np.int32), "matrix": np.zeros((0, 3, 3)), "shift": np.zeros((0, 2))}

    life = Life("s0-l2-f0", 2, 0, 48, 0, 48, 20, False, False, 64)
    result = {"ages": [[0, change], [change, 48]], "origin": [0, 0]}
    patch = Painted.load(life, result, 12, 24, cast(Any, Kept()))
    for index in range(12, 25):
        picture, _ = patch.at(index, np.ones((2, 2), np.float32), np.ones((2, 2), np.float32))
        np.testing.assert_allclose(picture, 9, atol=1e-4)
