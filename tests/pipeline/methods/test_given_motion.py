"""Motion vectors of EXR frames replace optical flow in every method."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
import pytest

from pipeline.colour.ocio import linear
from pipeline.formats.exr import exr_bytes
from pipeline.methods import method, methods, parse_params
from pipeline.methods.given_motion import GivenMotion, given_motion
from pipeline.methods.local import LocalContext, required_inputs, run_plan
from pipeline.passes.sequence import pass_sequence
from pipeline.scenes import scene
from pipeline.video.guard.pictures import guarded_planes, guarded_raw
from tests.pipeline.methods.shots import SIZE as FULL
from tests.pipeline.methods.shots import pictures, scene_files, shot_context

SIZE, FRAMES = (96, 64), 4
ESTIMATORS = (
    "abstraction.analysis.estimate", "multistyle.backward_flow.estimate", "multistyle.label_propagation.estimate",
    "patches.window_flow.estimate", "patches.window_flow.dis", "steady.plan.motion",
    "analogy.level_animation.estimate",
)  # fmt: skip


def shot(index: int) -> Any:
    return scene("shapes", SIZE, frames=12, fps=12).frame(index)


def files(written: Callable[[np.ndarray, np.ndarray], Mapping[str, np.ndarray]]) -> dict[str, bytes]:
    """Frames of a scene as EXR files with vectors."""
    made = {}
    for index in range(FRAMES):
        light = linear(shot(index).image.astype(np.float32) / 255)
        planes = {f"Combined.{c}": light[..., k] for k, c in enumerate("RGB")}
        planes |= written(shot(index).velocity_next, shot(index).velocity_previous)
        made[f"beauty.{1001 + index}.exr"] = exr_bytes(planes)
    return made


def blender(plus: np.ndarray, minus: np.ndarray) -> Mapping[str, np.ndarray]:
    planes = {"Vector.X": -minus[..., 0], "Vector.Y": minus[..., 1]}
    return planes | {"Vector.Z": -plus[..., 0], "Vector.W": plus[..., 1]}


def one_way(plus: np.ndarray, minus: np.ndarray) -> Mapping[str, np.ndarray]:
    return {"motionvector.R": plus[..., 0], "motionvector.G": -plus[..., 1]}


def motion_of(written: Any) -> GivenMotion:
    return GivenMotion(pass_sequence(files(written), guarded_planes, guarded_raw))


@contextmanager
def no_estimates() -> Iterator[None]:
    """Every estimate of optical flow in a method fails."""

    def refuse(*given: Any, **named: Any) -> Any:
        raise AssertionError("flow was estimated")

    patches = [patch(f"pipeline.methods.{name}", refuse) for name in ESTIMATORS]
    for each in patches:
        each.start()
    try:
        yield
    finally:
        for each in patches:
            each.stop()


@pytest.mark.parametrize("name", [name for name in methods() if "motion" in method(name).passes and name != "layers"])
def test_no_method_estimates_motion_that_is_given(name: str) -> None:
    chosen = method(name)
    video = [shot(index).image for index in range(FRAMES)]
    given: dict[str, Any] = {**required_inputs(chosen, video), "video.entries": files(blender)}
    context = LocalContext(parse_params(chosen, {}), video, given)
    with no_estimates():
        run_plan(chosen, context)
    assert sorted(context.emitted) == list(range(FRAMES))


@pytest.mark.real("media")
@pytest.mark.parametrize(
    ("used", "name"),
    [("multistyle", "b45"), ("patches", "b5"), ("analogy", "eev"), ("steady", "one"), ("abstraction", "vl2"),
     ("abstraction", "one"), ("steady", "b45")],
)  # fmt: skip
def test_every_method_uses_the_vectors_of_renderers(used: str, name: str, media: Path) -> None:
    """Cycles of Blender 4.5 and 5, EEVEE, one-way vectors, two view layers: no method estimates motion. All read the
    vectors in the same way, so each is tried with one or two renderers."""
    shown = {path.name: path.read_bytes() for path in sorted((media / "blender" / name).glob("*.exr"))}
    found = pass_sequence(shown, guarded_planes, guarded_raw)
    assert found is not None and found.vectors is not None and found.vectors.used
    chosen, video = method(used), [found.picture(index) for index in range(len(found))]
    given: dict[str, Any] = {**required_inputs(chosen, video), "video.entries": shown}
    context = LocalContext(parse_params(chosen, {}), video, given)
    with no_estimates():
        run_plan(chosen, context)
    assert sorted(context.emitted) == list(range(FRAMES))
    assert all(context.emitted[index].std() > 10 for index in context.emitted), "pictures, not blank frames"


def test_the_check_of_estimates_notices_them() -> None:
    chosen = method("steady")
    video = [shot(index).image for index in range(FRAMES)]
    context = LocalContext(parse_params(chosen, {}), video, dict(required_inputs(chosen, video)))
    with pytest.raises(AssertionError, match="estimated"), no_estimates():
        run_plan(chosen, context)


def test_flows_lead_forwards_and_backwards() -> None:
    motion = motion_of(blender)
    forth, back = motion.flow(1, 2, SIZE), motion.flow(2, 1, SIZE)
    assert forth is not None and back is not None
    np.testing.assert_allclose(forth, shot(1).velocity_next, atol=1e-5)
    np.testing.assert_allclose(back, -shot(2).velocity_previous, atol=1e-5)


def test_flows_are_fitted_to_the_size_of_the_analysis() -> None:
    small = motion_of(blender).flow(1, 2, (48, 32))
    assert small is not None and small.shape == (32, 48, 2)
    full = shot(1).velocity_next
    assert np.isclose(np.abs(small).max(), np.abs(full).max() / 2, rtol=0.1)


def test_one_way_vectors_give_both_directions() -> None:
    motion = motion_of(one_way)
    forth, back = motion.flow(1, 2, SIZE), motion.flow(2, 1, SIZE)
    assert forth is not None and back is not None
    np.testing.assert_allclose(forth, shot(1).velocity_next, atol=1e-5)
    assert (np.abs(back + shot(2).velocity_previous).max(-1) > 0.5).mean() < 0.05


def test_motion_over_a_gap_in_the_numbers_is_not_known() -> None:
    made = files(blender)
    del made["beauty.1003.exr"]
    made["beauty.1005.exr"] = made["beauty.1004.exr"]
    motion = GivenMotion(pass_sequence(made, guarded_planes, guarded_raw))
    assert motion.flow(0, 1, SIZE) is not None
    assert motion.flow(1, 2, SIZE) is None and motion.flow(2, 3, SIZE) is not None
    assert motion.flow(0, 2, SIZE) is None and motion.flow(0, -1, SIZE) is None and motion.flow(3, 4, SIZE) is None


def test_a_video_without_passes_has_no_given_motion() -> None:
    context = LocalContext(parse_params(method("steady"), {}), [shot(0).image])
    assert given_motion(context).flow(0, 1, SIZE) is None


# -- what the probe has found


def test_tasks_use_the_convention_that_was_stored() -> None:
    """It is not looked for again, and a stored one counts even if another would fit better."""
    made = files(blender)
    found = pass_sequence(made, guarded_planes, guarded_raw)
    assert found is not None
    facts = found.facts().as_json()
    with patch("pipeline.passes.sequence.vector_facts", side_effect=AssertionError("looked for again")):
        again = GivenMotion(pass_sequence(made, guarded_planes, guarded_raw, facts))
        forth = again.flow(1, 2, SIZE)
    assert forth is not None
    np.testing.assert_array_equal(forth, motion_of(blender).flow(1, 2, SIZE))
    unused = {**facts, "vectors": {**facts["vectors"], "fault": "They are colours.", "used": False}}  # type: ignore[dict-item]
    assert GivenMotion(pass_sequence(made, guarded_planes, guarded_raw, unused)).flow(1, 2, SIZE) is None
    none = {name: value for name, value in facts.items() if name != "vectors"}
    assert GivenMotion(pass_sequence(made, guarded_planes, guarded_raw, none)).flow(1, 2, SIZE) is None


@pytest.mark.parametrize("name", ["abstraction", "multistyle", "patches", "analogy"])
def test_a_chosen_flow_beside_vectors_is_told(name: str) -> None:
    chosen = method(name)
    params = parse_params(chosen, {"flow": "dis-fast"})
    told = [one.field for one in chosen.ineffective(params, {"video"}, False, False, video_passes=("motion", "ids"))]
    assert told == ["params.flow"]
    assert not chosen.ineffective(params, {"video"}, False, False, video_passes=("ids",))
    (one,) = chosen.ineffective(params, {"video"}, False, False, video_passes=("motion",))
    assert "without motion vectors in the video" in one.message


# -- smaller frames than those of the files: previews


@pytest.mark.parametrize("name", ["analogy", "abstraction"])
def test_smaller_frames_use_the_vectors_of_the_files(name: str) -> None:
    chosen = method(name)
    half = (SIZE[0] // 2, SIZE[1] // 2)
    video = [cv2.resize(shot(index).image, half, interpolation=cv2.INTER_AREA) for index in range(FRAMES)]
    context = LocalContext(parse_params(chosen, {}), video, {"video.passes": files(blender)})
    with no_estimates():
        run_plan(chosen, context)
    assert context.emitted[FRAMES - 1].shape == (half[1], half[0], 3)


def test_a_smaller_preview_of_a_shot_has_its_layers_and_guides() -> None:
    """The layers of a shot, at half the size of its files, are those of the film."""
    full = shot_context(scene_files(), levels=2, iterations=2)
    run_plan(method("analogy"), full)
    half = (FULL[0] // 2, FULL[1] // 2)
    small = LocalContext(
        full.params, [cv2.resize(frame, half, interpolation=cv2.INTER_AREA) for frame in pictures()],
        {"video.passes": scene_files()},
    )  # fmt: skip
    run_plan(method("analogy"), small)
    told = [[(layer["name"], layer["message"]) for layer in context.results["scan"]["video"]["layers"]]
            for context in (full, small)]  # fmt: skip
    assert told[0] and [name for name, _ in told[0]] == [name for name, _ in told[1]]
    for index in range(4):
        wanted = cv2.resize(full.emitted[index], half, interpolation=cv2.INTER_AREA).astype(float)
        near = cv2.GaussianBlur(wanted, (0, 0), 3), cv2.GaussianBlur(small.emitted[index].astype(float), (0, 0), 3)
        assert np.abs(near[0] - near[1]).mean() < 12
