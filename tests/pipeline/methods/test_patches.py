"""Painting patches on scenes with ground truth: clusters, occlusion, a pan, user inputs, baselines, plans."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from benchmarks.patches_baseline import advected_strokes
from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods import parse_params
from pipeline.methods.base import PlanContext, VideoInfo
from pipeline.methods.local import LocalContext, iterate_plan, run_plan
from pipeline.methods.patches import Patches, patch_construction
from pipeline.methods.patches.clustering import plan_cluster
from pipeline.methods.patches.correction import FrameSpan, spans
from pipeline.methods.patches.motion_clustering import uncertainty_of
from pipeline.methods.patches.painter import TABLE_1, HertzmannPainter
from pipeline.methods.patches.params import STROKE_STYLES, PatchesParams
from pipeline.methods.patches.patch_construction import patch_painter
from pipeline.methods.patches.patch_styles import label_styles, params_of
from pipeline.methods.patches.patch_track import FADE_FRAMES, LARGE_AREA, PatchTrack, patch_tracks
from pipeline.methods.patches.scan import PAPER_SIDE, WorkingGrid, label_map, mask_map
from tests.pipeline.methods.frames import painted
from tests.pipeline.methods.patch_scenes import (
    HIDDEN,
    PAN_PX,
    SIZE,
    clustered,
    label_maps,
    paint,
    painted_scene,
    rand_index,
    swarm,
    truth,
)

WALL, DISC, SLAB, BLOB = 1, 2, 3, 4


@cache
def output() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return painted(painted_scene())


def label_of(object_id: int, index: int) -> int:
    """The most frequent label of an object's pixels in a frame."""
    return int(np.bincount(label_maps(painted_scene())[index][truth()[index].ids == object_id]).argmax())


# -- clusters


def test_clusters_agree_with_the_true_objects() -> None:
    maps = label_maps(painted_scene())
    scores = [rand_index(maps[index], shot.ids) for index, shot in enumerate(truth())]
    assert len(scores) == len(truth()) and min(scores) >= 0.9
    assert np.mean(scores) >= 0.97


def test_a_label_denotes_the_same_object_in_all_windows_and_tasks() -> None:
    assert len(truth()) > 12, "more than one run of frames"
    for object_id in (WALL, SLAB):
        labels = {label_of(object_id, index) for index in range(len(truth()))}
        assert labels == {label_of(object_id, 0)}


def test_an_object_hidden_for_three_frames_returns_with_its_label() -> None:
    before, after = HIDDEN.start - 1, HIDDEN.stop
    assert label_of(BLOB, after) == label_of(BLOB, before) > 1


def test_an_object_hidden_for_three_frames_returns_with_its_strokes() -> None:
    """Paintings before and after the occlusion are compared along the true motion."""
    before, after = HIDDEN.start - 1, HIDDEN.stop
    y, x = np.nonzero(cv2.erode((truth()[after].ids == BLOB).astype(np.uint8), np.ones((7, 7), np.uint8)))
    gap = after - before
    before_at_after = cv2.remap(
        output()[before], np.float32(x - 1.0 * gap)[None], np.float32(y + 0.5 * gap)[None], cv2.INTER_LINEAR
    )
    difference = np.abs(output()[after][y, x].astype(float) - before_at_after[0]).mean()
    baseline = painted(independent_frames())
    before_at_after = cv2.remap(
        baseline[before], np.float32(x - 1.0 * gap)[None], np.float32(y + 0.5 * gap)[None], cv2.INTER_LINEAR
    )
    per_frame = np.abs(baseline[after][y, x].astype(float) - before_at_after[0]).mean()
    assert difference < 4 and difference < 0.6 * per_frame


def test_a_window_shorter_than_the_occlusion_gives_a_new_label() -> None:
    context = paint([shot.image for shot in truth()[: HIDDEN.stop + 2]], window=3)
    maps, ids = label_maps(context), truth()
    before, after = (
        int(np.bincount(maps[index][ids[index].ids == BLOB]).argmax()) for index in (HIDDEN.start - 1, HIDDEN.stop + 1)
    )
    assert before > 1 and after != before


def test_uncertainty_is_derived_from_the_probability_of_the_random_walk() -> None:
    labels = np.array([[1, 1, 2, 2], [1, 1, 2, 0]], np.int32)
    probability = np.array([[1, 1, 0.75, 0.5], [1, 0.5, 0.75, 0]], np.float32)
    assert uncertainty_of(labels, probability) == {1: 0.25, 2: 0.667}


