"""Combinations of inputs of the method analogy that were ignored, refused late or painted wrongly."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import BadInput, BadParameter
from pipeline.formats.decoding import decode_raw
from pipeline.formats.exr import write_exr
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.analogy.inputs import key_sources
from pipeline.methods.analogy.key_intervals import MAX_INTERVAL_FRAMES, split_intervals
from pipeline.methods.analogy.plan import plan_synthesis
from pipeline.methods.local import LocalContext, run_plan
from pipeline.synthesis.atlas import MAX_ROWS, atlas, relocated
from pipeline.synthesis.distance import nearest, within_reach
from pipeline.video.media import Limits
from tests.pipeline.methods.frames import painted
from tests.pipeline.methods.shots import SIZE, pictures, png, scene_files, shot_context
from tests.pipeline.methods.test_analogy import QUICK, key, painting, palette, rendered, scanned_plan, shot
from tests.pipeline.methods.test_analogy_layers import blue, colours, front, key_of, keyed, red, styled, with_settings
from tests.pipeline.methods.test_analogy_layers import rendered as rendered_shot

pytestmark = pytest.mark.real("opencl")


def exr(**planes: np.ndarray) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write_exr(Path(folder) / "a.exr", {name.replace("_", "."): plane for name, plane in planes.items()})
        return (Path(folder) / "a.exr").read_bytes()


def exr_of(picture: np.ndarray) -> bytes:
    """A picture of 8 bits as R, G and B from 0 to 1."""
    return exr(**{name: picture[..., k].astype(np.float32) / 255 for k, name in enumerate("RGB")})


def with_alpha(image: Frame, alpha: np.ndarray | int = 255) -> np.ndarray:
    return np.dstack([image, np.broadcast_to(np.uint8(alpha), image.shape[:2])])


# -- partly transparent keyframes


def pierced(image: Frame) -> np.ndarray:
    """A keyframe of which one pixel is not painted."""
    made = with_alpha(image)
    made[0, 0, 3] = 0
    return made


def test_one_transparent_pixel_changes_only_what_it_must() -> None:
    """Intervals, the blend of keys and the bias to the nearer key are those of opaque keyframes."""
    still = [shot()[0]] * 9
    first = np.minimum(key(0, 1), 180)
    opaque = {0: first, 8: first + 60}
    holed = {index: pierced(image) for index, image in opaque.items()}
    plain, *blended = (
        rendered({"keyframes": keys}, still, key_blend=amount)
        for keys, amount in ((holed, 0), (opaque, 1), (holed, 1))
    )  # fmt: skip
    assert palette(plain) <= palette(first, first + 60)
    assert np.abs(blended[0].astype(int) - blended[1]).mean() < 1.5
    np.testing.assert_allclose(blended[1].mean((1, 2, 3)) - first.mean(), np.linspace(0, 60, 9), atol=6)
    for index, image in opaque.items():
        np.testing.assert_array_equal(blended[1][index].reshape(-1, 3)[1:], image.reshape(-1, 3)[1:])


def test_many_partial_keyframes_are_a_style_of_bounded_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """All keyframes of a shot in one column would exceed the 32,767 rows that 16-bit positions reach."""
    from pipeline.methods.analogy import style_images

    heights: list[int] = []

    def recorded(*args: Any) -> Any:
        heights.append(atlas(*args).size[1])
        return atlas(*args)

    monkeypatch.setattr(style_images, "atlas", recorded)
    tall = [np.full((320, 32, 3), 40 + k, np.uint8) for k in range(110)]
    keys = {k: pierced(255 - frame) for k, frame in enumerate(tall)}
    out = rendered({"keyframes": keys}, tall, levels=1, iterations=1)
    np.testing.assert_array_equal(
        out.reshape(110, -1, 3)[:, 1:], np.stack([255 - f for f in tall]).reshape(110, -1, 3)[:, 1:]
    )
    assert len(heights) > 100 and max(heights) < 13 * 400


def test_an_unpainted_pixel_keeps_the_keyframe_that_painted_it_last() -> None:
    """The left half is painted in the first keyframe only, the right half in three: the left half does not change."""
    still = [shot()[0]] * 13
    keys: dict[int, np.ndarray] = {0: np.full((SIZE[1], SIZE[0], 4), 255, np.uint8)}
    keys[0][..., :3] = (200, 40, 40)
    right = np.where(np.arange(SIZE[0]) >= 48, 255, 0)
    for index, colour in ((6, (40, 200, 40)), (12, (40, 40, 200))):
        keys[index] = with_alpha(np.full((SIZE[1], SIZE[0], 3), colour, np.uint8), right)
    out = rendered({"keyframes": keys}, still, key_blend=0)
    assert (out[:, :, :44] == (200, 40, 40)).all(-1).mean() > 0.99
    np.testing.assert_array_equal(out[6][:, 48:], keys[6][:, 48:, :3])
    assert (out[10][:, 52:] == (40, 40, 200)).all(-1).mean() > 0.9, "the nearer key is preferred"


def test_sources_of_partial_keyframes_are_the_last_that_paint_each_pixel() -> None:
    left, right, everywhere = np.zeros((4, 8), bool), np.zeros((4, 8), bool), None
    left[:, :4], right[:, 5:] = True, True
    found = key_sources({0: everywhere, 5: left, 9: right, 12: left})
    assert found == {0: ([0], [0]), 5: ([5, 0], [5, 9]), 9: ([9, 5, 0], [9, 12]), 12: ([12, 9, 0], [12])}
    assert key_sources({3: None, 4: None}) == {3: ([3], [3]), 4: ([4], [4])}


@pytest.mark.parametrize("full", [True, False])
def test_partial_keyframes_split_a_shot_like_full_ones(full: bool) -> None:
    keys = [(3, full), (10, full), (200, full)]
    found = dict(split_intervals(0, 240, keys))
    alike = dict(split_intervals(0, 240, [(index, True) for index, _ in keys]))
    assert [(part.first, part.last, part.keys) for part in found.values()] == [
        (part.first, part.last, part.keys) for part in alike.values()
    ]
    starts = {part.start for part in found.values()}
    fixed = {index for part in found.values() for index, _ in part.fixed if index in (3, 10, 200)}
    assert fixed == (set() if full else {3, 10, 200}), "the interval before a partial keyframe fills it"
    done: set[int] = set()
    for part in found.values():
        assert {start for _, start in part.fixed} <= done & starts
        done.add(part.start)


def test_an_atlas_has_a_new_column_where_one_would_be_too_high() -> None:
    layout = atlas([(40, 15000)] * 5, 3, 9)
    assert layout.size[1] <= MAX_ROWS and len({image.left for image in layout.images}) == 3
    pictures_ = [np.full((15000, 40), 10 * k + 10, np.uint8) for k in range(5)]
    made = layout.compose(pictures_)
    for k, image in enumerate(layout.images):
        assert (made[image.top : image.top + 15000, image.left : image.left + 40] == 10 * k + 10).all()
        at = layout.identity(k, None)[7, 9]
        assert made[int(at[1]), int(at[0])] == 10 * k + 10
    before, now = dict(enumerate(layout.images)), {3: layout.images[0], 4: layout.images[1]}
    moved = relocated(np.stack([layout.identity(k, None)[:4] for k in (3, 1)]).reshape(8, 40, 2), before, now)
    np.testing.assert_array_equal(moved[:4], layout.identity(0, None)[:4])
    assert (moved[4:] < -1e5).all()


# -- keyframes, passes and a painting in one shot


@pytest.mark.parametrize("kind", ["normals", "ids", "guides/heat"])
@pytest.mark.parametrize("style", [("output",), ("output", "input")], ids="+".join)
def test_keyframes_passes_and_a_painting_are_one_style(kind: str, style: tuple[str, ...]) -> None:
    files = {name: data for name, data in scene_files().items() if name.startswith(("frames/", kind))}
    if kind == "guides/heat":
        files |= {f"{kind}/{k:04d}.png": png(image) for k, image in enumerate(pictures())}
    files |= {f"style/{name}.png": png(red()) for name in style}
    files["keyframes/0001.png"] = png(255 - pictures()[1])
    if kind == "guides/heat":
        with pytest.raises(BadInput, match="heat has no counterpart"):
            rendered_shot(files)
        files["style/heat.png"] = png(red())
    out = painted(rendered_shot(files))
    np.testing.assert_array_equal(out[1], 255 - pictures()[1])


@pytest.mark.parametrize("pair", [False, True])
def test_keyframes_of_a_shot_and_a_painting_of_the_job_are_one_style(pair: bool) -> None:
    files = {name: data for name, data in scene_files().items() if not name.startswith(("shot.json", "vectors"))}
    files["keyframes/0001.png"] = png(255 - pictures()[1])
    given = {"video.entries": files, "style_output": [red()]} | ({"style": [red()]} if pair else {})
    context = LocalContext(parse_params(method("analogy"), QUICK), pictures(), given)
    run_plan(method("analogy"), context)
    np.testing.assert_array_equal(painted(context)[1], 255 - pictures()[1])


@pytest.mark.parametrize("name", ["params", "guides", "overpaint_px"])
def test_settings_of_a_layer_that_is_not_painted_are_refused(name: str) -> None:
    value: Any = {"params": {"sweeps": 2}, "guides": {"ids": 3}, "overpaint_px": 4}[name]
    with pytest.raises(BadInput, match="no effect") as caught:
        rendered_shot(with_settings(styled(), stylise=False, **{name: value}))
    assert caught.value.field == f"shot.json: layers.front.{name}"


def test_a_pass_that_is_named_and_missing_in_the_style_is_refused() -> None:
    with pytest.raises(BadInput, match="normals has no counterpart"):
        rendered_shot(with_settings(styled(), guides={"normals": 2}))


# -- a transparent painting of a layer, overpaint, layers without gaps


@pytest.mark.parametrize("more", [{}, {"input": red}], ids=["painting alone", "pair"])
def test_a_layer_that_is_styled_by_a_transparent_painting_is_painted(more: dict[str, Any]) -> None:
    style = with_alpha(blue(), np.where(np.arange(120) < 60, 0, 255))
    files = {**styled(), "layers/front/style/output.png": png(style)}
    files |= {f"layers/front/style/{name}.png": png(make()) for name, make in more.items()}
    out = painted(rendered_shot(files))
    for index in range(4):
        assert colours(out[index][front(index)][None]) <= colours(blue()[:, 60:])


def test_a_completely_transparent_painting_is_refused() -> None:
    with pytest.raises(BadInput, match="completely transparent"):
        rendered_shot({**styled(), "layers/front/style/output.png": png(with_alpha(blue(), 0))})


def test_overpaint_reaches_beyond_the_silhouette_without_painted_opacity() -> None:
    covered = {}
    for reach in (0, 6):
        out = painted(rendered_shot(with_settings(styled(), overpaint_px=reach)))
        covered[reach] = sum((out[k][..., 2] > out[k][..., 0]).sum() for k in range(4))
    assert covered[6] > 1.2 * covered[0]
    image = np.dstack([pictures()[0]])
    for name, key_ in (("opaque", image), ("alpha", with_alpha(image))):
        files = {
            **scene_files(),
            "layers/back/style/output.png": png(red()),
            "layers/front/keyframes/0000.png": png(key_),
        }
        shown = {}
        for reach in (0, 6):
            context = rendered_shot(with_settings(files, overpaint_px=reach))
            shown[reach] = (context.kept["synthesise", "paint-1-0000003"]["rgba"][..., 3] > 0).sum()
        assert shown[6] > 1.2 * shown[0], name


def test_no_background_shows_between_complementary_layers() -> None:
    files, loose = keyed(), key_of(0, 0, (30, 200, 30))
    loose[..., 3] = np.where(within_reach(nearest(loose[..., 3] == 0), 2), 0, loose[..., 3])
    files["layers/front/keyframes/0000.png"] = png(loose)
    manifest = json.loads(files["shot.json"]) | {"background": "#ff00ff"}
    out = painted(rendered_shot({**files, "shot.json": json.dumps(manifest).encode()}))
    assert not (out == (255, 0, 255)).all(-1).any()


# -- parameters of a layer


def test_parameters_of_a_layer_apply_to_its_plan() -> None:
    for params, expected in (({"sweeps": 2}, {0: 1, 1: 2}), ({"levels": 1}, {0: 3, 1: 1})):
        context = shot_context(with_settings(styled(), params=params), refinement="full")
        tasks = run_plan(method("analogy"), context)["synthesise"]
        found = {}
        for layer in (0, 1):
            args = [
                each
                for task in tasks
                if task.args["layer"] == layer
                for each in (task.args, *[e[1] for e in task.args.get("earlier", [])])
            ]
            found[layer] = (
                len({a["level"] for a in args}) if "levels" in params else max(a["sweep"] for a in args) // 2 + 1
            )
        assert found == expected


def test_the_order_of_sweeps_and_independence_of_a_layer_apply() -> None:
    context = shot_context(with_settings(styled(), params={"temporal": "off"}))
    tasks = run_plan(method("analogy"), context)["synthesise"]
    assert {task.args["level"] for task in tasks if task.args["layer"] == 1} == {-1}
    context = shot_context(with_settings(styled(), params={"sweep_order": "forward-first"}))
    tasks = run_plan(method("analogy"), context)["synthesise"]
    assert [t.args["forward"] for t in tasks if t.args["layer"] == 1][-1] is False


def test_a_layer_on_twos_has_runs_of_whole_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.methods.analogy.plan.MAX_RUN_FRAMES", 3)
    context = rendered_shot(with_settings(styled(), params={"on_twos": "on"}))
    one, two = (context.kept["synthesise", f"paint-1-000000{k}"]["rgba"] for k in (2, 3))
    np.testing.assert_array_equal(one[..., :3], two[..., :3])


def test_a_parameter_of_the_whole_video_is_refused_for_a_layer() -> None:
    with pytest.raises(BadParameter, match="not to a layer") as caught:
        rendered_shot(with_settings(styled(), params={"cut_sensitivity": 0}))
    assert caught.value.field == "shot.json: layers.front.params.cut_sensitivity"


# -- time


def test_frames_between_keyframes_are_independent_if_asked_for() -> None:
    keys, frames = {0: key(0, 1), 5: key(5, 1)}, shot(6)
    others = [frames[0], frames[0], frames[1], frames[3], frames[0], frames[5]]
    for value in ("on", "off"):
        out, with_others = (
            rendered({"keyframes": keys}, given, temporal=value, cut_sensitivity=0, key_blend=0)
            for given in (frames, others)
        )
        assert np.array_equal(out[3], with_others[3]) == (value == "off")
        assert palette(out) <= palette(*keys.values())
        for index, image in keys.items():
            np.testing.assert_array_equal(out[index], image)


@pytest.mark.parametrize("last", [61, 109, 150])
def test_on_twos_no_painting_is_held_for_one_frame_within_a_gap(last: int) -> None:
    parts = [part for _, part in split_intervals(0, last + 1, [(0, True), (last, True)], unit=2)]
    assert all(part.first % 2 == 0 for part in parts)
    assert sorted(k for part in parts for k in range(part.first, part.last)) == list(range(last + 1))
    assert all(part.last - part.first <= MAX_INTERVAL_FRAMES + 1 for part in parts)


def test_the_plan_on_twos_has_even_parts() -> None:
    context = scanned_plan({"on_twos": "on"})
    context.results["scan"]["video"] |= {"frames": 110, "keys": [(0, True), (109, True)]}
    starts = [task.args["interval"]["start"] for task in plan_synthesis(context)]
    assert len(starts) > 2 and all(start % 2 == 0 for start in starts)


# -- EXR


def test_directions_guides_and_lines_in_exr_are_those_of_a_png() -> None:
    ramp = np.linspace(0, 255, SIZE[0]).astype(np.uint8)[None, :, None].repeat(SIZE[1], 0).repeat(3, 2)
    none = np.full_like(ramp, 128)
    half = none.copy()
    half[:, :48] = (255, 128, 0)
    style = {
        "style/output.png": red(),
        "style/heat.png": red(),
        "style/lines.png": red(),
        "style/directions.png": np.full_like(red(), 128),
    }
    values = {f"guides/heat/{k:04d}.png": ramp for k in range(4)} | {f"lines/{k:04d}.png": ramp for k in range(4)}
    values |= {f"directions/{k:04d}.png": half for k in range(4)}
    frames = {name: data for name, data in scene_files().items() if name.startswith("frames/")}
    given = {name: image for name, image in style.items() if name != "style/output.png"} | values
    plain = frames | {name: png(image) for name, image in (style | values).items()}
    in_exr = (
        frames | {"style/output.png": png(red())} | {n.replace(".png", ".exr"): exr_of(i) for n, i in given.items()}
    )
    np.testing.assert_array_equal(painted(rendered_shot(plain)), painted(rendered_shot(in_exr)))


def test_inputs_of_a_job_in_exr_are_those_of_a_png() -> None:
    def sequence(name: str, image: np.ndarray) -> dict[str, Any]:
        files = {f"{k:04d}.exr": exr_of(image) for k in range(6)}
        return {name: [image] * 6, f"{name}.entries": files}

    ramp = np.linspace(0, 255, SIZE[0]).astype(np.uint8)[None, :, None].repeat(SIZE[1], 0).repeat(3, 2)
    style_ramp = np.linspace(0, 255, 200).astype(np.uint8)[None, :, None].repeat(160, 0).repeat(3, 2)
    plain = {"style_output": [painting()], "guide_a": [ramp] * 6, "style_guide_a": [style_ramp]}
    wrong = np.full_like(ramp, 7)  # what a decoder of pictures would return
    files = {"a.exr": exr_of(style_ramp)}
    given = plain | sequence("guide_a", ramp) | {"guide_a": [wrong] * 6, "style_guide_a.entries": files}
    np.testing.assert_array_equal(rendered(plain), rendered(given))


def test_values_of_a_guide_beyond_the_unit_range_are_scaled_and_not_clipped() -> None:
    """A guide from -5 to 5 selects between the halves of a style whose guide has the same values."""
    frames = {name: data for name, data in scene_files().items() if name.startswith("frames/")}
    x = np.linspace(-5, 5, SIZE[0], dtype=np.float32)[None].repeat(SIZE[1], 0)
    style = np.zeros((64, 96, 3), np.uint8)
    style[:, :48], style[:, 48:] = (200, 40, 40), (40, 40, 200)
    style_x = np.linspace(-5, 5, 96, dtype=np.float32)[None].repeat(64, 0)
    files = frames | {f"guides/position/{k:04d}.exr": exr(X=x) for k in range(4)}
    files |= {"style/output.png": png(style), "style/position.exr": exr(X=style_x)}
    out = painted(rendered_shot(files, guide_weight=0))
    assert (out[:, :, :40, 0] == 200).mean() > 0.95 and (out[:, :, 56:, 2] == 200).mean() > 0.95


def test_depth_is_a_guide_if_the_style_has_it_or_it_is_named() -> None:
    z = np.linspace(1, 30, SIZE[0], dtype=np.float32)[None].repeat(SIZE[1], 0)
    z[:4] = 1e10
    frames = {}
    for k, image in enumerate(pictures()):
        planes = {f"Combined.{c}": (image[..., i] / 255).astype(np.float32) for i, c in enumerate("RGB")}
        with tempfile.TemporaryDirectory() as folder:
            write_exr(Path(folder) / "a.exr", planes | {"Depth.Z": z})
            frames[f"frames/{k:04d}.exr"] = (Path(folder) / "a.exr").read_bytes()
    style = np.zeros((64, 96, 3), np.uint8)
    style[:, :48], style[:, 48:] = (200, 40, 40), (40, 40, 200)
    depth = np.linspace(1, 30, 96, dtype=np.float32)[None].repeat(64, 0)
    files = frames | {"style/output.png": png(style), "style/depth.exr": exr(Z=depth)}
    out = painted(rendered_shot(files, guide_weight=0))
    assert (out[:, 8:, :40, 0] == 200).mean() > 0.95 and (out[:, 8:, 56:, 2] == 200).mean() > 0.95


def test_a_data_image_of_unknown_channels_is_refused() -> None:
    flat = np.zeros((SIZE[1], SIZE[0]), np.float32)
    files = {name: data for name, data in scene_files().items() if name.startswith("frames/")}
    files |= {f"guides/odd/{k:04d}.exr": exr(p1=flat, p2=flat, p3=flat, p4=flat) for k in range(4)}
    files |= {"style/output.png": png(red()), "style/odd.png": png(red())}
    with pytest.raises(BadInput, match="which channels"):
        rendered_shot(files)


def test_opacity_of_a_whole_frame_is_composited_over_white() -> None:
    """As every other method and the decoder of a plain video do."""
    alpha = np.where(np.arange(SIZE[0]) < 48, 0, 255)
    white = [np.where(np.arange(SIZE[0])[None, :, None] < 48, np.uint8(255), image) for image in pictures()]
    files = {"style/output.png": png(red())}
    given, flat = (
        files | {f"frames/{k:04d}.png": png(image) for k, image in enumerate(made)}
        for made in ([with_alpha(image, alpha) for image in pictures()], white)
    )
    params = parse_params(method("analogy"), QUICK)
    found = []
    for entries in (given, flat):
        context = LocalContext(params, white, {"video.entries": entries})
        run_plan(method("analogy"), context)
        found.append(painted(context))
    np.testing.assert_array_equal(*found)


def test_a_style_has_as_many_channels_of_guides_as_ebsynth() -> None:
    from pipeline.methods.analogy.inputs import Guide
    from pipeline.methods.analogy.params import AnalogyParams
    from pipeline.methods.analogy.style_images import energy_of

    def guides(count: int) -> tuple[Guide, ...]:
        return tuple(Guide(f"guide {k}", 1.0, 1) for k in range(count))

    assert len(energy_of(AnalogyParams(), guides(24), 0, colours=4).guides) == 27
    with pytest.raises(BadInput, match="too many guides"):
        energy_of(AnalogyParams(), guides(27), 0)


def test_tasks_declare_the_memory_of_partial_keyframes() -> None:
    context = scanned_plan({})
    chosen = method("analogy")
    before = chosen.resources("synthesise", context)
    context.results["scan"]["video"] |= {
        "keys": [(0, False), (3, False)],
        "sources": [(0, [0], [0, 3]), (3, [3, 0], [3])],
    }
    after = chosen.resources("synthesise", context)
    assert before is not None and after is not None
    assert after.memory_bytes - before.memory_bytes == 2 * 60 * SIZE[0] * SIZE[1]


def test_each_layer_is_an_artefact_with_its_opacity() -> None:
    context = shot_context(keyed())
    context.artefacts = frozenset({"layers"})
    run_plan(method("analogy"), context)
    with zipfile.ZipFile(io.BytesIO(context.files["layers-0000000.zip"])) as archive:
        assert archive.namelist()[:2] == ["01-back/0000000.png", "02-front/0000000.png"]
        found = decode_raw(archive.read("02-front/0000003.png"), Limits())
    np.testing.assert_array_equal(found, context.kept["synthesise", "paint-1-0000003"]["rgba"])
