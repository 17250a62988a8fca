"""The multistyle method: reproducible bytes, styles, regions, directions, and temporal stability."""

from __future__ import annotations

import io
import json
import math
import zipfile
from functools import cache
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.base import no_clock
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.multistyle import MultistyleParams, MultistyleSession, plan
from pipeline.methods.multistyle.analysis import StrokeAnalysis, unpack
from pipeline.methods.multistyle.analyzer import StrokeAnalyzer
from pipeline.methods.multistyle.denoise import DENOISE, denoise, zero_still_flow_by_texture
from pipeline.methods.multistyle.design import parse
from pipeline.methods.multistyle.design_fields import DesignFields, RegionPlacement
from pipeline.methods.multistyle.painter import Painter, colour_order
from pipeline.methods.multistyle.params import STYLE_NAMES
from pipeline.methods.multistyle.styles import FIELDS, STYLES, pigment, vector
from pipeline.methods.multistyle.tubes import TubeTracker, merge_results, tubes_of
from pipeline.scenes import scene
from pipeline.strokes.accumulation import Painting
from pipeline.strokes.paper import EdgeDarkening
from pipeline.tensors.field import angle_of
from tests.pipeline.methods.frames import painted

SIZE = (96, 64)
CUT = 6
MULTISTYLE = method("multistyle")


@cache
def shots() -> list[Frame]:
    """Twelve frames with a hard cut in the middle."""
    made = scene("cut", SIZE, frames=2 * CUT, fps=10)
    return [made.image(index) for index in range(2 * CUT)]


def labels(left: int = 40) -> NDArray[np.uint8]:
    out = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    out[:, :left] = 1
    return out


DESIGN: dict[str, Any] = {
    "version": 1,
    "regions": {"left": {"label": 1, "border": "soft"}, "sky": {"objects": [1]}},
    "keys": [
        {"region": "left", "frame": 0, "style": "pointillism", "ease": "smooth"},
        {"region": "left", "frame": 5, "set": {"hue": 80}},
    ],
    "directions": [
        {"region": "left", "frame": 0, "edge_weight": 0.1, "elements": [{"pattern": "node", "at": [0.2, 0.5]}]},
        {"region": "sky", "free": True},
    ],
}


# -- the same bytes

VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "explicit": {"renderer": "explicit"},
    "each frame on its own": {"temporal": "off"},
    "no cuts": {"cut_sensitivity": 0},
    "dots": {"style": "pointillism", "face_detail": 0, "saliency_detail": 0, "motion_detail": 0},
    "water": {"style": "watercolor", "layers": -0.5},
}


@pytest.mark.parametrize("values", VARIANTS.values(), ids=VARIANTS.keys())
def test_runs_of_any_length_equal_one_session(values: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "RUN_FRAMES", 4)
    session = MultistyleSession(MultistyleParams(**values), SIZE, 3)
    wanted = np.stack([session.step(frame) for frame in shots()])
    context = LocalContext(MultistyleParams(**values), shots(), seed=3)
    tasks = run_plan(MULTISTYLE, context, shuffle=3)["paint"]
    starts = [task.emits[0] for task in tasks if task.emits]
    assert sorted(starts) == ([0, 2, 6, 10] if values.get("cut_sensitivity") == 0 else [0, 2, CUT, CUT + 4])
    np.testing.assert_array_equal(painted(context), wanted)


def test_the_paint_of_a_colour_has_the_same_bytes_alone_and_among_others() -> None:
    """A matrix product has other last bits on another processor and for another number of colours."""
    colours = np.random.default_rng(1).uniform(0, 255, (500, 3)).astype(np.float32)
    alone = np.concatenate([pigment(colour[None], 1.4, 1.1) for colour in colours])
    assert np.array_equal(pigment(colours, 1.4, 1.1), alone)


def test_a_long_shot_has_longer_runs_with_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    pictures = []
    for long_runs, starts in ((100, [0, 1, 3, 5]), (2, [0, 1, 5])):
        monkeypatch.setattr(plan, "RUN_FRAMES", 2)
        monkeypatch.setattr(plan, "LONG_SHOT_RUNS", long_runs)
        context = LocalContext(MultistyleParams(), shots(), seed=3)
        tasks = run_plan(MULTISTYLE, context, shuffle=3)["paint"]
        assert sorted(task.emits[0] for task in tasks if task.emits and task.emits[0] < CUT) == starts
        pictures.append(painted(context))
    np.testing.assert_array_equal(*pictures)


