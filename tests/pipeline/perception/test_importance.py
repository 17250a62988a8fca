"""The importance map: faces, saliency, motion, masks, and smoothing over time."""

from collections.abc import Iterator
from itertools import pairwise

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.errors import BadFrame
from pipeline.frames import Flow, Frame, Plane
from pipeline.perception.importance import CUES, ImportanceParams, ImportanceTracker
from pipeline.perception.saliency import spectral_residual

SIZE = (160, 96)
NOTHING = ImportanceParams(face=0, saliency=0, motion=0)
ONLY_MOTION = ImportanceParams(face=0, saliency=0, motion=1)
ONLY_SALIENCY = ImportanceParams(face=0, saliency=1, motion=0)
ONLY_FACES = ImportanceParams(face=1, saliency=0, motion=0)


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


def gray(value: int = 90) -> Frame:
    return np.full((SIZE[1], SIZE[0], 3), value, np.uint8)


def still() -> Flow:
    return np.zeros((SIZE[1], SIZE[0], 2), np.float32)


def moving_square(speed_px: float = 3.0) -> Flow:
    flow = still()
    flow[30:60, 60:100] = (speed_px, 0)
    return flow


FACE_SIZE = (320, 240)
FACE_AT = (220, 105)
"""About the middle of the astronaut's face in `portrait()`, px (x, y)."""


def portrait(shift: tuple[int, int] = (0, 0)) -> Frame:
    from skimage import data

    picture = np.asarray(data.astronaut(), np.uint8)  # type: ignore[no-untyped-call]
    return np.ascontiguousarray(np.roll(picture[:240, :320], shift, axis=(1, 0)))


def at(plane: Plane, point: tuple[int, int]) -> float:
    return float(plane[point[1], point[0]])


# --- faces


def test_a_whole_head_is_important_from_the_first_frame_on() -> None:
    plane = ImportanceTracker(ONLY_FACES, FACE_SIZE).step(portrait())
    x, y = FACE_AT
    for point in ((x, y), (x, y - 60), (x, y + 45), (x - 35, y), (x + 35, y)):
        assert at(plane, point) > 0.9, f"hair, chin, cheeks at {point}"
    assert at(plane, (20, 200)) == 0


