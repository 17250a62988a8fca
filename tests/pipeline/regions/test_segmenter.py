"""Coherent segmentation of synthetic pictures: complete labels, permanent ids, alpha of equation 4."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable

import cv2
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from pipeline.colour.lab8 import Lab8
from pipeline.frames import Flow
from pipeline.kernels.executors import Ready
from pipeline.perception.backward_maps import backward_maps
from pipeline.perception.motion import denoise
from pipeline.regions.edges import edges
from pipeline.regions.segmenter import Segmentation, Segmenter, SegmenterParams
from pipeline.scenes import SceneFrame, scene

Bytes = NDArray[np.uint8]
SHAPE = (48, 64)
PARAMS = SegmenterParams(
    flow_error_limit=12, growing_limit=20, misfit_slack=1.1, core_slack=0.4, boundary_margin=7, merge_similar=5,
    smallest_region=0.00015, distinct=12,
)  # fmt: skip
KEEP_ALL = SegmenterParams(
    flow_error_limit=12, growing_limit=20, misfit_slack=1.1, core_slack=0.4, boundary_margin=7, merge_similar=0,
    smallest_region=0, distinct=0,
)  # fmt: skip


class Stream:
    """Feeds pictures with their exact motion to a segmenter."""

    def __init__(
        self, params: SegmenterParams = PARAMS, shape: tuple[int, int] = SHAPE, importance: float = 0.0
    ) -> None:
        self.segmenter = Segmenter(params, (shape[1], shape[0]))
        self.importance = np.full(shape, importance, np.float32)
        self.before: Lab8 | None = None

    def step(self, lab: Lab8, flow: Flow | None = None, outline: Bytes | None = None) -> Segmentation:
        """`flow`: previous to this picture, px; None = nothing moves."""
        wall = np.zeros(lab.shape[:2], np.uint8) if outline is None else outline
        way: Flow | None = np.zeros((*lab.shape[:2], 2), np.float32) if flow is None else flow
        residual = None
        if self.before is None or way is None:
            way = None
        else:
            planes = np.ascontiguousarray(lab.transpose(2, 0, 1))
            residual = denoise(planes, self.before, way, backward_maps(way), 0.0, 6.0)[1]
        self.before = lab
        return check(self.segmenter.step(lab, Ready(wall), self.importance, way, residual), lab)


def check(made: Segmentation, lab: Lab8) -> Segmentation:
    """Check the invariants of every segmentation."""
    rows = len(made.ids)
    assert made.labels.dtype == np.int32 and made.labels.min() >= 1, "an unlabelled pixel"
    np.testing.assert_array_equal(np.unique(made.labels), np.arange(1, rows))
    np.testing.assert_array_equal(made.areas, np.bincount(made.labels.ravel(), minlength=rows))
    assert len(set(made.ids[1:].tolist())) == rows - 1
    for label in range(1, rows):
        np.testing.assert_allclose(made.means[label], lab[made.labels == label].mean(0), rtol=1e-5)
    assert made.alpha.min() >= 0 and made.alpha.max() <= 1
    assert not made.alpha[made.previous == 0].any()
    return made


def halves(boundary: int, left: int = 100, right: int = 150, shape: tuple[int, int] = SHAPE) -> Lab8:
    lab = np.full((*shape, 3), 128, np.uint8)
    lab[:, :boundary, 1], lab[:, boundary:, 1] = left, right
    return lab


# -- one frame


def test_all_regions_of_the_first_frame_are_new() -> None:
    made = Stream().step(halves(30))
    left, right = made.labels[0, 0], made.labels[0, -1]
    np.testing.assert_array_equal(made.labels, np.where(np.arange(64) < 30, left, right)[None].repeat(48, axis=0))
    np.testing.assert_array_equal(made.ids, [0, 1, 2])
    assert made.residual == 48 * 64 and not made.previous.any() and not made.alpha.any()


@pytest.mark.parametrize(("gap_px", "rooms"), [(0, 2), (4, 2), (9, 1)])
def test_an_edge_with_a_short_gap_separates_areas_of_one_colour(gap_px: int, rooms: int) -> None:
    wall = np.zeros(SHAPE, np.uint8)
    wall[:, 32] = 255
    wall[20 : 20 + gap_px, 32] = 0
    made = Stream(KEEP_ALL).step(halves(0), outline=wall)
    assert len({made.labels[5, 5], made.labels[5, 60]}) == rooms


@pytest.mark.parametrize(("importance", "found"), [(0.0, 1), (0.8, 2)])
def test_higher_importance_gives_finer_regions(importance: float, found: int) -> None:
    """20 (1.2 - I) is 24 where nothing matters and 8 at I = 0.8: 14 units apart are one region, or two."""
    assert len(Stream(importance=importance).step(halves(24, 100, 114)).ids) - 1 == found


@pytest.mark.parametrize("boundary", [32, 31, 20])
def test_two_colours_without_an_edge_between_them_are_two_regions(boundary: int) -> None:
    """The mean of two equal halves fits neither."""
    made = Stream(importance=0.5).step(halves(boundary, 90, 170))
    assert made.labels[5, 5] != made.labels[5, 60] and len(made.ids) == 3


def test_windows_are_found_before_their_wall_grows_over_them() -> None:
    """The windows differ from the wall by 14 CIELAB units, less than the growing limit of 24."""
    lab = np.full((120, 160, 3), (235, 128, 128), np.uint8)
    for top in (20, 60, 90):
        for left in (20, 70, 120):
            lab[top : top + 7, left : left + 8, 0] = 200
    made = Stream(shape=(120, 160)).step(lab)
    assert np.bincount(made.labels[lab[..., 0] == 200]).nonzero()[0].size == 9
    assert len(np.unique(made.labels[lab[..., 0] == 235])) == 1


def test_the_smallest_detail_grows_with_the_frame() -> None:
    """At 720 lines, what is 5 px wide may be a blurred edge; at 120 lines it is a detail. Both have 14 CIELAB units."""
    found = []
    for height, width in ((120, 160), (720, 720)):
        lab = np.full((height, width, 3), (235, 128, 128), np.uint8)
        lab[40:60, 20:25, 0] = 200
        lab[40:60, 60:80, 0] = 200
        labels = Stream(KEEP_ALL, (height, width)).step(lab).labels
        found.append([labels[50, x] != labels[50, 120] for x in (22, 70)])
    assert found == [[True, True], [False, True]]


def test_an_area_of_two_colours_is_not_merged_into_its_surroundings() -> None:
    lab = np.full((*SHAPE, 3), 128, np.uint8)
    lab[16:32, 12:32, 1], lab[16:32, 32:52, 1] = 90, 166
    made = Stream().step(lab)
    assert len({made.labels[y, x] for y, x in ((2, 2), (24, 20), (24, 44))}) == 3
    np.testing.assert_allclose(made.means[made.labels[24, 20]], [128, 90, 128], atol=3)


@pytest.mark.parametrize("lab", [halves(0), halves(32)], ids=["one colour", "two colours"])
def test_a_frame_of_edge_pixels_is_one_region(lab: Lab8) -> None:
    wall = np.full(SHAPE, 255, np.uint8)
    stream = Stream()
    assert (stream.step(lab, outline=wall).labels == 1).all()
    other = np.full((*SHAPE, 3), 250, np.uint8)
    made = stream.step(other, outline=wall)
    assert (made.labels == 1).all() and made.ids[1] == 2


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([(16, 16), (17, 31), (40, 23)]), st.booleans())
def test_no_pixel_is_ever_unlabelled(seed: int, shape: tuple[int, int], noisy: bool) -> None:
    """Random pictures, edges and motion: `check` looks at every frame."""
    rng = np.random.default_rng(seed)
    stream = Stream(importance=float(rng.uniform(0, 1)), shape=shape)
    used: set[int] = set()
    for _ in range(4):
        coarse = rng.integers(0, 256, shape if noisy else (4, 5, 3)).astype(np.uint8)
        lab = coarse[..., None].repeat(3, axis=-1) if noisy else cv2.resize(coarse, shape[::-1])
        outline = (rng.random(shape) < rng.choice([0.02, 0.5, 1.0])).astype(np.uint8) * 255
        flow = rng.normal(0, 2, (*shape, 2)).astype(np.float32)
        made = stream.step(np.ascontiguousarray(lab), flow, outline)
        born = set(made.ids[1:][made.previous[1:] == 0].tolist())
        assert not born & used
        used |= set(made.ids[1:].tolist())


# -- over time


def test_the_labels_of_a_still_picture_are_constant() -> None:
    stream = Stream()
    first = stream.step(halves(30))
    for _ in range(3):
        made = stream.step(halves(30))
        np.testing.assert_array_equal(made.labels, first.labels)
        np.testing.assert_array_equal(made.ids, first.ids)
        np.testing.assert_array_equal(made.alpha, [0, 1, 1])
        assert made.residual == 0


def test_alpha_of_a_known_motion() -> None:
    """Eq. 4: pixels propagated from R(i-1) into R(i), over the geometric mean of the two areas."""
    stream = Stream()
    stream.step(halves(28))
    made = stream.step(halves(34))
    left, right = made.labels[0, 0], made.labels[0, -1]
    np.testing.assert_array_equal(made.labels[20], np.where(np.arange(64) < 34, left, right))
    assert made.residual == 6 * 48
    wanted = {left: 28 / np.sqrt(28 * 34), right: 30 / np.sqrt(36 * 30)}
    np.testing.assert_allclose([made.alpha[left], made.alpha[right]], [wanted[left], wanted[right]], rtol=1e-6)
    np.testing.assert_array_equal(made.previous, [0, 1, 2])


def test_ids_move_with_the_picture() -> None:
    stream = Stream()
    stream.step(disc_at(20))
    flow = np.full((*SHAPE, 2), (3, 0), np.float32)
    for x in (23, 26, 29):
        made = stream.step(disc_at(x), flow)
        assert made.ids[made.labels[24, x]] == 2 and made.ids[made.labels[2, 40]] == 1
        assert (made.labels == 2).sum() == pytest.approx((disc_at(x)[..., 1] == 170).sum(), rel=0.05)
        assert made.alpha[2] > 0.97


def test_a_slow_pan_is_followed() -> None:
    stream = Stream()
    flow = np.full((*SHAPE, 2), (0.4, 0), np.float32)
    for step in range(11):
        made = stream.step(disc_at(24 + 0.4 * step), flow if step else None)
    assert len(made.ids) == 3 and made.ids[made.labels[24, 28]] == 2
    xs = np.nonzero(made.labels == made.labels[24, 28])[1]
    assert abs((xs.min() + xs.max()) / 2 - 28) <= 0.5


def test_a_region_that_reappears_has_a_new_id() -> None:
    """No region persists while it is hidden, and no id is used twice."""
    stream = Stream()
    names = []
    for step in range(16):
        lab = disc_at(4 + 4 * step, radius=6)
        lab[:, 26:40] = (60, 128, 170)
        flow = np.zeros((*SHAPE, 2), np.float32)
        flow[disc_at(4 * step, radius=6)[..., 1] == 170] = (4, 0)
        flow[:, 26:40] = 0
        made = stream.step(lab, flow)
        shown = lab[..., 1] == 170
        names.append({int(made.ids[k]) for k in np.unique(made.labels[shown])} if shown.any() else set())
        if shown.sum() > 40:
            disc = np.bincount(made.labels[shown]).argmax()
            assert lab[..., 1][made.labels == disc].min() == 170, "the disc's region holds nothing but the disc"
    hidden = [step for step in range(16) if not names[step]]
    assert hidden and names[2] and names[-3]
    assert not names[2] & names[-3]
    assert len(names[2]) == len(names[-3]) == 1


def disc_at(x: float, radius: int = 9) -> Lab8:
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    lab = np.full((*SHAPE, 3), 128, np.uint8)
    lab[(columns - x) ** 2 + (rows - 24) ** 2 <= radius * radius] = (128, 170, 128)
    return lab


def test_ground_that_is_uncovered_does_not_keep_the_label_of_a_fast_object() -> None:
    """The colours differ by less than the flow error limit, and the flow has missed the motion."""
    stream = Stream(importance=0.4)
    before = stream.step(square(at=10))
    after = stream.step(square(at=40))
    ground = before.ids[before.labels[2, 2]]
    assert before.ids[before.labels[20, 15]] != ground
    assert after.ids[after.labels[20, 15]] == ground, "a ghost of the object"
    assert after.ids[after.labels[20, 45]] != ground, "the object has become ground"


def square(at: int) -> Lab8:
    """A square of 12 px in columns from `at` on, 10 CIELAB units from its ground."""
    lab = np.full((*SHAPE, 3), 128, np.uint8)
    lab[16:28, at : at + 12, 1] = 138
    return lab


def test_an_unrelated_picture_is_segmented_anew() -> None:
    stream = Stream()
    first = stream.step(halves(30))
    made = stream.step(disc_at(32))
    assert made.residual > 0.9 * 48 * 64
    assert made.labels[24, 32] != made.labels[2, 2]
    assert not set(made.ids[1:].tolist()) & set(first.ids[1:].tolist())


def test_objects_that_fade_in_get_their_own_regions() -> None:
    stream = Stream()
    full = disc_at(32).astype(float)
    black = np.array([0, 128, 128.0])
    for light in np.linspace(0, 1, 9):
        lab = np.rint(black + light * (full - black)).astype(np.uint8)
        flow = np.zeros((*SHAPE, 2), np.float32)
        residual = np.zeros(SHAPE, np.uint8)
        edge = np.zeros(SHAPE, np.uint8)
        made = check(stream.segmenter.step(lab, Ready(edge), stream.importance, flow, residual, fading=True), lab)
    np.testing.assert_array_equal(made.labels == made.labels[24, 32], full[..., 1] == 170)


def test_reset_starts_with_the_given_id() -> None:
    stream = Stream()
    stream.step(halves(30))
    stream.segmenter.reset(1000)
    stream.before = None
    made = stream.step(halves(30))
    np.testing.assert_array_equal(made.ids, [0, 1000, 1001])
    assert not made.previous.any()


def test_a_restored_segmenter_continues_with_the_same_bytes() -> None:
    pictures = [disc_at(20 + 2.5 * step) for step in range(6)]
    flow = np.full((*SHAPE, 2), (2.5, 0.2), np.float32)
    one, two = Stream(), Stream()
    for lab in pictures[:3]:
        one.step(lab, flow)
    two.segmenter.restore({key: array.copy() for key, array in one.segmenter.state().items()})
    two.before = pictures[2]
    for lab in pictures[3:]:
        a, b = one.step(lab, flow), two.step(lab, flow)
        for name in ("labels", "ids", "areas", "means", "previous", "alpha"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_a_state_is_not_changed_by_later_frames() -> None:
    stream = Stream()
    flow = np.full((*SHAPE, 2), (0.4, 0), np.float32)
    stream.step(disc_at(20))
    stream.step(disc_at(20.4), flow)
    state = stream.segmenter.state()
    kept = {key: array.copy() for key, array in state.items()}
    stream.step(disc_at(20.8), flow)
    stream.segmenter.reset(50)
    stream.step(disc_at(30))
    for key, array in state.items():
        np.testing.assert_array_equal(array, kept[key])


# -- scenes with exact truth


@pytest.mark.parametrize(("name", "pure"), [("shapes", 0.97), ("portrait", 0.85)])
def test_ids_stay_on_their_object(name: str, pure: float) -> None:
    """A region may straddle two objects that look alike; but a name never wanders from one object to another."""
    size = (96, 64)
    shot = scene(name, size, frames=8, fps=12)
    stream = Stream(shape=(64, 96), importance=0.4)
    pixels: dict[int, Counter[int]] = defaultdict(Counter)
    at_once = 0
    before: SceneFrame | None = None
    for index in range(8):
        truth = shot.frame(index)
        lab = np.asarray(cv2.cvtColor(cv2.GaussianBlur(truth.image, (0, 0), 0.7), cv2.COLOR_RGB2LAB), np.uint8)
        outline = edges(np.ascontiguousarray(lab.transpose(2, 0, 1)), stream.importance, 90.0)
        made = stream.step(lab, before.velocity_next if before else None, outline)
        before = truth
        for label in range(1, len(made.ids)):
            inside = Counter(truth.ids[made.labels == label].tolist())
            at_once += inside.most_common(1)[0][1]
            pixels[int(made.ids[label])] += inside
    frame_pixels = 8 * 64 * 96
    over_time = sum(counts.most_common(1)[0][1] for counts in pixels.values())
    assert at_once / frame_pixels > pure
    assert over_time / frame_pixels > at_once / frame_pixels - 0.01
    assert regions_kept(pixels.values(), 64 * 96 // 100)


def regions_kept(counts: Iterable[Counter[int]], large_px: int) -> bool:
    """Most of the picture belongs to ids that exist for most of the shot."""
    areas = sorted((sum(inside.values()) for inside in counts), reverse=True)
    lasting = [area for area in areas if area >= 6 * large_px]
    return sum(lasting) > 0.8 * sum(areas)