def test_paintings_that_this_process_has_just_made_are_not_painted_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A frame that two runs need is painted by whichever comes first, for a run with the same analyses."""
    painted_frames: list[int] = []
    original = Painter._painting

    def counted(self: Painter, analysis: StrokeAnalysis, matte: None = None) -> Painting:
        painted_frames.append(analysis.number)
        return original(self, analysis)

    monkeypatch.setattr(Painter, "_painting", counted)
    analyzer = StrokeAnalyzer(MultistyleParams(), SIZE, 0, no_clock)
    analyses = [analyzer.step(frame) for frame in shots()[:5]]
    first, second, third, fourth = (Painter(MultistyleParams(), SIZE, seed) for seed in (0, 0, 1, 0))
    pictures = [first.paint(analysis, shared=analysis.number > 2).tobytes() for analysis in analyses[:4]]
    stored = [unpack(analysis.pack()) for analysis in analyses[2:4]]
    painted_frames.clear()
    for analysis in stored:
        third.load_previous(analysis, shared=True)
        second.load_previous(analysis, shared=True)
    assert painted_frames == [3, 4], "those of another seed"
    assert second.paint(analyses[4]).tobytes() == first.paint(analyses[4]).tobytes()
    painted_frames.clear()
    for analysis in stored:
        second.load_previous(analysis, shared=True)
    assert painted_frames == [3, 4], "two runs have used them"
    assert [fourth.paint(each, shared=each.number > 2).tobytes() for each in analyses[:4]] == pictures
    assert painted_frames == [3, 4, 1, 2], "the later run was the first"


def test_runs_equal_one_session_with_design_and_masks(monkeypatch: pytest.MonkeyPatch) -> None:
    pictures, files = [], []
    for length, order in ((16, None), (4, 1), (3, 2)):
        monkeypatch.setattr(plan, "RUN_FRAMES", length)
        inputs = {"design": DESIGN, "masks": {1: labels(), 4: labels(30), 7: labels(20)}}
        context = LocalContext(MultistyleParams(), shots(), inputs, artefacts=frozenset({"regions"}))
        run_plan(MULTISTYLE, context, shuffle=order)
        pictures.append(painted(context))
        files.append(pages(context))
    for picture, found in zip(pictures[1:], files[1:], strict=True):
        np.testing.assert_array_equal(picture, pictures[0])
        assert found == files[0]
    plain = LocalContext(MultistyleParams(), shots())
    run_plan(MULTISTYLE, plain)
    assert (painted(plain) != pictures[0]).mean() > 0.3


@pytest.mark.parametrize("inputs", [{}, {"design": DESIGN, "masks": {1: labels(), 4: labels(30)}}], ids=["", "design"])
def test_the_bytes_are_the_same_on_any_number_of_processors(
    inputs: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures = []
    monkeypatch.setattr(plan, "RUN_FRAMES", 4)
    for processors in (1, 16):
        monkeypatch.setattr(plan, "usable_processors", lambda count=processors: count)
        context = LocalContext(MultistyleParams(), shots(), inputs, seed=3)
        run_plan(MULTISTYLE, context)
        pictures.append(painted(context))
    np.testing.assert_array_equal(*pictures)


def pages(context: LocalContext) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    for name, data in sorted(context.files.items()):
        if name.endswith(".zip"):
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                found |= {entry: archive.read(entry) for entry in archive.namelist()}
        else:
            found[name] = data
    return found


def test_a_restored_session_continues_with_the_same_bytes_and_the_seed_matters() -> None:
    one, two, other = (MultistyleSession(MultistyleParams(), SIZE, seed) for seed in (1, 1, 2))
    for frame in shots()[:3]:
        one.step(frame)
        other.step(frame)
    two.restore({key: array.copy() for key, array in one.state().items()})
    for frame in shots()[3:]:
        mine = one.step(frame)
        np.testing.assert_array_equal(mine, two.step(frame))
        assert (mine != other.step(frame)).any()


@pytest.mark.parametrize("style", ["van-gogh", "watercolor"])
def test_a_stored_analysis_is_restored_exactly(style: Any) -> None:
    analyzer = StrokeAnalyzer(MultistyleParams(style=style), SIZE, 0, no_clock)
    analysis = [analyzer.step(frame) for frame in shots()[:2]][-1]
    again = unpack({name: array.copy() for name, array in analysis.pack().items()})
    assert (again.picture == analysis.picture).all() and (again.field == analysis.field).all()
    for mine, theirs in zip(analysis.layers, again.layers, strict=True):
        assert (
            (mine.ids == theirs.ids).all() and (mine.strokes == theirs.strokes).all() and (mine.xy == theirs.xy).all()
        )
    paper = ("rims",) if style == "watercolor" else ()
    assert analysis.pack().keys() == again.pack().keys() >= {"back", *paper}
    for name in ("back", *paper):
        np.testing.assert_array_equal(getattr(analysis, name), getattr(again, name))


def test_a_session_continues_with_other_parameters() -> None:
    session = MultistyleSession(MultistyleParams(), SIZE)
    session.step(shots()[0])
    ids = {marks.ids.tobytes() for marks in session.analyze(shots()[1]).layers}
    after = session.reconfigure(MultistyleParams(hue=90), SIZE)
    assert {marks.ids.tobytes() for marks in after.analyze(shots()[1]).layers} == ids
    assert after.reconfigure(MultistyleParams(), (64, 48)).step(cv2.resize(shots()[2], (64, 48))).shape == (48, 64, 3)


# -- styles


@pytest.mark.parametrize("renderer", ["implicit", "explicit"])
def test_every_style_differs_and_keeps_the_subject_recognisable(renderer: str) -> None:
    source = scene("harbour", (192, 108), frames=1).image(0)
    made = {
        name: MultistyleSession(MultistyleParams(style=name, renderer=renderer), (192, 108)).step(source)
        for name in STYLE_NAMES
    }  # fmt: skip
    for name, picture in made.items():
        assert structure(source, picture) > 0.7, name
        for other, its in made.items():
            assert other == name or np.abs(picture.astype(int) - its).mean() > 4, (name, other)


def structure(source: Frame, picture: Frame) -> float:
    one, other = (coarse_edges(image).ravel() for image in (source, picture))
    return float(np.corrcoef(one, other)[0, 1])


def coarse_edges(image: Frame) -> NDArray[Any]:
    small = cv2.cvtColor(cv2.resize(image, (96, 54), interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2Lab)
    lab = cv2.GaussianBlur(small.astype(np.float32), (0, 0), 1)
    return np.sqrt(cv2.Sobel(lab, cv2.CV_32F, 1, 0) ** 2 + cv2.Sobel(lab, cv2.CV_32F, 0, 1) ** 2).sum(-1)


# -- calm


@cache
def still() -> list[Frame]:
    """A still camera with sensor noise."""
    made, rng = scene("portrait", (160, 120), frames=1).image(0).astype(float), np.random.default_rng(8)
    return [np.clip(made + rng.normal(0, 3, made.shape), 0, 255).astype(np.uint8) for _ in range(10)]


def restlessness(**values: Any) -> float:
    session = MultistyleSession(MultistyleParams(**values), (160, 120))
    made = [session.step(frame).astype(float) for frame in still()]
    return float(np.sqrt(np.mean([np.square(b - a).mean() for a, b in pairwise(made[4:])])))


def test_noise_is_not_painted() -> None:
    calm, alone = restlessness(), restlessness(temporal="off")
    assert calm < 0.25 * alone and calm < 3 * math.sqrt(2)


def test_large_changes_are_followed_at_once_and_texture_noise_slowly() -> None:
    rng, nowhere = np.random.default_rng(3), np.zeros((80, 120, 2), np.float32)
    past = np.full((80, 120, 3), 100, np.float32)
    patch, fur = past.copy(), past + rng.normal(0, 12, past.shape).astype(np.float32)
    patch[30:50, 40:60] += DENOISE.plain + 5
    denoised, other = denoise(patch, past, nowhere, 3)
    np.testing.assert_array_equal(denoised[32:48, 42:58], patch[32:48, 42:58])
    assert other[32:48, 42:58].all() and not other[:15].any() and (denoised[:15] == 100).all()
    denoised, other = denoise(fur, past, nowhere, 3)
    assert not other.any() and np.abs(denoised - past).mean() < 0.4 * np.abs(fur - past).mean()


def test_hands_and_small_heads_follow_smaller_changes_at_once() -> None:
    nowhere, past = np.zeros((80, 120, 2), np.float32), np.full((80, 120, 3), 100, np.float32)
    hand = past.copy()
    hand[30:50, 40:60] += DENOISE.plain / 3
    slow, other = denoise(hand, past, nowhere, 3)
    assert not other.any() and np.abs(slow - hand)[32:48, 42:58].min() > 1
    at_once, other = denoise(hand, past, nowhere, 3, np.ones((4, 6), np.float32))
    np.testing.assert_array_equal(at_once[32:48, 42:58], hand[32:48, 42:58])
    assert other[32:48, 42:58].all()


def test_a_line_where_the_flow_is_torn_is_not_denoised() -> None:
    """The flow leads from one column of a light wall to a dark leg that has moved away."""
    wall, past = (np.full((160, 240, 3), 200, np.float32) for _ in range(2))
    past[:, 20:40] = 110
    back = np.zeros((160, 240, 2), np.float32)
    back[:, 20:40, 0] = 30
    back[:, 150, 0] = -120
    denoised, other = denoise(wall, past, back, 3)
    assert denoised.min() == 200
    assert other[:, 150].all() and not other[:, 145].any()


@cache
def flights() -> list[Frame]:
    """A red ball, eleven pixels wide, moves fast in front of a wall, with sensor noise."""
    rng, out = np.random.default_rng(6), []
    for k in range(7):
        frame = np.full((120, 200, 3), 150.0)
        cv2.circle(frame, (20 + 24 * k, 60), 5, (210, 30, 30), -1)
        out.append(np.clip(frame + rng.normal(0, 2, frame.shape), 0, 255).astype(np.uint8))
    return out


@pytest.mark.parametrize("style", STYLE_NAMES)
def test_a_small_fast_ball_leaves_no_trail(style: Any) -> None:
    session = MultistyleSession(MultistyleParams(style=style), (200, 120))
    for k, frame in enumerate(flights()):
        red = redness(session.step(frame))
        here, before = red[57:64, 17 + 24 * k : 24 + 24 * k].mean(), red[57:64, 24 * k - 7 : 24 * k].mean() if k else 0
        assert here > 40, (k, here)
        assert before < 0.35 * here, (k, before, here)


def redness(picture: Frame) -> NDArray[Any]:
    values = picture.astype(float)
    return values[..., 0] - values[..., 1:].mean(axis=-1)


def test_ease_scales_the_smoothing_of_explicit_strokes() -> None:
    plain, eased = (MultistyleParams(renderer="explicit", ease=ease).effective for ease in (0, 1))
    assert (plain.noise_floor, plain.colour_follow, plain.stroke_fade) == (0, 1, 1)
    given = MultistyleParams()
    assert given.effective == given
    assert (eased.noise_floor, eased.colour_follow, eased.stroke_fade) == (
        given.noise_floor,
        given.colour_follow,
        given.stroke_fade,
    )
    crisp, calm = (restlessness(renderer="explicit", ease=ease) for ease in (0, 1))
    assert restlessness() < 0.6 * crisp and calm < 0.65 * crisp, (crisp, calm)


@cache
def pan() -> list[Frame]:
    """A camera that pans by 2 px a frame, with sensor noise."""
    wide, rng = scene("harbour", (200, 100), frames=1).image(0).astype(float), np.random.default_rng(9)
    return [
        np.clip(part + rng.normal(0, 2, part.shape), 0, 255).astype(np.uint8)
        for part in (wide[:, 2 * k : 2 * k + 176] for k in range(10))
    ]


def swimming(**values: Any) -> float:
    """Change of a painting of the pan that the motion does not explain, gray levels."""
    session = MultistyleSession(MultistyleParams(**values), (176, 100))
    made = [session.step(frame).astype(float) for frame in pan()]
    return float(np.sqrt(np.mean([np.square(b[8:-8, 8:-10] - a[8:-8, 10:-8]).mean() for a, b in pairwise(made[4:])])))


@pytest.mark.parametrize("style", ["van-gogh", "impressionism"])
def test_accumulation_reduces_flicker(style: str) -> None:
    implicit, without, explicit, alone = (
        swimming(style=style, **values)
        for values in ({}, {"accumulated_frames": 0}, {"renderer": "explicit"}, {"temporal": "off"})
    )
    assert implicit < 0.95 * without and implicit < 0.95 * explicit and implicit < 0.5 * alone, (
        implicit, without, explicit, alone,
    )  # fmt: skip


def test_rims_lie_on_the_darker_side_and_follow_the_motion() -> None:
    def picture(edge: int, dark: int = 60) -> Frame:
        out = np.full((96, 128, 3), 200, np.uint8)
        out[:, :edge] = dark
        return out

    darkening, nothing_else = EdgeDarkening(), np.zeros((96, 128), np.bool_)
    first = darkening.step(picture(60), None, None)
    assert first[48, 59] > 100 and first[48, 61] == 0
    moved = darkening.step(picture(64), np.full((96, 128, 2), (-4, 0), np.float32), nothing_else)
    assert np.abs(moved[:, 50:80].astype(int) - first[:, 46:76]).max() <= 2
    paler = darkening.step(picture(64, 190), np.zeros((96, 128, 2), np.float32), nothing_else)
    other = darkening.step(picture(64, 190), np.zeros((96, 128, 2), np.float32), ~nothing_else)
    assert paler[48, 63] > 0.7 * moved[48, 63] > 2 * other[48, 63]


@pytest.mark.parametrize(("moved", "sky"), [(240, -3), (0, 0), (120, None)])
def test_a_flat_sky_moves_with_the_camera(moved: int, sky: float | None) -> None:
    """The upper part has no texture; in the lower part texture moves by 3 px up to column `moved` and rests beyond."""
    rough = cv2.GaussianBlur(np.random.default_rng(4).normal(0, 900, (160, 260)), (0, 0), 2) + 128
    rough = np.clip(rough, 0, 255).astype(np.uint8)
    before, after = rough[:, :240].copy(), rough[:, :240].copy()
    after[:, :moved] = rough[:, 3 : moved + 3]
    before[:60], after[:60] = 200, 200
    flow = zero_still_flow_by_texture(np.full((160, 240, 2), (-3, 0), np.float32), before, after, 2)[..., 0]
    if sky is not None:
        assert (flow[:60] == sky).mean() > 0.9, "edges along the motion look as if they rested"
    assert (flow[52:60, 16:104] == (-3 if moved else 0)).mean() > 0.9, "the sky does what is below it"
    assert (flow[52:60, 136:224] == (-3 if moved == 240 else 0)).mean() > 0.9


@pytest.mark.parametrize(("flow_px", "goes"), [(-3.0, True), (-0.2, False)])
def test_a_flat_object_moves_past_still_objects_with_the_flow(flow_px: float, goes: bool) -> None:
    """A stripe with a rough edge moves by 3 px over a rough wall; its plain middle does not change."""
    rough = np.clip(cv2.GaussianBlur(np.random.default_rng(4).normal(0, 900, (160, 260)), (0, 0), 2) + 128, 0, 255)
    before = rough[:, :240].astype(np.uint8)
    after = before.copy()
    before[64:80], after[64:80] = 128, 128
    edge = np.random.default_rng(5).integers(0, 255, (4, 243), np.uint8)
    for top in (64, 76):
        before[top : top + 4], after[top : top + 4] = edge[:, :240], edge[:, 3:]
    flow = np.zeros((160, 240, 2), np.float32)
    flow[64:80, :, 0] = flow_px
    found = zero_still_flow_by_texture(flow, before, after, 2)[..., 0]
    assert (found[71:73, 30:210] == (flow_px if goes else 0)).mean() > 0.9
    assert (found[:40] == 0).all() and (found[120:] == 0).all()


# -- regions


def test_a_label_map_is_propagated_in_both_directions_up_to_a_cut() -> None:
    inputs = {"design": {"version": 1, "regions": {"left": {"label": 1}}}, "masks": {2: labels()}}
    context = LocalContext(MultistyleParams(), shots(), inputs)
    run_plan(MULTISTYLE, context)
    found = np.concatenate([context.kept["maps", f"map-{start:07d}"]["maps"] for start in (0, CUT)])
    share = (found == 1).mean(axis=(1, 2))
    assert (np.abs(share[:CUT] - labels().mean()) < 0.1).all() and (share[CUT:] == 0).all()


def test_tubes_and_objects_are_listed_and_can_form_regions() -> None:
    inputs = {"design": {"version": 1, "regions": {"all": {"tubes": [1, 2]}}, "keys": [{"region": "all"}]}}
    context = LocalContext(MultistyleParams(), shots(), inputs, artefacts=frozenset({"regions"}))
    run_plan(MULTISTYLE, context)
    listed = json.loads(context.files["regions-list.json"])
    numbers = [tube["tube"] for tube in listed["tubes"]]
    assert numbers == list(range(1, len(numbers) + 1)) and {o["object"] for o in listed["objects"]} <= set(range(1, 9))
    assert all(len(tube["colour"]) == 3 and 0 <= tube["first"] <= tube["last"] < 12 for tube in listed["tubes"])
    assert listed["regions"][1]["name"] == "all" and listed["regions"][1]["area"] > 0
    pictures = pages(context)
    coded = cv2.imdecode(np.frombuffer(pictures["tubes-0000003.png"], np.uint8), cv2.IMREAD_COLOR).astype(int)
    number = coded[..., 2] * 65536 + coded[..., 1] * 256 + coded[..., 0]
    named = cv2.imdecode(np.frombuffer(pictures["map-0000003.png"], np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(np.isin(number, [1, 2]), named == 1)
    assert number.min() >= 1 and number.max() <= len(numbers)


def test_an_unknown_tube_is_rejected() -> None:
    inputs = {"design": {"version": 1, "regions": {"all": {"tubes": [1, 99999]}}}}
    with pytest.raises(BadParameter) as caught:
        run_plan(MULTISTYLE, LocalContext(MultistyleParams(), shots(), inputs))
    assert caught.value.field == "inputs.design.regions.all.tubes[1]"


@pytest.mark.parametrize(
    ("masks", "field"), [({99: labels()}, "inputs.masks"), ({0: labels()[:, :30]}, "inputs.masks")]
)
def test_invalid_label_maps_are_rejected(masks: Any, field: str) -> None:
    inputs = {"design": {"version": 1, "regions": {"left": {"label": 1}}}, "masks": masks}
    with pytest.raises(BadParameter) as caught:
        run_plan(MULTISTYLE, LocalContext(MultistyleParams(), shots(), inputs))
    assert caught.value.field == field and caught.value.remedy


def test_an_outline_splits_a_region() -> None:
    box = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.5], [0.0, 0.5]]
    regions = {"left": {"label": 1}, "top": {"polygons": [{"frame": 0, "points": box}], "of": "left"}}
    inputs = {"design": {"version": 1, "regions": regions}, "masks": {0: labels()}}
    context = LocalContext(MultistyleParams(), shots()[:1], inputs)
    run_plan(MULTISTYLE, context)
    found = context.kept["maps", "map-0000000"]["maps"][0]
    assert (found[:30, :38] == 2).all() and (found[34:, :38] == 1).all() and (found[:, 42:] == 0).all()


# -- style and direction of regions


def fields(document: dict[str, Any], size: tuple[int, int] = SIZE, small: tuple[int, int] = (48, 32)) -> DesignFields:
    named = STYLES["van-gogh"]
    return DesignFields(parse(document), named.style, named.technique, size, small)


def halves() -> NDArray[np.uint8]:
    """Region 1 to the left, 2 to the right, the rest between."""
    out = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    out[:, :20], out[:, 76:] = 1, 2
    return out


TWO = {"one": {"label": 1}, "two": {"label": 2}}


def test_keys_are_interpolated_and_spread() -> None:
    keys = [
        {"region": "one", "frame": 0, "set": {"size": 10}}, {"region": "one", "frame": 10, "set": {"size": 20}},
        {"region": "two", "frame": 0, "set": {"size": 40}},
    ]  # fmt: skip
    values = fields({"version": 1, "regions": TWO, "keys": keys}).values(RegionPlacement(5, halves(), {}, {}))
    size = np.asarray(values["size"])
    assert (size[:, :20] == 15).all() and (size[:, 76:] == 40).all()
    np.testing.assert_allclose(size[32, 24:72], np.interp(np.arange(24, 72), [19.5, 76], [15, 40]), atol=1.2)
    assert values["hue"] == 0.0


def test_styles_do_not_spread_across_a_sharp_border() -> None:
    keys = [{"region": "one", "set": {"size": 10}}, {"region": "two", "set": {"size": 40}}]
    regions = {"one": {"label": 1, "border": "sharp"}, "two": {"label": 2}}
    size = np.asarray(
        fields({"version": 1, "regions": regions, "keys": keys}).values(RegionPlacement(0, halves(), {}, {}))["size"]
    )
    assert (size[:, :20] == 10).all() and (np.abs(size[:, 22:] - 40) < 0.1).all()


def test_styles_change_gradually_across_a_soft_border() -> None:
    keys = [{"region": "one", "set": {"size": 10}}, {"region": "rest", "set": {"size": 40}}]
    regions = {"one": {"label": 1, "border": "soft"}, "two": {"label": 2}}
    size = np.asarray(
        fields({"version": 1, "regions": regions, "keys": keys}).values(RegionPlacement(0, halves(), {}, {}))["size"]
    )
    assert np.abs(np.diff(size[32, :70])).max() < 14 and size[32, 2] < 12 and size[32, 40] > 39


def test_a_design_without_keys_keeps_the_style() -> None:
    values = fields({"version": 1, "regions": TWO}).values(RegionPlacement(0, halves(), {}, {}))
    assert [values[name] for name in FIELDS] == pytest.approx(vector(STYLES["van-gogh"].style).tolist())


def test_directions_change_at_borders_and_fill_free_regions() -> None:
    across = {"pattern": "regular", "at": [0.5, 0.5], "angle": 0}
    down = {"pattern": "regular", "at": [0.5, 0.5], "angle": 90}
    directions = [
        {"region": "one", "edge_weight": 0, "elements": [across]},
        {"region": "rest", "edge_weight": 0, "elements": [down]},
        {"region": "two", "free": True},
    ]
    edges = np.stack([np.full((32, 48), 0.3), np.full((32, 48), 0.4)]).astype(np.float32)
    field = fields({"version": 1, "regions": TWO, "directions": directions}).directions(
        edges, RegionPlacement(0, halves(), {}, {})
    )
    angle = np.degrees(angle_of(field))
    assert np.abs(angle[:, :9]).max() < 1 and np.abs(angle[:, 11:] - 90).max() < 1


def test_directions_change_gradually_across_a_soft_border() -> None:
    level, steep = ([{"pattern": "regular", "at": [0.5, 0.5], "angle": angle}] for angle in (0, 60))
    angles = []
    for border in ("plain", "soft"):
        regions = {**TWO, "one": {**TWO["one"], "border": border}}
        directions = [
            {"region": name, "edge_weight": 0, "elements": elements}
            for name, elements in (("one", level), ("rest", steep), ("two", steep))
        ]
        field = fields({"version": 1, "regions": regions, "directions": directions}, small=SIZE).directions(
            np.zeros((2, *SIZE[::-1]), np.float32), RegionPlacement(0, halves(), {}, {})
        )
        angles.append(np.degrees(angle_of(field))[32])
    assert np.isin(np.rint(angles[0]), (0, 60)).all()
    assert (np.abs(angles[1] - 30) < 20).sum() >= 2 and np.abs(angles[1] - angles[0])[[0, -1]].max() < 1


@pytest.mark.parametrize("seed", range(4))
def test_laplace_equations_are_solved_to_six_digits_in_twelve_cycles(seed: int) -> None:
    """Regions of every kind: with a style and without, behind sharp borders and not, in pieces and within others."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(240, 320)), (0, 0), 13 + 4 * seed)
    ranks = np.searchsorted(np.quantile(noise, [0.3, 0.5, 0.7, 0.85]), noise)
    regions = {name: {"label": k + 1, "border": kind} for k, (name, kind) in enumerate(
        {"a": "plain", "b": "sharp", "c": "plain", "d": "sharp"}.items())}  # fmt: skip
    keys = [{"region": "a", "set": {"size": 10}}, {"region": "d", "set": {"size": 40, "hue": 20}}]
    element = {"pattern": "center", "at": [0.5, 0.5]}
    directions = [{"region": "a", "elements": [element]}, *({"region": name, "free": True} for name in "bc")]
    document = {"version": 1, "regions": regions, "keys": keys, "directions": directions}
    chosen = fields(document, (320, 240), (213, 160))
    placed = RegionPlacement(0, ranks.astype(np.uint8), {}, {})
    size = np.asarray(chosen.values(placed)["size"])
    chosen.directions(np.ones((2, 160, 213), np.float32), placed)
    assert 0 < chosen.cycles <= 12 and chosen.residual <= 1e-6
    assert (size[ranks == 1] == 10).all() and (size[ranks == 4] == 40).all()
    assert (size >= 10 - 1e-4).all() and (size <= 40 + 1e-4).all()