def test_a_face_of_30_px_is_important_from_the_first_frame_on() -> None:
    frame = np.full((360, 640, 3), 110, np.uint8)
    frame[120:204, 200:312] = cv2.resize(portrait(), (112, 84), interpolation=cv2.INTER_AREA)
    plane = ImportanceTracker(ONLY_FACES, (640, 360)).step(frame)
    assert at(plane, (200 + FACE_AT[0] * 112 // 320, 120 + FACE_AT[1] * 84 // 240)) > 0.9
    assert plane.mean() < 0.03


def test_large_faces_can_count_less_than_small_ones() -> None:
    """The face is 0.46 of the frame's shorter side; in the second frame 0.1 of it."""
    params = ImportanceParams(face=1, saliency=0, motion=0, large_faces=0.8)
    assert at(ImportanceTracker(params, FACE_SIZE).step(portrait()), FACE_AT) == pytest.approx(0.8, abs=0.01)
    frame = np.full((360, 640, 3), 110, np.uint8)
    frame[120:204, 200:312] = cv2.resize(portrait(), (112, 84), interpolation=cv2.INTER_AREA)
    small = ImportanceTracker(params, (640, 360)).step(frame)
    assert at(small, (200 + FACE_AT[0] * 112 // 320, 120 + FACE_AT[1] * 84 // 240)) > 0.9


def test_small_heads_are_people_and_large_ones_are_not() -> None:
    small, large = ImportanceTracker(ONLY_FACES, (640, 360)), ImportanceTracker(ONLY_FACES, FACE_SIZE)
    assert small.small_heads() is None
    frame = np.full((360, 640, 3), 110, np.uint8)
    frame[120:204, 200:312] = cv2.resize(portrait(), (112, 84), interpolation=cv2.INTER_AREA)
    small.step(frame)
    large.step(portrait())
    found, other = small.small_heads(), large.small_heads()
    assert found is not None and found.shape == (54, 96) and found.max() > 0.9 and found.mean() < 0.03
    assert other is not None and other.max() < 0.4


def test_eyes_and_mouths_of_faces_of_any_size_are_found_and_outlines_are_not() -> None:
    """The face of FACE_AT is about 80 px wide, the other one 28 px."""
    for size, scale, corner in ((FACE_SIZE, 1.0, (0, 0)), ((640, 360), 0.35, (200, 120))):
        frame = np.full((size[1], size[0], 3), 110, np.uint8)
        picture = cv2.resize(portrait(), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        frame[corner[1] : corner[1] + picture.shape[0], corner[0] : corner[0] + picture.shape[1]] = picture
        tracker = ImportanceTracker(ONLY_FACES, size)
        assert tracker.eyes_and_mouths() is None
        tracker.step(frame)
        plane = tracker.eyes_and_mouths()
        assert plane is not None
        places = [
            (round(corner[0] + scale * (FACE_AT[0] + dx)), round(corner[1] + scale * (FACE_AT[1] + dy)))
            for dx, dy in ((0, 0), (-70, 0), (70, 0), (0, -80))
        ]
        wide = np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_NEAREST), np.float32)
        middle, *outline = (at(wide, place) for place in places)
        assert middle > 0.8 and outline == [0, 0, 0]


def test_faces_are_searched_in_a_sharper_picture_if_there_is_one() -> None:
    tracker = ImportanceTracker(ONLY_FACES, FACE_SIZE)
    sharp = np.asarray(cv2.cvtColor(portrait(), cv2.COLOR_RGB2GRAY), np.uint8)
    tracker.track_faces(sharp, None, cut=False)
    plane = tracker.step_coarse(gray_like(sharp))
    assert plane[FACE_AT[1] * plane.shape[0] // 240, FACE_AT[0] * plane.shape[1] // 320] > 0.9
    assert not ImportanceTracker(ONLY_FACES, FACE_SIZE).step_coarse(gray_like(sharp)).any()


def test_a_face_moves_with_the_flow_between_detections() -> None:
    tracker = ImportanceTracker(ONLY_FACES, FACE_SIZE)
    tracker.step(portrait())
    flow = np.zeros((240, 320, 2), np.float32)
    flow[:] = (-16, 0)
    plane = tracker.step(gray_like(portrait()), flow)
    assert at(plane, (FACE_AT[0] - 16, FACE_AT[1])) == pytest.approx(1)
    column = plane[FACE_AT[1]]
    centre = (column * np.arange(column.size)).sum() / column.sum()
    before = ImportanceTracker(ONLY_FACES, FACE_SIZE).step(portrait())[FACE_AT[1]]
    assert centre == pytest.approx((before * np.arange(column.size)).sum() / before.sum() - 16, abs=0.5)


def gray_like(frame: Frame) -> Frame:
    return np.full_like(frame, 128)


def test_a_lost_face_fades_and_is_removed() -> None:
    tracker = ImportanceTracker(ONLY_FACES, FACE_SIZE)
    values = [at(tracker.step(portrait()), FACE_AT)]
    values += [at(tracker.step(gray_like(portrait())), FACE_AT) for _ in range(60)]
    steps = np.diff(values)
    assert values[6] == pytest.approx(1), "one missed search is no reason"
    assert values[-1] == 0
    assert (steps <= 1e-6).all()
    assert steps.min() > -0.15, "it fades, it does not drop"


def test_a_face_that_appears_within_a_shot_fades_in() -> None:
    tracker = ImportanceTracker(ONLY_FACES, FACE_SIZE)
    tracker.step(gray_like(portrait()))
    values = [at(tracker.step(portrait()), FACE_AT) for _ in range(40)]
    assert values[0] == 0
    assert max(np.diff(values)) < 0.15
    assert values[-1] > 0.9


def test_the_face_mask_of_a_still_picture_is_constant() -> None:
    tracker = ImportanceTracker(ONLY_FACES, FACE_SIZE)
    planes = [tracker.step(portrait()) for _ in range(10)]
    assert max(float(np.abs(b - a).max()) for a, b in pairwise(planes)) < 0.08


# --- saliency


def test_the_only_different_shape_is_salient() -> None:
    field = np.full((128, 128), 120, np.uint8)
    field[::16] = field[:, ::16] = 90
    field[70:80, 40:50] = 255
    saliency = spectral_residual(field)
    assert saliency.shape == (64, 64)
    assert np.hypot(*(np.array(np.unravel_index(saliency.argmax(), saliency.shape)) - (37, 22))) < 4
    assert 0 <= saliency.min() <= saliency.max() < 1


def test_a_flat_picture_has_no_saliency() -> None:
    assert not spectral_residual(np.full((90, 70), 77, np.uint8)).any()
    assert not ImportanceTracker(ONLY_SALIENCY, SIZE).step(gray()).any()


# --- motion


def test_motion_relative_to_the_camera_is_important() -> None:
    tracker = ImportanceTracker(ONLY_MOTION, SIZE)
    tracker.step(gray())
    for _ in range(40):
        plane = tracker.step(gray(), moving_square())
    assert at(plane, (80, 45)) > 0.7
    assert at(plane, (10, 10)) < 0.01


def test_a_pan_is_not_motion_and_does_not_hide_motion() -> None:
    panned, static = (ImportanceTracker(ONLY_MOTION, SIZE) for _ in range(2))
    for tracker in (panned, static):
        tracker.step(gray())
    pan = np.array([7.0, -3.0], np.float32)
    np.testing.assert_allclose(
        panned.step(gray(), moving_square() + pan), static.step(gray(), moving_square()), atol=1e-5
    )
    assert not ImportanceTracker(ONLY_MOTION, SIZE).step(gray(), still() + pan).any()


# --- time


def test_a_step_is_followed_with_the_half_life() -> None:
    params = ImportanceParams(face=0, saliency=0, motion=1, half_life_frames=2 * CUES.cues_every_frames)
    tracker = ImportanceTracker(params, SIZE)
    tracker.step(gray())
    values = [at(tracker.step(gray(), moving_square()), (80, 45)) for _ in range(60)]
    assert values[2 * CUES.cues_every_frames - 1] == pytest.approx(values[-1] / 2, rel=0.01)


def test_a_cut_resets_the_state() -> None:
    tracker = ImportanceTracker(ImportanceParams(), FACE_SIZE)
    for _ in range(3):
        tracker.step(portrait(), np.zeros((240, 320, 2), np.float32))
    other = portrait((-150, 40))
    fresh = ImportanceTracker(ImportanceParams(), FACE_SIZE).step(other)
    nonsense = np.full((240, 320, 2), 50, np.float32)
    np.testing.assert_array_equal(tracker.step(other, nonsense, cut=True), fresh)


def test_a_restored_tracker_continues_with_the_same_bytes() -> None:
    rng = np.random.default_rng(0)
    frames = [portrait((-3 * i, i)) for i in range(14)]
    flows = [rng.normal(0, 2, (240, 320, 2)).astype(np.float32) for _ in frames]
    params = ImportanceParams()
    whole = ImportanceTracker(params, FACE_SIZE)
    whole.step(frames[0], mask=np.where(rng.random((240, 320)) < 0.1, 0.7, np.nan).astype(np.float32))
    for frame, flow in zip(frames[1:7], flows[1:7], strict=True):
        whole.step(frame, flow)
    resumed = ImportanceTracker(params, FACE_SIZE)
    resumed.restore(whole.state())
    for frame, flow in zip(frames[7:], flows[7:], strict=True):
        np.testing.assert_array_equal(whole.step(frame, flow), resumed.step(frame, flow))


def test_a_state_is_a_copy() -> None:
    tracker = ImportanceTracker(ImportanceParams(), FACE_SIZE)
    tracker.step(portrait())
    kept = tracker.state()
    before = {name: array.copy() for name, array in kept.items()}
    tracker.step(portrait((-20, 5)), np.ones((240, 320, 2), np.float32))
    for name, array in before.items():
        np.testing.assert_array_equal(kept[name], array)


# --- the user's mask


def test_a_mask_overrides_the_cues_until_the_next_mask() -> None:
    tracker = ImportanceTracker(ONLY_FACES, FACE_SIZE)
    left = np.zeros((240, 320), np.float32)
    left[:, :160] = 0.8
    tracker.step(portrait(), mask=left)
    kept = tracker.step(portrait(), cut=True)
    assert at(kept, (40, 120)) == pytest.approx(0.8)
    assert at(kept, FACE_AT) == 0
    assert tracker.step(portrait(), mask=np.ones((240, 320), bool)).min() == pytest.approx(1)


def test_nan_in_a_mask_uses_the_cues() -> None:
    mask = np.full((240, 320), np.nan, np.float32)
    mask[:, :100] = 0.5
    plane = ImportanceTracker(ONLY_FACES, FACE_SIZE).step(portrait(), mask=mask)
    assert at(plane, (30, 120)) == pytest.approx(0.5)
    assert at(plane, FACE_AT) == pytest.approx(1)


# --- shapes and refusals


@pytest.mark.parametrize("size", [(16, 16), (17, 331), (1281, 719)])
def test_the_map_has_the_frame_size_and_values_in_0_to_1(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    tracker = ImportanceTracker(ImportanceParams(), size)
    flow = rng.normal(0, 30, (size[1], size[0], 2)).astype(np.float32)
    for _ in range(2):
        plane = tracker.step(rng.integers(0, 256, (size[1], size[0], 3), np.uint8), flow)
    assert plane.shape == (size[1], size[0])
    assert plane.dtype == np.float32
    assert 0 <= plane.min() <= plane.max() <= 1


def test_gray_and_colour_give_the_same_map() -> None:
    colour = ImportanceTracker(ImportanceParams(), FACE_SIZE).step(portrait())
    gray_portrait = np.asarray(cv2.cvtColor(portrait(), cv2.COLOR_RGB2GRAY), np.uint8)
    plain = ImportanceTracker(ImportanceParams(), FACE_SIZE).step(gray_portrait)
    np.testing.assert_array_equal(colour, plain)


def test_all_cues_off_is_zero() -> None:
    assert not ImportanceTracker(NOTHING, FACE_SIZE).step(portrait()).any()


@pytest.mark.parametrize(
    ("mask", "word"),
    [
        (np.zeros((96, 160), np.uint8), "floating"),
        (np.full((96, 160), 2.0, np.float32), "0..1"),
        (np.full((96, 160), np.inf, np.float32), "0..1"),
        (np.zeros((90, 160), np.float32), "size"),
    ],
)
def test_an_invalid_mask_is_rejected(mask: NDArray[np.float32], word: str) -> None:
    with pytest.raises(BadFrame, match=word) as refusal:
        ImportanceTracker(NOTHING, SIZE).step(gray(), mask=mask)
    assert refusal.value.field == "mask"


def test_a_frame_of_another_size_is_rejected() -> None:
    tracker = ImportanceTracker(NOTHING, SIZE)
    with pytest.raises(BadFrame, match="another size"):
        tracker.step(portrait())


def test_the_flow_may_be_on_a_coarser_grid() -> None:
    """It is always given in px of the frame."""
    maps = []
    for by in (1, 2):
        tracker = ImportanceTracker(ONLY_MOTION, SIZE)
        maps += [[tracker.step(gray(), moving_square()[::by, ::by]) for _ in range(CUES.cues_every_frames + 1)][-1]]
    assert maps[0].max() > 0.2
    np.testing.assert_allclose(maps[1], maps[0], atol=0.1)
    assert np.abs(maps[1] - maps[0]).mean() < 0.01
