"""`algorithm=printed`: abstraction as zhang2011online prints it."""

from __future__ import annotations

import io
import zipfile
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.colour.lab8 import rgb_to_lab8
from pipeline.colour.scheme import ColourStats, Tone
from pipeline.frames import Frame
from pipeline.methods import method
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession
from pipeline.methods.abstraction.compositor import CompositedFrame
from pipeline.methods.abstraction.palette import Palette
from pipeline.methods.abstraction.params import PRINTED
from pipeline.methods.abstraction.printed import TAU
from pipeline.methods.local import LocalContext, run_plan
from pipeline.perception.motion import flow_error
from pipeline.scenes import scene
from pipeline.vector.svg import to_svg
from tests.laws.cases import extremes, properties_of
from tests.pipeline.methods.test_palette import GRAY, regions

SIZE = (96, 64)
PROPERTIES = properties_of(method("abstraction"))


def gradient(size: tuple[int, int] = (160, 120)) -> Frame:
    """From dark to light without an edge."""
    return np.dstack([np.broadcast_to(np.linspace(40, 220, size[0]).astype(np.uint8), size[::-1])] * 3)


def portrait(count: int) -> list[Frame]:
    made = scene("portrait", SIZE, frames=count)
    return [made.image(index) for index in range(count)]


def paint(frames: list[Frame], **values: Any) -> list[CompositedFrame]:
    size = (frames[0].shape[1], frames[0].shape[0])
    session = AbstractionSession(AbstractionParams(**values), size)
    return [session.finish(session.analyze(frame)) for frame in frames]


def count(painting: CompositedFrame) -> int:
    return len(painting.regions.ids) - 1


def test_each_area_of_a_ball_is_one_region() -> None:
    (printed,) = paint([gradient()], algorithm="printed")
    (extended,) = paint([gradient()])
    assert count(printed) == 1
    assert count(extended) > 3


def test_edges_divide_areas_and_balls_do_not_leak_through_a_gap() -> None:
    """Two grounds in one colour, divided by a line that a ball of radius 4 cannot pass."""
    frame = np.full((120, 160, 3), 150, np.uint8)
    frame[:, 78:82] = 20
    frame[57:61, 78:82] = 150
    (printed,) = paint([frame], algorithm="printed", edge_threshold=10, lines="off")
    left, right = printed.regions.labels[60, 20], printed.regions.labels[60, 140]
    assert left != right


@pytest.mark.parametrize("name", PRINTED)
def test_parameters_of_departures_have_no_effect_and_say_so(name: str) -> None:
    plain = paint(portrait(4), algorithm="printed")
    for value in extremes(PROPERTIES[name], name):
        changed = paint(portrait(4), algorithm="printed", **{name: value})
        assert all(np.array_equal(a.frame, b.frame) for a, b in zip(plain, changed, strict=True))
    assert all(when.params["algorithm"] == ("extended",) for when in AbstractionParams.applies_when[name])


def test_labels_move_by_whole_pixels_along_the_flow() -> None:
    """A pan of 0.4 px a frame moves no label in the paper; ours follow it (tests/pipeline/regions)."""
    wide = cv2.resize(scene("harbour", SIZE, frames=1).image(0), (192, 128), interpolation=cv2.INTER_CUBIC)
    frames = [
        cv2.warpAffine(wide, np.float32([[1, 0, -0.4 * k], [0, 1, 0]]), (160, 128), flags=cv2.INTER_CUBIC)
        for k in range(3)
    ]
    first, second, _ = paint(frames, algorithm="printed", flow="dis-medium")
    propagated = second.regions.propagated
    inside = (np.abs(second.analysis.flow) < 0.5).all(axis=2) & (propagated > 0)
    assert inside.mean() > 0.5
    np.testing.assert_array_equal(propagated[inside], first.regions.labels[inside])


