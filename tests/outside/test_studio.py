"""A method that another package registers has its tool in the studio: what is drawn is previewed and in the film.

The pages and the service are those of the repository; only the package knows its method, input, part and marks.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from pipeline.video.reader import VideoReader
from tests.e2e.pages import FRAMES, HEIGHT, WIDTH, Watched, make_clip, until
from tests.e2e.studio import (
    asset,
    decoded,
    draw,
    frames_of,
    layer_of,
    on_stage,
    open_project,
    render,
    result,
    saved,
    stored,
)
from tests.outside.posterize import stencilled
from tests.waiting import HTTP

pytestmark = pytest.mark.real("chromium")

FIRST = 4
TONES = 2
KEPT, DARK = (0.2, 0.3), (0.7, 0.8)
"""Points of the picture in the middle of a stroke."""


def _flat(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    step = 256 // TONES
    return np.asarray(frame // step * step + step // 2, np.uint8)


def _pixel(at: tuple[float, float]) -> tuple[int, int]:
    return int(at[1] * HEIGHT), int(at[0] * WIDTH)


def _shown(page: Page, point: tuple[float, float]) -> NDArray[np.int_]:
    """The colour of a point of the stage."""
    left, top = on_stage(page, *point)
    picture = decoded(page.screenshot(clip={"x": left - 1, "y": top - 1, "width": 2, "height": 2}))
    return np.asarray(picture.mean((0, 1)), int)


def test_a_drawn_input_of_an_outside_method_works_in_the_studio(fresh: Watched, address: str, tmp_path: Path) -> None:
    page = fresh.page
    clip = make_clip(tmp_path / "disc.mkv", codec="ffv1")
    video = HTTP.post(f"{address}/v1/assets", files={"file": (clip.name, clip.read_bytes())}).json()["id"]
    project = open_project(page, address, video, "posterize", frame=FIRST, params={"tones": TONES})

    section = page.get_by_role("region", name="Stencil")
    expect(section).to_contain_text("What is marked keeps its tones")
    tools = page.get_by_role("toolbar", name="Tools").get_by_role("button")
    assert {"Brush", "Eraser"} <= set(tools.evaluate_all("all => all.map((one) => one.getAttribute('aria-label'))"))

    page.get_by_role("button", name="Mark the kept part").click()
    marks = page.get_by_role("group", name="The brush marks").get_by_role("button")
    expect(marks).to_have_text(["Kept part", "Dark part"])
    page.get_by_label("Brush size").fill("12")
    draw(page, (KEPT[0] - 0.1, KEPT[1]), (KEPT[0] + 0.1, KEPT[1]))
    marks.get_by_text("Dark part").click()
    draw(page, (DARK[0] - 0.1, DARK[1]), (DARK[0] + 0.1, DARK[1]))
    saved(page)

    document = stored(address, project)
    (drawing,) = layer_of(document)["stencil"]
    assert drawing["frame"] == FIRST
    png = cv2.imdecode(np.frombuffer(asset(address, document, drawing["image"]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert png is not None and png.shape == (HEIGHT, WIDTH, 4)
    stencil = np.asarray(png[..., [2, 1, 0, 3]])
    assert stencil[_pixel(KEPT)].tolist() == [0, 255, 0, 255] and stencil[_pixel(DARK)].tolist() == [0, 0, 255, 255]

    page.reload()
    stage = page.locator(".stage-canvas")
    until(page, lambda: stage.get_attribute("data-frame") == str(FIRST))
    expect(section.get_by_role("button", name="Remove the marks of this frame")).to_be_visible()
    page.get_by_role("button", name="Painted", exact=True).click()
    until(page, lambda: stage.get_attribute("data-result") == "final")
    kept, dark, elsewhere = (_shown(page, point) for point in (KEPT, DARK, (0.9, 0.1)))
    field = (90, 140, 70)
    assert np.abs(kept - field).max() < 12 and dark.max() < 12
    assert np.abs(elsewhere - _flat(np.array(field, np.uint8))).max() < 12

    frames = frames_of(result(address, render(page)))
    with VideoReader(clip) as reader:
        source = list(reader.read())
    assert len(frames) == FRAMES
    for index, (frame, own) in enumerate(zip(frames, source, strict=True)):
        expected = _flat(own) if index < FIRST else stencilled(own, _flat(own), stencil)
        np.testing.assert_array_equal(frame, expected, f"frame {index}")
    fresh.check()
