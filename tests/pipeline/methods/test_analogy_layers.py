"""Layers: each has its own style, velocities and keyframes; they are composited, and invalid shots are reported."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pytest

from pipeline.errors import BadInput, ImpastoError
from pipeline.frames import Frame
from pipeline.methods import method
from pipeline.methods.analogy.inputs import id_colours
from pipeline.methods.analogy.layer_inputs import LayerInputs, inputs_of
from pipeline.methods.analogy.shot_layers import LayerStatistics, layered_shot
from pipeline.methods.analogy.style_images import paint_in_strokes
from pipeline.methods.local import LocalContext, run_plan
from pipeline.scenes import scene
from pipeline.synthesis.distance import nearest, within_reach
from tests.pipeline.methods.frames import painted
from tests.pipeline.methods.shots import SIZE, pictures, png, scene_files, shot_context

pytestmark = pytest.mark.real("opencl")


def texture(seed: int, tint: tuple[int, int, int]) -> np.ndarray:
    """A style of one tint, so that the layer of a pixel can be recognised."""
    made = paint_in_strokes(scene("portrait", (480, 320), frames=1).image(0))[40:140, 60:180] // 3
    return np.ascontiguousarray(made // 2 + np.array(tint, np.uint8) + np.uint8(seed))


@cache
def red() -> np.ndarray:
    return texture(0, (120, 0, 0))


@cache
def blue() -> np.ndarray:
    return texture(0, (0, 0, 120))


def styled() -> dict[str, bytes]:
    return {
        **scene_files(), "layers/back/style/output.png": png(red()), "layers/front/style/output.png": png(blue()),
    }  # fmt: skip


def rendered(files: dict[str, bytes], frames: int = 4, **params: Any) -> LocalContext:
    context = shot_context(files, frames, **params)
    run_plan(method("analogy"), context, shuffle=params.get("seed"))
    return context


def front(index: int) -> np.ndarray:
    return np.isin(scene("shapes", SIZE, frames=4, fps=24).frame(index).ids, (4, 5, 6, 7))


def colours(image: np.ndarray) -> set[bytes]:
    return {pixel.tobytes() for pixel in np.unique(image[..., :3].reshape(-1, 3), axis=0)}


def test_each_layer_has_its_own_style_within_its_silhouette() -> None:
    out = painted(rendered(styled()))
    for index in range(4):
        mask = front(index)
        assert colours(out[index][mask][None]) <= colours(blue())
        assert colours(out[index][~mask][None]) <= colours(red())


def test_layers_are_independent_tasks_with_the_same_bytes_in_any_order() -> None:
    chosen = method("analogy")
    first, second = shot_context(styled()), shot_context(styled())
    tasks = run_plan(chosen, first)["synthesise"]
    run_plan(chosen, second, shuffle=7)
    assert (painted(first) == painted(second)).all()
    layers = {task.key: task.args["layer"] for task in tasks}
    assert set(layers.values()) == {0, 1}
    assert all(layers[name] == layers[task.key] for task in tasks for name in task.after)


def test_a_coarse_preview_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    context, shown = shot_context(styled()), list[Frame]()
    monkeypatch.setattr(context, "show", shown.append)
    run_plan(method("analogy"), context)
    assert shown


def test_rendered_velocities_are_extrapolated_beyond_the_silhouette() -> None:
    context = shot_context(styled())
    context.step = "scan"
    method("analogy").steps[0].run(method("analogy").steps[0].plan(_plan_context(context))[0], context)
    velocities = inputs_of(context, 1).velocities(1)
    truth, mask = scene("shapes", SIZE, frames=4, fps=24).frame(1), front(1)
    assert velocities is not None
    np.testing.assert_allclose(velocities[0][mask], truth.velocity_next[mask], atol=1e-5)
    near = nearest(mask)
    around = within_reach(near, 20) & ~mask
    expected = truth.velocity_next[near[around][:, 1], near[around][:, 0]]
    np.testing.assert_allclose(velocities[0][around], expected, atol=1e-5)


def _plan_context(context: LocalContext) -> Any:
    from pipeline.methods.base import PlanContext

    return PlanContext(context.params, 0, context.video)


# -- keyframes of a layer


def key_of(index: int, reach: int, tint: tuple[int, int, int]) -> np.ndarray:
    """A layer painted in one colour with noise, up to `reach` px beyond its outline, transparent elsewhere."""
    mask = front(index)
    noise = np.random.default_rng(3).integers(0, 40, (*mask.shape, 3), dtype=np.uint8)
    image = noise + np.array(tint, np.uint8)
    return np.dstack([image, np.where(within_reach(nearest(mask), reach), 255, 0).astype(np.uint8)])


def keyed() -> dict[str, bytes]:
    key = key_of(0, 5, (30, 200, 30))
    return {**scene_files(), "layers/back/style/output.png": png(red()), "layers/front/keyframes/0000.png": png(key)}


def test_overpaint_moves_with_its_layer() -> None:
    """Paint up to 5 px outside the silhouette surrounds the moved silhouette three frames later."""
    context = rendered(keyed())
    key = key_of(0, 5, (30, 200, 30))
    first = context.kept["synthesise", "paint-1-0000000"]["rgba"]
    np.testing.assert_array_equal(first[..., 3], key[..., 3])
    np.testing.assert_array_equal(first[key[..., 3] > 0], key[key[..., 3] > 0])
    last = context.kept["synthesise", "paint-1-0000003"]["rgba"][..., 3] > 0
    truth = within_reach(nearest(front(3)), 5)
    assert (last & truth).sum() / (last | truth).sum() > 0.93


def test_a_keyframe_of_a_layer_is_exact_in_the_composited_frame() -> None:
    out = painted(rendered(keyed()))
    key = key_of(0, 5, (30, 200, 30))
    opaque = key[..., 3] > 0
    np.testing.assert_array_equal(out[0][opaque], key[opaque][:, :3])


# -- compositing


def with_settings(files: dict[str, bytes], **front: Any) -> dict[str, bytes]:
    """The same shot with further settings of the front layer in shot.json."""
    manifest = json.loads(files["shot.json"])
    manifest["layers"][1].update(front)
    return {**files, "shot.json": json.dumps(manifest).encode()}


def test_an_unstylised_layer_is_composited_unchanged_and_needs_no_synthesis() -> None:
    context = shot_context(with_settings(styled(), stylise=False))
    tasks = run_plan(method("analogy"), context)["synthesise"]
    assert {task.args["layer"] for task in tasks} == {0}
    out, source = painted(context), pictures()
    for index in range(4):
        np.testing.assert_array_equal(out[index][front(index)], source[index][front(index)])
        assert colours(out[index][~front(index)][None]) <= colours(red())


def test_a_layer_is_multiplied_with_the_layers_behind_it() -> None:
    """Fig. 8d of the paper: solid colours over the texture."""
    plain = painted(rendered(with_settings(styled(), opacity=0)))
    out, source = painted(rendered(with_settings(styled(), stylise=False, blend="multiply"))), pictures()
    for index in range(4):
        inside = front(index)
        product = plain[index][inside].astype(float) * source[index][inside] / 255
        np.testing.assert_allclose(out[index][inside], product, atol=0.51)
        np.testing.assert_array_equal(out[index][~inside], plain[index][~inside])


def test_keyframes_of_an_unstylised_layer_are_rejected() -> None:
    with pytest.raises(BadInput) as caught:
        rendered(with_settings(keyed(), stylise=False))
    assert caught.value.field == "shot.json: layers.front.stylise"


# -- shots without layers, guides, parameters


def test_a_shot_without_layers_uses_its_vectors_and_emits_its_frames() -> None:
    files = {name: data for name, data in scene_files().items() if name != "shot.json"}
    context = rendered({**files, "style/output.png": png(red())})
    assert colours(painted(context)) <= colours(red())
    assert not [name for step, name in context.kept if name.startswith("paint")]
    assert len(context.kept["scan", "tones"]["factors"]) == 4


def test_a_guide_of_a_shot_without_style_counterpart_is_rejected() -> None:
    files = {**styled(), **{f"layers/front/guides/heat/{k:04d}.png": png(pictures()[k]) for k in range(4)}}
    with pytest.raises(BadInput) as caught:
        rendered(files)
    assert "heat" in str(caught.value) and "front" in str(caught.value)


def test_normals_are_a_guide_if_the_style_has_them() -> None:
    normals = np.full((100, 120, 3), 127, np.uint8)
    context = shot_context({**styled(), "layers/front/style/normals.png": png(normals)})
    run_plan(method("analogy"), context)
    shot = layered_shot(context)
    assert shot is not None
    statistics = LayerStatistics.of(context.load("scan", "tones-1"))
    assert [guide.name for guide in LayerInputs(context, shot.layers[1], statistics).guides] == ["normals"]
    assert [guide.name for guide in LayerInputs(context, shot.layers[0], statistics).guides] == []
    earlier = dict(context.load("scan", "tones-1"))
    del earlier["contrasts"]  # scanned by a program before 2026-11-25
    assert not LayerStatistics.of(earlier).tones.contrasts.any()


def test_invalid_parameters_of_a_layer_are_reported_with_their_path() -> None:
    manifest = json.loads(scene_files()["shot.json"])
    manifest["layers"][1]["params"] = {"guide_weight": -3}
    with pytest.raises(ImpastoError) as caught:
        rendered({**styled(), "shot.json": json.dumps(manifest).encode()})
    assert caught.value.field == "shot.json: layers.front.params.guide_weight"


def test_object_numbers_become_well_separated_colours() -> None:
    found = id_colours(np.arange(64)).astype(int)
    differences = np.abs(found[:, None] - found[None]).max(-1)[np.triu_indices(64, 1)]
    assert differences.min() >= 32
