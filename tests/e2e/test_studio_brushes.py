"""Brushes in the studio, with real pen events: strokes are drawn again exactly; lines, sizes, colours, fills, views."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from tests.e2e.pages import COLOURS_HAVE_CHANGED, HEIGHT, WIDTH, Watched, until
from tests.e2e.studio import (
    SOON_MS,
    asset,
    decoded,
    draw,
    layer_of,
    on_stage,
    open_project,
    saved,
    start_painting,
    stored,
)

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

BRUSHES = (
    "Pencil",
    "Ink pen",
    "Brush pen",
    "Marker",
    "Gouache",
    "Oil",
    "Watercolour",
    "Pastel",
    "Charcoal",
    "Airbrush",
)
Sample = tuple[float, float, float, int, int]
"""Of a pen: x, y as fractions of the picture, pressure 0..1, tilt to the right and to the front in degrees."""


def pen(page: Page, samples: list[Sample]) -> None:
    session = page.context.new_cdp_session(page)
    for index, (x, y, force, right, front) in enumerate(samples):
        left, top = on_stage(page, x, y)
        event = {"type": "mouseMoved" if index else "mousePressed", "x": left, "y": top, "button": "left", "buttons": 1}
        leaning = {"pointerType": "pen", "force": force, "tiltX": right, "tiltY": front}
        session.send("Input.dispatchMouseEvent", event | leaning)
    session.send("Input.dispatchMouseEvent", event | {"type": "mouseReleased", "pointerType": "pen", "force": 0})


def arc(y: float, tilt: int = 0) -> list[Sample]:
    return [(0.15 + 0.07 * i, y + 0.02 * (i % 3), 0.2 + 0.08 * i, tilt, 0) for i in range(11)]


def choose(page: Page, name: str, size: int = 14) -> None:
    page.get_by_role("button", name="Brush:").click()
    page.get_by_role("list", name="Brushes").get_by_role("button", name=name, exact=True).click()
    page.get_by_role("button", name="Close the drawing panel").click()
    page.get_by_label("Brush size").fill(str(size))


def exported(page: Page) -> bytes:
    with page.expect_download() as download:
        page.get_by_role("button", name="Export PNG").click()
    return download.value.path().read_bytes()


def strokes_of(service: str, project: str) -> dict[str, Any]:
    document = stored(service, project)
    (key,) = layer_of(document)["keys"]
    found: dict[str, Any] = json.loads(asset(service, document, key["paint"]["layers"][1]["strokes"]))
    return found


def image_of(page: Page, service: str, project: str) -> NDArray[np.int64]:
    saved(page)
    document = stored(service, project)
    return decoded(asset(service, document, layer_of(document)["keys"][0]["image"])).astype(int)


def test_strokes_keep_pressure_and_tilt_and_are_drawn_again_exactly(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    for row, name in enumerate(BRUSHES):
        choose(page, name)
        pen(page, arc(0.08 + 0.08 * row, tilt=45 if row % 2 else 0))
    saved(page)
    file = strokes_of(service, project)
    assert len(file["tips"]) == len(file["strokes"]) == len(BRUSHES)
    for row, stroke in enumerate(file["strokes"]):
        pressures = [sample[2] for sample in stroke["samples"]]
        assert pressures == sorted(pressures) and pressures[0] == 0.2 and pressures[-1] == 1.0
        leans = {tuple(sample[3:]) for sample in stroke["samples"]}
        assert leans == ({(45, 0)} if row % 2 else {()})
    document = stored(service, project)
    png = asset(service, document, layer_of(document)["keys"][0]["image"])
    assert exported(page) == png, "the strokes under the pen are the stored ones"
    page.reload()
    page.get_by_role("button", name="Key at frame 5").click()
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "4", timeout=SOON_MS)
    assert exported(page) == png, "drawn again from their samples, they have the same bytes"
    watched.check()


def test_everything_drawn_is_undone_and_redone_exactly(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    before = exported(page)
    pictures = []
    for row, name in enumerate(BRUSHES):
        choose(page, name)
        pen(page, arc(0.08 + 0.08 * row))
    for key, y in (("e", 0.3), ("s", 0.5), ("g", 0.95)):
        page.keyboard.press(key)
        if key == "g":
            page.mouse.click(*on_stage(page, 0.5, y))
        else:
            choose(page, "Charcoal")
            pen(page, arc(y))
    after = exported(page)
    steps = (3, 4, 6)  # back to the brushes, to the sixth of them, to nothing
    for count in steps:
        for _ in range(count):
            page.keyboard.press("Control+z")
        pictures.append(exported(page))
    assert pictures[-1] == before
    assert len({*pictures, after}) == 4
    for count, picture in zip(steps[::-1], [*pictures[-2::-1], after], strict=True):
        for _ in range(count):
            page.keyboard.press("Control+Shift+z")
        assert exported(page) == picture


def test_lines_size_and_colours(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    choose(page, "Ink pen", 6)
    ring = page.locator(".brush-ring")
    page.mouse.move(*on_stage(page, 0.3, 0.3))
    expect(ring).to_be_visible()
    before = ring.bounding_box()
    page.keyboard.down("Control")
    draw(page, (0.3, 0.3), (0.4, 0.3))
    page.keyboard.up("Control")
    after = ring.bounding_box()
    assert before and after and after["width"] > 2 * before["width"]
    wide = int(page.get_by_label("Brush size").input_value())
    assert abs(wide - 6 - 2 * 0.1 * WIDTH) <= 2
    page.get_by_label("Brush size").fill("6")

    page.mouse.click(*on_stage(page, 0.2, 0.2))
    page.keyboard.down("Shift")
    page.mouse.click(*on_stage(page, 0.8, 0.6))
    page.keyboard.up("Shift")
    saved(page)
    line = strokes_of(service, project)["strokes"][1]["samples"]
    assert len(line) == 2, "one straight line, from the end of the last stroke"
    assert np.allclose([line[0][:2], line[1][:2]], [(0.2 * WIDTH, 0.2 * HEIGHT), (0.8 * WIDTH, 0.6 * HEIGHT)], atol=0.6)

    page.keyboard.press("x")
    colour = page.locator(".brush-settings input[type=color]")
    expect(colour).to_have_value("#ffffff")
    page.keyboard.press("x")
    expect(colour).to_have_value("#2040ff")
    page.get_by_role("button", name="Colours", exact=True).click()
    recent = page.get_by_role("group", name="Recent colours")
    expect(recent.get_by_role("button", name="#2040ff")).to_have_attribute("aria-pressed", "true")
    page.get_by_label("Hue").fill("0")
    page.get_by_label("Saturation").fill("100")
    expect(colour).to_have_value("#ff0000")
    page.get_by_role("button", name="Take the colours of this frame").click()
    palette = page.get_by_role("group", name="Colours of the painting").get_by_role("button")
    expect(palette.first).to_be_visible(timeout=SOON_MS)
    assert 2 <= palette.count() <= 12


def test_a_fill_closes_gaps_and_looks_at_the_layer_alone(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    page.get_by_label("Brush size").fill("3")
    corners = [(0.60, 0.20), (0.90, 0.20), (0.90, 0.80), (0.60, 0.80), (0.60, 0.33)]  # open by 5 px beside the line
    draw(page, *corners)
    page.keyboard.press("g")
    page.locator(".brush-settings input[type=color]").fill("#ff2000")
    inside, outside = (int(0.5 * HEIGHT), int(0.75 * WIDTH)), (int(0.9 * HEIGHT), int(0.2 * WIDTH))
    page.get_by_label("Look at the layer alone").check()
    page.mouse.click(*on_stage(page, 0.75, 0.5))
    leaked = image_of(page, service, project)
    assert leaked[outside].tolist() == [255, 32, 0], "on a layer without other paint, the fill leaves by the gap"
    page.keyboard.press("Control+z")
    page.get_by_label("Close gaps").fill("8")
    page.mouse.click(*on_stage(page, 0.75, 0.5))
    until(page, lambda: image_of(page, service, project)[inside].tolist() == [255, 32, 0])
    assert image_of(page, service, project)[outside].tolist() != [255, 32, 0]


def test_views_stay_while_painting(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    draw(page, (0.1, 0.5), (0.9, 0.5))
    stage = page.locator(".stage-canvas")
    seen = {}
    views = page.get_by_role("group", name="View while painting")
    page.mouse.move(5, 5)
    for name in ("Painting", "Compare", "Overlay", "Original"):
        views.get_by_role("button", name=name).click()
        page.wait_for_timeout(200)
        seen[name] = decoded(stage.screenshot()).astype(int)
    left, right = (slice(None), slice(0, seen["Painting"].shape[1] // 2 - 30)), (slice(None), slice(-60, None))
    assert (seen["Compare"][left] == seen["Original"][left]).all()
    assert (seen["Compare"][left] != seen["Painting"][left]).any()
    assert (seen["Compare"][right] == seen["Painting"][right]).all()
    half = (seen["Painting"] + seen["Original"]) / 2
    assert np.abs(seen["Overlay"] - half).mean() < 1
    views.get_by_role("button", name="Painting").click()
    page.get_by_label("Onion skin").select_option("original")
    until(page, lambda: (decoded(stage.screenshot()).astype(int) != seen["Painting"]).any())
    page.get_by_label("Onion skin").select_option("off")

    page.keyboard.press("h")
    draw(page, (0.1, 0.2), (0.3, 0.2))
    page.keyboard.press("h")
    for _ in range(6):
        page.keyboard.press("6")  # a quarter turn
    box = stage.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 - 60)
    saved(page)
    _, mirrored, turned = strokes_of(service, project)["strokes"]
    assert np.isclose(mirrored["samples"][0][0], 0.9 * WIDTH, atol=0.7)
    x, y, _pressure = turned["samples"][0]
    assert x < 0.4 * WIDTH and abs(y - HEIGHT / 2) < 1, "up on the stage is left in the picture"
    page.keyboard.press("0")
    page.keyboard.press("f")
    expect(page.get_by_role("complementary", name="Settings")).to_be_hidden()
    expect(page.locator(".filmstrip")).to_be_hidden()
    draw(page, (0.5, 0.5), (0.6, 0.6))
    page.keyboard.press("f")
    expect(page.locator(".filmstrip")).to_be_visible()
    saved(page)
    assert len(strokes_of(service, project)["strokes"]) == 4


def test_strokes_of_the_list_are_seen_in_light_and_dark(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    open_project(page, service, video, "analogy")
    page.emulate_media(color_scheme="light")
    page.get_by_role("button", name="Brush", exact=True).click()
    page.get_by_role("button", name="Brush:").click()
    strokes = page.locator(".brush-preview").first
    expect(strokes).to_be_visible()
    levels = {}
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        page.evaluate(COLOURS_HAVE_CHANGED)
        shown = cv2.imdecode(np.frombuffer(strokes.screenshot(), np.uint8), cv2.IMREAD_GRAYSCALE)
        assert shown is not None
        levels[scheme] = int(shown.min()), int(shown.max())
    assert all(most - least > 120 for least, most in levels.values()), levels
    page.emulate_media(color_scheme="light")


def test_own_brushes_and_a_reference(watched: Watched, service: str, video: str, tmp_path: Path) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    stamp = np.zeros((40, 40, 4), np.uint8)
    stamp[18:22] = 255  # a horizontal bar
    cv2.imwrite(str(tmp_path / "bar.png"), stamp)
    page.get_by_role("button", name="Brush:").click()
    page.get_by_label("Brush from a picture or a brush set").set_input_files(tmp_path / "bar.png")
    page.get_by_role("button", name="Close the drawing panel").click()
    expect(page.get_by_role("button", name="Brush: bar")).to_be_visible(timeout=SOON_MS)
    page.get_by_label("Brush size").fill("30")
    page.mouse.click(*on_stage(page, 0.7, 0.3))
    image = image_of(page, service, project)
    x, y = int(0.7 * WIDTH), int(0.3 * HEIGHT)
    assert image[y, x + 10].tolist() == [0x20, 0x40, 0xFF] != image[y + 10, x].tolist()
    page.reload()
    start_painting(page)
    page.get_by_role("button", name="Brush:").click()
    expect(page.get_by_role("button", name="Remove bar")).to_be_visible()

    (tmp_path / "broken.abr").write_bytes(b"no brush set")
    page.get_by_label("Brush from a picture or a brush set").set_input_files(tmp_path / "broken.abr")
    expect(page.get_by_text("cannot be read")).to_be_visible(timeout=SOON_MS)

    cv2.imwrite(str(tmp_path / "reference.png"), np.full((30, 40, 3), (10, 200, 30), np.uint8))
    page.get_by_role("tab", name="Reference").click()
    page.get_by_label("Open a reference picture").set_input_files(tmp_path / "reference.png")
    page.get_by_role("img", name="Reference").click(timeout=SOON_MS)
    expect(page.locator(".brush-settings input[type=color]")).to_have_value("#1ec80a")
    saved(page)
    assert stored(service, project)["ui"]["reference"] in stored(service, project)["assets"]