def test_a_region_has_its_own_complete_style() -> None:
    """Watercolour to the left, Van Gogh elsewhere: ground, paper and stroke profiles differ."""
    keys = [{"region": "one", "style": "watercolor"}, {"region": "two", "style": "van-gogh"}]
    made = fields({"version": 1, "regions": TWO, "keys": keys}).values(RegionPlacement(0, halves(), {}, {}))
    for name in ("paper", "rim", "cover", "soft", "vivid", "light", "order_mix"):
        left, right = (getattr(STYLES[style].technique, name) for style in ("watercolor", "van-gogh"))
        plane = np.asarray(made[name])
        np.testing.assert_allclose(plane[:, :20], left, rtol=1e-6)
        np.testing.assert_allclose(plane[:, 76:], right, rtol=1e-6)


def test_paper_appears_only_in_watercolour_regions() -> None:
    frames, label = shots()[:3], np.zeros((SIZE[1], SIZE[0]), np.uint8)
    label[:, :48] = 1
    pictures = []
    for style in ("watercolor", "without-paper"):
        document = {
            "version": 1, "regions": {"one": {"label": 1, "border": "sharp"}},
            "styles": {"without-paper": {"base": "watercolor", "technique": {"paper": 0, "rim": 0}}},
            "keys": [{"region": "one", "style": style}, {"region": "rest", "style": "van-gogh"}],
        }  # fmt: skip
        context = LocalContext(
            MultistyleParams(accumulated_frames=0), frames, {"design": document, "masks": {0: label}}, seed=3
        )
        run_plan(MULTISTYLE, context)
        pictures.append(painted(context).astype(int))
    off = np.abs(pictures[0] - pictures[1])
    assert off[:, :, :36].mean() > 1 and off[:, :, 60:].max() <= 1