def test_the_error_of_the_flow_compares_each_pixel_with_the_place_it_moves_to() -> None:
    rng = np.random.default_rng(3)
    before = rng.integers(0, 255, (12, 16, 3), np.uint8)
    now = rng.integers(0, 255, (3, 12, 16), np.uint8)
    flow = rng.uniform(-2, 2, (12, 16, 2)).astype(np.float32)
    found = flow_error(before, now, flow) / 4
    wanted = np.zeros((12, 16))
    for y, x in np.ndindex(12, 16):
        u, v = (float(part) for part in flow[y, x])
        j, i = y + int(np.floor(v + 0.5)), x + int(np.floor(u + 0.5))
        if not (0 <= j < 12 and 0 <= i < 16):
            continue
        there = cv2.remap(
            np.ascontiguousarray(now.transpose(1, 2, 0)), np.float32([[x + u]]), np.float32([[y + v]]),
            cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE,
        )[0, 0]  # fmt: skip
        apart = (before[y, x].astype(float) - there) * (100 / 255, 1, 1)
        wanted[j, i] = max(wanted[j, i], np.linalg.norm(apart))
    np.testing.assert_allclose(found, np.minimum(wanted, 63.5), atol=0.3)


def test_ink_is_the_soft_threshold_of_the_difference_of_gaussians() -> None:
    frames = portrait(2)
    values = {"algorithm": "printed", "line_threshold": 0, "line_sharpness": 0.75, "line_width": 10}
    for frame, painting in zip(frames, paint(frames, **values), strict=True):
        light = rgb_to_lab8(frame)[0].astype(np.float64)
        sigma = 0.01 * SIZE[1]
        narrow, wide = (cv2.GaussianBlur(light, (0, 0), s) for s in (sigma, 1.6 * sigma))
        wanted = 255 * np.tanh(0.75 * np.maximum(TAU * wide - narrow, 0))
        assert painting.lines is not None
        assert np.abs(painting.lines.coverage - wanted).max() < 8
        assert painting.lines.coverage.max() > 100 and not len(painting.lines.strokes.places)


@pytest.mark.parametrize(("algorithm", "kept"), [("printed", False), ("extended", True)])
def test_equation_2_gives_a_gray_region_the_saturation_of_the_reference(algorithm: Any, kept: bool) -> None:
    reference = ColourStats(0.6, 0.1, 0.5, np.full(360, 1 / 360))
    made = Palette(AbstractionParams(algorithm=algorithm).effective(), reference)
    (colour,) = made.step(regions([GRAY], [0], [0]), Tone(0.1, 0.1, 0.5))[1:]
    assert (int(colour.max()) - int(colour.min()) < 3) == kept


def test_svg_has_regions_and_no_lines() -> None:
    context = LocalContext(AbstractionParams(algorithm="printed"), portrait(2), artefacts=frozenset({"svg"}))
    run_plan(method("abstraction"), context)
    (blob,) = [data for name, data in context.files.items() if name.endswith(".zip")]
    with zipfile.ZipFile(io.BytesIO(blob)) as pages:
        page = pages.read("00001.svg").decode()
    painting = paint(portrait(2), algorithm="printed")[1]
    assert page.count("<path") == count(painting) == to_svg(painting.labels, painting.colours).decode().count("<path")


def test_a_session_may_change_between_the_algorithms() -> None:
    frames = portrait(6)
    session = AbstractionSession(AbstractionParams(), SIZE)
    session.step(frames[0])
    for frame, algorithm in zip(frames[1:], ("printed", "extended", "printed", "printed", "extended"), strict=True):
        session = session.reconfigure(AbstractionParams(algorithm=algorithm), SIZE)
        assert session.step(frame).std() > 10


def test_frames_of_any_size_are_painted() -> None:
    rng = np.random.default_rng(5)
    for size in ((1, 1), (3, 2), (17, 40)):
        frames = [rng.integers(0, 255, (size[1], size[0], 3), np.uint8) for _ in range(2)]
        assert [p.frame.shape for p in paint(frames, algorithm="printed")] == [(size[1], size[0], 3)] * 2