# -- painting


@pytest.mark.parametrize("temporal", ["on", "off"])
def test_deep_frames_are_those_of_the_film_before_they_are_rounded(temporal: str) -> None:
    films = []
    for deep in (False, True):
        context = LocalContext(
            parse_params(Patches(), {"temporal": temporal}), [s.image for s in truth()[:5]], deep=deep
        )
        run_plan(Patches(), context)
        films.append(painted(context))
    assert (films[0].dtype, films[1].dtype) == (np.uint8, np.uint16)
    apart = np.abs(films[0] - films[1] / 257)
    assert apart.mean() < 0.3 and np.percentile(apart, 99.5) < 1, "paint is replaced at few other pixels"
    assert len(np.unique(films[1][0, ..., 1])) > 1000


@cache
def independent_frames() -> LocalContext:
    return paint([shot.image for shot in truth()[: HIDDEN.stop + 1]], temporal="off")


def test_background_strokes_follow_the_pan_and_do_not_change_at_the_border() -> None:
    for index in range(len(truth()) - 1):
        now, then = output()[index].astype(float), output()[index + 1].astype(float)
        change = np.abs(then[:, :-PAN_PX] - now[:, PAN_PX:]).mean(axis=-1)
        wall = (truth()[index + 1].ids == WALL)[:, :-PAN_PX] & (truth()[index].ids == WALL)[:, PAN_PX:]
        border = wall.copy()
        border[:, :-16] = False
        assert change[wall].mean() < 1 and change[border].mean() < 1


def test_frames_have_no_holes_and_no_black_seams() -> None:
    for shot, frame in zip(truth(), output(), strict=True):
        darkest = cv2.erode(shot.image.min(axis=-1), np.ones((25, 25), np.uint8)).astype(int)
        assert (frame.min(axis=-1) >= darkest - 60).all()
        near = cv2.GaussianBlur(frame, (0, 0), 4).astype(float) - cv2.GaussianBlur(shot.image, (0, 0), 4)
        assert np.abs(near).max() < 90


def test_relaxation_reduces_the_energy_of_every_patch() -> None:
    context = paint([shot.image for shot in truth()[:8]], artefacts=frozenset({"energy"}))
    reports = [
        json.loads(archive.read(name))
        for key, data in context.files.items()
        if key.startswith("energy-")
        for archive in [zipfile.ZipFile(io.BytesIO(data))]
        for name in archive.namelist()
        if name.endswith(".json")
    ]
    assert len(reports) >= 3
    for report in reports:
        pairs, every = report["pairs"], report["all"]
        assert pairs["after"] <= pairs["before"] and every["after"] <= every["before"]
        assert pairs["iterations"] <= 10 * pairs["pairs"] and every["iterations"] <= 10
    assert sum(r["pairs"]["after"] for r in reports) < 0.9 * sum(r["pairs"]["before"] for r in reports)