def test_hue_is_interpolated_over_the_shorter_arc() -> None:
    keys = [
        {"region": "one", "frame": 0, "set": {"hue": 170}}, {"region": "one", "frame": 10, "set": {"hue": -170}},
        {"region": "two", "frame": 0, "set": {"hue": -160}},
    ]  # fmt: skip
    hue = np.asarray(
        fields({"version": 1, "regions": TWO, "keys": keys}).values(RegionPlacement(5, halves(), {}, {}))["hue"]
    )
    assert np.abs(hue[:, :20] % 360 - 180).max() < 1e-3 and np.abs(hue[:, 76:] % 360 - 200).max() < 1e-3
    assert (hue % 360).min() > 179 and (hue % 360).max() < 201


def test_the_painting_order_of_the_paper_can_be_selected() -> None:
    one, other = (MultistyleSession(MultistyleParams(stroke_order=order), SIZE, 3) for order in ("mixed", "colour"))
    apart = [np.abs(one.step(frame).astype(int) - other.step(frame)).mean() for frame in shots()[:3]]
    assert all(0.3 < value < 25 for value in apart), apart


def test_the_order_is_the_total_order_of_the_paper() -> None:
    rows = np.array(
        [[5, 0, 0], [0, 5, 0], [3, 4, 0], [4, 3, 0], [0, 3, 4], [0, 4, 3], [1, 1, 1], [0, 0, 5]], np.float32
    )
    order = colour_order(rows).tolist()
    assert [rows[k].astype(int).tolist() for k in order] == [
        [1, 1, 1], [0, 0, 5], [5, 0, 0], [0, 3, 4], [4, 3, 0], [0, 4, 3], [3, 4, 0], [0, 5, 0],
    ]  # fmt: skip
    again = np.random.default_rng(1).permutation(8)
    assert rows[again][colour_order(rows[again])].tolist() == rows[order].tolist()


def test_a_renderer_that_was_removed_is_refused_with_a_remedy() -> None:
    with pytest.raises(BadParameter, match="'implicit-literal' no longer exists") as caught:
        parse_params(method("multistyle"), {"renderer": "implicit-literal"})
    assert caught.value.field == "params.renderer" and "renderer=implicit" in caught.value.remedy


def test_a_tube_keeps_its_number_after_an_occlusion() -> None:
    """A red square passes behind a gray post that is wider than itself."""
    rng, frames = np.random.default_rng(2), []
    for k in range(26):
        frame = np.full((96, 160, 3), (60, 110, 60), np.uint8)
        cv2.rectangle(frame, (10 + 5 * k, 40), (26 + 5 * k, 60), (200, 40, 40), -1)
        frame[:, 66:92] = 150
        frames.append(np.clip(frame + rng.normal(0, 1, frame.shape), 0, 255).astype(np.uint8))
    tracker = TubeTracker((160, 96), 0)
    found = [tracker.step(frame) for frame in frames]
    tubes = tubes_of([merge_results((k, result) for k, (_, result) in enumerate(found))], [(0, 26)], 96, 4)
    number = {one: tube.number for tube in tubes for one in tube.ids}
    before, after = (number[int(found[k][0][50, 18 + 5 * k])] for k in (4, 21))
    assert before == after and found[4][0][50, 38] != found[21][0][50, 123]