def test_patches_change_less_than_advected_strokes_and_those_less_than_independent_frames() -> None:
    frames = [shot.image for shot in truth()[:6]]

    def change(video: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> float:
        return float(np.abs(video[1:, :, :-PAN_PX].astype(float) - video[:-1, :, PAN_PX:]).mean())

    advected, independent = np.stack(advected_strokes(frames, PatchesParams())), painted(independent_frames())[:6]
    assert change(output()[:6]) < 0.7 * change(advected) < 0.7 * change(independent)


def test_the_baseline_is_no_value_of_temporal_any_more() -> None:
    with pytest.raises(BadParameter, match="'strokes' no longer exists") as caught:
        parse_params(Patches(), {"temporal": "strokes"})
    assert caught.value.field == "params.temporal" and "temporal=off" in caught.value.remedy


def test_on_threes_each_painting_is_shown_for_three_frames() -> None:
    frames = [shot.image for shot in truth()[:7]]
    on_threes, each = painted(paint(frames, frames_per_painting=3, temporal="off")), painted(independent_frames())
    for index, frame in enumerate(on_threes):
        np.testing.assert_array_equal(frame, each[index // 3 * 3])


def test_a_painting_may_span_two_runs() -> None:
    frames = [shot.image for shot in truth()]
    output = painted(paint(frames, frames_per_painting=5, temporal="off"))
    np.testing.assert_array_equal(output[12], output[10])


# -- user inputs


def test_a_corrected_label_map_changes_the_frames_before_and_after() -> None:
    frames = [shot.image for shot in truth()[:6]]
    drawn = np.where(truth()[4].ids == SLAB, 77, np.where(truth()[4].ids == WALL, 1, 9)).astype(np.uint16)
    first = np.where(truth()[0].ids == SLAB, 77, np.where(truth()[0].ids == WALL, 1, 9)).astype(np.uint16)
    context = paint(frames, {"labels": {0: first, 4: drawn}})
    maps = label_maps(context)
    np.testing.assert_array_equal(maps[4], drawn)
    for index, shot in enumerate(truth()[:6]):
        assert rand_index(maps[index], np.where(shot.ids == BLOB, DISC, shot.ids)) > 0.9
        assert np.bincount(maps[index][shot.ids == SLAB]).argmax() == 77


def test_labels_between_keyframes_are_blended_from_both() -> None:
    """The map of frame 0 has one label; in the map of frame 5 the slab has its own, and its share grows in between."""
    frames = [shot.image for shot in truth()[:6]]
    whole = np.ones(SIZE[::-1], np.uint16)
    drawn = np.where(truth()[5].ids == SLAB, 5, 1).astype(np.uint16)
    maps = label_maps(clustered(frames, {"labels": {0: whole, 5: drawn}}))
    share = [(maps[index][truth()[index].ids == SLAB] == 5).mean() for index in range(6)]
    assert share[0] == 0 and share[5] == 1
    assert share[4] > 0.8 and share == sorted(share)


def test_a_correction_of_an_interval_leaves_the_labels_of_all_other_frames_as_they_are() -> None:
    """The slab gets label 77 in frames 4 to 8; frames 0 to 11 are the first run, 12 and 13 the second."""
    frames = [shot.image for shot in truth()]
    drawn = np.where(truth()[6].ids == SLAB, 77, np.where(truth()[6].ids == WALL, 1, 9)).astype(np.uint16)
    given = {"labels": {6: drawn}, "label_intervals": [{"frame": 6, "before": 2, "after": 2}]}
    corrected = clustered(frames, given)
    maps, draft = label_maps(corrected), label_maps(painted_scene())
    for index in range(14):
        assert (77 in maps[index]) == (4 <= index <= 8)
        if not 4 <= index <= 8:
            np.testing.assert_array_equal(maps[index], draft[index])
    np.testing.assert_array_equal(maps[6], drawn)
    assert np.bincount(maps[5][truth()[5].ids == SLAB]).argmax() == 77
    solved = {name for step, name in corrected.kept if step == "correct"}
    assert solved == {"front-0000004-0000000", "back-0000004-0000000", "run-0000000"}


def test_new_clusters_of_an_interval_have_numbers_that_the_shot_does_not_use() -> None:
    frames = [shot.image for shot in truth()]
    draft = label_maps(painted_scene())
    used = {int(label) for labels in draft.values() for label in np.unique(labels)}
    everything = np.ones(SIZE[::-1], np.uint16)
    given = {"labels": {3: everything}, "label_intervals": [{"frame": 3, "before": 0, "after": 9}]}
    maps = label_maps(clustered(frames, given))
    fresh = {int(label) for index in range(4, 13) for label in np.unique(maps[index])} - used
    assert fresh and min(fresh) > max(used)


def test_intervals_of_corrections_are_joined_where_they_overlap() -> None:
    assert spans({5: (2, 2), 8: (2, 0), 20: (1, 9), 40: None}, 0, 24) == [
        FrameSpan(3, 9, (5, 8)),
        FrameSpan(19, 24, (20,)),
    ]
    assert spans({5: (2, 2), 8: None}, 0, 24) == [FrameSpan(0, 24, (5, 8))]


def test_a_mask_determines_the_foreground() -> None:
    frames = [shot.image for shot in truth()[:6]]
    mask = np.where(truth()[0].ids == SLAB, 255, 0).astype(np.uint8)
    maps = label_maps(paint(frames, {"masks": {0: mask}}))
    for index, shot in enumerate(truth()[:6]):
        fore = maps[index] != 1
        overlap = (fore & (shot.ids == SLAB)).sum() / (fore | (shot.ids == SLAB)).sum()
        assert overlap > 0.85


def test_scribbles_can_be_used_as_masks() -> None:
    frames = [shot.image for shot in truth()[:2]]
    drawn = np.full(SIZE[::-1], 128, np.uint8)
    ids = truth()[0].ids
    drawn[cv2.erode((ids == SLAB).astype(np.uint8), np.ones((15, 15), np.uint8)) > 0] = 255
    drawn[cv2.erode((ids != SLAB).astype(np.uint8), np.ones((25, 25), np.uint8)) > 0] = 0
    fore = label_maps(paint(frames, {"masks": {0: drawn}}))[0] != 1
    assert (fore & (ids == SLAB)).sum() / (fore | (ids == SLAB)).sum() > 0.85


def test_a_patch_can_have_its_own_style() -> None:
    params = PatchesParams(background_style="wash")
    own = label_styles({"3": "circles"})
    assert [params_of(label, params, own).style for label in (1, 2, 3)] == ["wash", "hertzmann", "circles"]
    frames = [shot.image for shot in truth()[:3]]
    plain, styled = paint(frames), paint(frames, {"styles": {"background": "circles"}})
    slab = cv2.erode((truth()[1].ids == SLAB).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    change = np.abs(painted(plain)[1].astype(float) - painted(styled)[1]).mean(axis=-1)
    assert change[slab].mean() < 1 < change[truth()[1].ids == WALL].mean()


def test_a_patch_can_have_its_own_parameters() -> None:
    params = PatchesParams(stroke_size=2)
    own = label_styles({"background": {"style": "wash", "jitter": 0.5}, "4": {"stroke_size": 0.5}})
    wall, second_wall, slab = (params_of(label, params, own, label == 4) for label in (1, 4, 7))
    assert (wall.style, wall.jitter, wall.stroke_size) == ("wash", 0.5, 2)
    assert (second_wall.style, second_wall.jitter, second_wall.stroke_size) == ("wash", 0.5, 0.5)
    assert slab == params
    frames = [shot.image for shot in truth()[:3]]
    plain, finer = paint(frames), paint(frames, {"styles": {"background": {"stroke_size": 0.25}}})
    wall_at = truth()[1].ids == WALL
    change = np.abs(painted(plain)[1].astype(float) - painted(finer)[1]).mean(axis=-1)
    slab_at = cv2.erode((truth()[1].ids == SLAB).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    assert change[slab_at].mean() < 1 < change[wall_at].mean()
    errors = [np.abs(painted(each)[1].astype(float) - frames[1])[wall_at].mean() for each in (plain, finer)]
    assert errors[1] < errors[0]


@pytest.mark.parametrize(
    ("styles", "field"),
    [
        ({"2": {"stroke_size": 9}}, "inputs.styles.2.stroke_size"),
        ({"2": {"window": 3}}, "inputs.styles.2.window"),
        ({"2": {"style": "cubist"}}, "inputs.styles.2.style"),
        ([], "inputs.styles"),
        ({"2": "cubist"}, "inputs.styles.2"),
        ({"2": ["wash"]}, "inputs.styles.2"),
        ({"sky": "wash"}, "inputs.styles.sky"),
        ({"0": "wash"}, "inputs.styles.0"),
    ],
)
def test_an_invalid_style_is_reported_with_its_path(styles: object, field: str) -> None:
    with pytest.raises(BadParameter) as caught:
        label_styles(styles)
    assert caught.value.field == field and caught.value.remedy


def test_a_map_with_another_aspect_ratio_or_with_colours_is_refused() -> None:
    grid = WorkingGrid.of(SIZE)
    for image in (
        np.zeros((100, 100), np.uint8),
        np.dstack([np.eye(144, 240, dtype=np.uint8)] * 2 + [np.ones(SIZE[::-1], np.uint8)]),
    ):
        with pytest.raises(BadParameter) as caught:
            label_map(image, grid, 3)
        assert caught.value.field == "inputs.labels[3]" and caught.value.remedy
    with pytest.raises(BadParameter) as caught:
        mask_map(np.zeros((100, 100), np.uint8), grid, 2)
    assert caught.value.field == "inputs.masks[2]"


@pytest.mark.parametrize(
    ("inputs", "field"),
    [
        ({"labels": {7: np.ones(SIZE[::-1], np.uint8)}}, "inputs.labels[7]"),
        ({"masks": {0: np.zeros((10, 90), np.uint8)}}, "inputs.masks[0]"),
        ({"styles": {"background": "cubist"}}, "inputs.styles.background"),
        ({"label_intervals": [{"frame": 1, "before": -2, "after": 0}]}, "inputs.label_intervals[0]"),
    ],
)
def test_user_inputs_are_validated_in_the_first_step(inputs: dict[str, object], field: str) -> None:
    context = LocalContext(PatchesParams(), [truth()[0].image] * 2, inputs)
    with pytest.raises(BadParameter) as caught:
        list(iterate_plan(Patches(), context, steps=1))
    assert caught.value.field == field and caught.value.remedy


# -- artefacts


def test_label_map_artefacts_can_be_used_as_inputs() -> None:
    context = paint([shot.image for shot in truth()[:3]], artefacts=frozenset({"labels", "overlay", "patches"}))
    archive = zipfile.ZipFile(io.BytesIO(context.files["labels-run-0000000"]))
    assert archive.namelist() == ["000000.png", "000001.png", "000002.png"]
    image = cv2.imdecode(np.frombuffer(archive.read("000001.png"), np.uint8), cv2.IMREAD_UNCHANGED)
    assert image.dtype == np.uint16
    assert (
        image.shape == SIZE[::-1]
        and (label_map(image, WorkingGrid.of(SIZE), 1) == label_maps(context)[1]).mean() > 0.97
    )
    overlays = zipfile.ZipFile(io.BytesIO(context.files["overlay-run-0000000"]))
    overlay = cv2.imdecode(np.frombuffer(overlays.read("000001.png"), np.uint8), cv2.IMREAD_COLOR)
    assert overlay.shape == (*SIZE[::-1], 3) and np.ptp(overlay.astype(int), axis=2).max() > 60
    pictures = [name for name in context.files if name.startswith("patches-")]
    names = [name for key in pictures for name in zipfile.ZipFile(io.BytesIO(context.files[key])).namelist()]
    assert len(names) >= 6 and all(name.endswith(("-panorama.png", "-painting.png")) for name in names)


# -- plans and styles


def context(frames: int, travel: float = 0.0, longest: int = 120) -> PlanContext:
    """Plan context with the results of a background that covers every frame, in one run."""
    row = [0, frames - 1, 1000 * frames, frames // 3, 1000, travel]
    results = {
        "scan": {"video": {"frames": frames, "cuts": []}, "inputs": {"corrections": {}}}, "correct": {},
        "cluster": {"run-0000000": {"labels": {"1": row}}},
    }  # fmt: skip
    return PlanContext(PatchesParams(longest_patch=longest), 0, VideoInfo(320, 180, frames, 25.0, 1.0), results=results)


def test_patch_tracks_are_limited_in_length_and_cross_fade() -> None:
    tracks = patch_tracks(context(100, longest=40))
    assert len(tracks) == 3 and (tracks[0].start, tracks[-1].stop) == (0, 100)
    assert all(track.stop - track.start <= 40 + FADE_FRAMES for track in tracks)
    for index in range(100):
        weights = [track.fade_weight(index) for track in tracks if track.start <= index < track.stop]
        assert sum(weights) == pytest.approx(1)


def test_a_patch_has_the_same_bytes_in_one_task_and_in_many(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = [shot.image for shot in truth()[:10]]
    made = []
    for area, parts in ((0.0, 12), (0.0, 1), (1e9, 1)):
        monkeypatch.setattr(patch_construction, "SINGLE_TASK_AREA", area)
        monkeypatch.setattr(patch_construction, "MOST_PARTS", parts)
        made.append(paint(frames))
    names = [{key for step, key in context.kept if step == "patch"} for context in made]
    assert [any("-sum-1" in key for key in each) for each in names] == [True, True, False]
    for other in made[1:]:
        np.testing.assert_array_equal(painted(made[0]), painted(other))


def test_flow_tasks_have_no_dependencies_and_label_tasks_depend_only_on_their_inputs() -> None:
    tasks = {task.key: task for task in plan_cluster(context(30))}
    assert [task.after for key, task in tasks.items() if key.startswith("flow")] == [(), (), ()]
    assert tasks["run-0000000"].after == ("flow-0000000",)
    assert set(tasks["run-0000024"].after) == {"flow-0000024", "flow-0000012", "run-0000012"}
    places = list(tasks)
    assert all(places.index(need) < places.index(key) for key, task in tasks.items() for need in task.after)


def test_a_cluster_that_travels_far_has_more_tracks() -> None:
    assert len(patch_tracks(context(100))) == 1
    assert len(patch_tracks(context(100, travel=5 * 320.0))) >= 2


def test_one_painting_can_survive_a_longer_pan() -> None:
    """Figure 5c of zhang2011patches: a pan that three paintings show by turns is shown by one."""
    given = context(100, travel=5 * 320.0)
    counts = []
    for limit in (1.0, 2.5, 5.0):
        params = PatchesParams(longest_travel=limit)
        counts.append(len(patch_tracks(replace(given, params=params))))
    assert counts == [3, 2, 1]


def test_small_objects_are_patches_of_finer_strokes() -> None:
    """Eight squares of 12 px: none is a patch by default; with smaller clusters most are, and they have the strokes of
    the second row of table 1 if the area of one frame counts."""
    counts, radii = [], []
    for values in ({}, {"smallest_cluster": 0.3}, {"smallest_cluster": 0.3, "table_area": "mean"}):
        made = LocalContext(parse_params(Patches(), values), swarm())
        tracks = [PatchTrack(**task.args["track"]) for task in run_plan(Patches(), made)["patch"]]
        objects = [track for track in tracks if track.label > 1]
        unit = SIZE[1] / PAPER_SIDE
        counts.append(len(objects))
        radii.append([patch_painter(track, made).brush.size_px / 2 / unit for track in objects])
    assert counts[0] == 0 and counts[1] == counts[2] >= 6
    assert set(np.round(radii[1])) <= {4, 8} and np.median(radii[1]) == pytest.approx(8)
    assert np.median(radii[2]) == pytest.approx(4)


def test_a_background_may_be_several_patches() -> None:
    """A wall, and a nearer one that moves faster across the frame. The user divides them once, as in the paper."""
    far, near = (
        cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(144, 400)).astype(np.float32), (0, 0), 1.6) * 130
        + mean
        for seed, mean in ((1, 90), (2, 160))
    )
    frames, divided = [], np.ones((144, 240), np.uint8)
    divided[:, 150:] = 7
    for k in range(8):
        frame = np.hstack([far[:, 2 * k : 150 - 3 * k], near[:, : 90 + 5 * k]])
        frames.append(np.clip(np.repeat(frame[..., None], 3, axis=2), 0, 255).astype(np.uint8))
    styles = []
    for count in (1, 2):
        values = {"background_style": "wash", "background_patches": count, "face_detail": 0}
        made = LocalContext(parse_params(Patches(), values), frames, {"labels": {0: divided}})
        tracks = [PatchTrack(**task.args["track"]) for task in run_plan(Patches(), made)["patch"]]
        styles.append({track.label: patch_painter(track, made).style for track in tracks})
    wash, hertzmann = STROKE_STYLES["wash"], STROKE_STYLES["hertzmann"]
    assert styles == [{1: wash, 7: hertzmann}, {1: wash, 7: wash}]
    last = made.kept["correct", "run-0000000"]["labels-7"]
    assert (last[:, :105] == 1).mean() > 0.95 and (last[:, 125:] == 7).mean() > 0.9


def test_a_patch_track_survives_json_but_for_an_area_that_decides_nothing() -> None:
    track = patch_tracks(context(50))[0]
    told = PatchTrack(**json.loads(json.dumps(track.args("all-frames"))))
    assert told == replace(track, area=LARGE_AREA) and track.area > LARGE_AREA
    mean = PatchTrack(**json.loads(json.dumps(track.args("mean"))))
    assert mean.table_area("mean") == min(track.table_area("mean"), LARGE_AREA)


@pytest.mark.parametrize("size", [(16, 16), (640, 360), (7680, 4320), (7680, 7680)])
def test_brushes_do_not_depend_on_areas_above_the_largest_that_is_told(size: tuple[int, int]) -> None:
    grid = WorkingGrid.of(size)
    assert LARGE_AREA * grid.ratio[0] * grid.ratio[1] / grid.unit**2 > TABLE_1[-2][0]


@pytest.mark.parametrize(("area", "radius", "length"), [(64, 2, 16), (65, 4, 32), (512, 4, 32), (513, 8, 128)])
def test_brush_sizes_follow_table_1(area: int, radius: int, length: int) -> None:
    painter = HertzmannPainter.of("hertzmann", area, 344, PatchesParams(), 0)
    assert (painter.brush.size_px, painter.brush.length_px) == (2 * radius, length)
    twice = HertzmannPainter.of("hertzmann", 4 * area, 688, PatchesParams(), 0)
    assert (twice.brush.size_px, twice.brush.length_px) == (4 * radius, 2 * length)


def test_a_single_frame_is_painted_like_an_independent_frame() -> None:
    frame: Frame = truth()[0].image
    np.testing.assert_array_equal(painted(paint([frame]))[0], painted(paint([frame], temporal="off"))[0])