def test_the_number_of_objects_is_a_parameter() -> None:
    tracker = TubeTracker(SIZE, 0)
    result = merge_results([(0, tracker.step(shots()[0])[1])])
    for wanted in (2, 4):
        assert len({tube.object for tube in tubes_of([result], [(0, 1)], SIZE[1], wanted)}) == wanted


def test_the_directions_artefact_shows_the_field() -> None:
    context = LocalContext(MultistyleParams(), shots()[:3], artefacts=frozenset({"directions"}))
    run_plan(MULTISTYLE, context)
    with zipfile.ZipFile(io.BytesIO(context.files["directions-0000000.zip"])) as archive:
        names = archive.namelist()
        picture = cv2.imdecode(np.frombuffer(archive.read(names[1]), np.uint8), cv2.IMREAD_COLOR)
    assert names == [f"directions-{k:07d}.png" for k in range(3)] and picture.shape == (SIZE[1], SIZE[0], 3)
    assert np.ptp(picture.astype(int), axis=2).max() > 60, "segments have the hue of their angle"


# -- a moving, turning object


def turning(
    frame: int, size: tuple[int, int] = (192, 144)
) -> tuple[Frame, NDArray[np.uint8], tuple[float, float, float]]:
    """An ellipse with a pattern of its own, that moves 1.5 px and turns 4 degrees a frame; its map, centre, angle."""
    x0, y0, angle = 70 + 1.5 * frame, 60 + 0.8 * frame, math.radians(20 + 4 * frame)
    y, x = np.indices(size[::-1], np.float32)
    u = (x - x0) * math.cos(angle) + (y - y0) * math.sin(angle)
    v = (y - y0) * math.cos(angle) - (x - x0) * math.sin(angle)
    inside = (u / 44) ** 2 + (v / 20) ** 2 <= 1
    texture = 120 + 50 * np.sin(u / 4) * np.cos(v / 3)
    ground = 60 + 25 * np.sin(x / 5) * np.cos(y / 6)
    picture = np.dstack([np.where(inside, 200, ground), np.where(inside, texture, ground), np.where(inside, 40, 90)])
    return np.clip(picture, 0, 255).astype(np.uint8), inside.astype(np.uint8), (x0, y0, angle)


def test_a_design_element_follows_a_moving_rotating_object() -> None:
    frames = [turning(k)[0] for k in range(11)]
    element = {"pattern": "regular", "at": [70.5 / 192, 60.5 / 144], "angle": 20}
    document = {
        "version": 1, "regions": {"it": {"label": 1}},
        "directions": [{"region": "it", "frame": 0, "edge_weight": 0, "elements": [element]}],
    }  # fmt: skip
    inputs = {"design": document, "masks": {0: turning(0)[1], 10: turning(10)[1]}}
    context = LocalContext(MultistyleParams(), frames, inputs)
    tasks = [task for task in run_plan(MULTISTYLE, context)["paint"] if task.key.startswith("analyze")]
    ellipses = tasks[0].args["ellipses"]["it"]
    for k in range(11):
        x, y, angle = turning(k)[2]
        own = ellipses[str(k)]
        assert math.hypot(own[0] - x, own[1] - y) < 2
        assert abs(math.degrees(own[2] - angle)) < 3
        field = context.kept["paint", "analyze-0000000"][f"{k}.field"].astype(np.float32)
        u, v = field[int(y / 144 * field.shape[0]), int(x / 192 * field.shape[1])]
        apart = math.degrees(math.atan2(v, u) / 2 - angle)
        assert abs((apart + 90) % 180 - 90) < 3
