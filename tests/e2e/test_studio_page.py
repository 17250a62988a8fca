"""The studio in Chromium with real pointer events, against the whole service: painted keys, regions, undo, saving."""

from __future__ import annotations

import io
import json
import zipfile

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.pages import FRAMES, HEIGHT, WIDTH, Watched, accessibility_faults, open_page, until
from tests.e2e.studio import (
    FILM_MS,
    SOON_MS,
    Document,
    asset,
    choose_format,
    choose_style,
    decoded,
    draw,
    draw_with_pen,
    finished,
    layer_of,
    on_stage,
    open_project,
    saved,
    start_painting,
    stored,
)
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]


def test_a_keyframe_painted_with_pressure_is_in_the_film_exactly(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    draw_with_pen(page, [(0.2 + 0.05 * i, 0.3, 0.2 + 0.06 * i) for i in range(12)])
    saved(page)
    expect(page.get_by_role("group", name="Frames painted from this key").get_by_role("button")).to_have_count(
        7, timeout=90_000
    )
    document = stored(service, project)
    (key,) = layer_of(document)["keys"]
    assert key["frame"] == 4
    strokes = json.loads(asset(service, document, key["paint"]["layers"][1]["strokes"]))["strokes"]
    pressures = [pressure for _, _, pressure in strokes[0]["samples"]]
    assert pressures[0] == pytest.approx(0.2, abs=0.02) and pressures[-1] > 0.7
    painted = decoded(asset(service, document, key["image"]))
    assert painted.shape == (HEIGHT, WIDTH, 3)
    thick, thin = ((painted[:, int(x * WIDTH), 2] > 220).sum() for x in (0.68, 0.24))
    assert thick > 1.5 * thin, "more pressure, a wider stroke"

    page.reload()
    expect(page.get_by_role("button", name="Key at frame 5")).to_be_visible(timeout=SOON_MS)
    choose_format(page)
    page.get_by_role("button", name="Paint the film").click()
    result = HTTP.get(f"{service}/v1/jobs/{finished(page)}/result").content
    with zipfile.ZipFile(io.BytesIO(result)) as frames:
        names = sorted(frames.namelist())
        assert len(names) == FRAMES
        assert np.array_equal(decoded(frames.read(names[4])), painted)


def test_undo_and_redo_by_keyboard_restore_the_stored_project(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    # A painting that comes after the first stroke would become the base of the key, which is no step to undo.
    expect(page.locator(".stage-hint")).to_contain_text("Preview at", timeout=FILM_MS)
    before = stored(service, project)
    start_painting(page)
    draw(page, (0.2, 0.2), (0.6, 0.5))
    one = stored_after(page, service, project, before)
    draw(page, (0.7, 0.2), (0.8, 0.8))
    two = stored_after(page, service, project, one)
    assert two != before
    for shortcut, expected in (("Control+z", one), ("Control+z", before), ("Control+Shift+z", one), ("Control+y", two)):
        page.keyboard.press(shortcut)
        until(page, lambda expected=expected: stored(service, project) == expected)


def stored_after(page: Page, service: str, project: str, before: Document) -> Document:
    """The next document that is stored and does not change within a second: a stroke may be stored in two steps."""
    until(page, lambda: stored(service, project) != before)
    while True:
        saved(page)
        found = stored(service, project)
        page.wait_for_timeout(1000)
        if stored(service, project) == found:
            return found


def test_frames_are_stepped_exactly(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    open_project(page, service, video, "abstraction")
    canvas = page.locator(".stage-canvas")
    page.get_by_role("button", name="Original").click()
    page.keyboard.press("Home")
    positions = []
    for frame in range(FRAMES):
        until(page, lambda frame=frame: canvas.get_attribute("data-frame") == str(frame))
        expect(page.locator(".strip-time")).to_contain_text(f"Frame {frame + 1} of {FRAMES}")
        # A screenshot may still show the frame before.
        until(page, lambda: not positions or disc_at(page) > positions[-1] + 0.02)
        positions.append(disc_at(page))
        page.keyboard.press("ArrowRight")
    steps = np.diff(positions)
    assert (steps > 0).all(), "each step shows the next frame"
    assert steps == pytest.approx(np.full(FRAMES - 1, 1 / (FRAMES + 10)), abs=0.02)
    page.keyboard.press("l")
    until(page, lambda: canvas.get_attribute("data-frame") == str(FRAMES - 1))
    page.keyboard.press("j")
    until(page, lambda: canvas.get_attribute("data-frame") == "0")


def disc_at(page: Page) -> float:
    """Horizontal position of the disc on the stage: 0 left, 1 right."""
    left, y = on_stage(page, 0, 0.5)
    right, _ = on_stage(page, 1, 0.5)
    shot = decoded(page.screenshot(clip={"x": left, "y": y, "width": right - left, "height": 2}))
    return float(np.flatnonzero(shot[0, :, 0] > 180).mean() / shot.shape[1])


def test_regions_styles_and_directions_match_the_drawing(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "multistyle")
    page.get_by_role("button", name="Draw a region").click()
    draw(page, (0.1, 0.1), (0.5, 0.1), (0.5, 0.9), (0.1, 0.9), (0.1, 0.15))
    choose_style(page, "Pointillism")
    page.keyboard.press("End")
    choose_style(page, "Watercolor")
    page.get_by_label("Change to the next key").select_option("smooth")
    page.get_by_role("group", name="Pattern").get_by_role("button", name="Circles").click()
    draw(page, (0.3, 0.5), (0.4, 0.6))
    page.get_by_role("group", name="Pattern").get_by_role("button", name="Spiral").click()
    page.get_by_label("Angle", exact=True).fill("30")
    page.get_by_label("Reach", exact=True).fill("0.25")
    saved(page)
    layer = layer_of(stored(service, project))
    (polygon,) = layer["design"]["regions"]["region"]["polygons"]
    corners = np.array(polygon["points"])
    assert polygon["frame"] == 4
    assert corners.min(axis=0) == pytest.approx([0.1, 0.1], abs=0.02)
    assert corners.max(axis=0) == pytest.approx([0.5, 0.9], abs=0.02)
    keys = [(key["frame"], key["style"]) for key in layer["design"]["keys"]]
    assert keys == [(4, "pointillism"), (FRAMES - 1, "watercolor")]
    assert layer["design"]["keys"][1]["ease"] == "smooth"
    (direction,) = layer["design"]["directions"]
    (element,) = direction["elements"]
    assert (element["pattern"], element["angle"]) == ("spiral", 30)
    assert element["at"] == pytest.approx([0.3, 0.5], abs=0.01)
    assert element["reach"] == 0.25
    page.get_by_role("button", name="Paint the film").click()
    finished(page)


def test_scribbles_define_the_foreground_of_patches(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "patches")
    page.get_by_role("button", name="Mark the foreground").click()
    page.wait_for_timeout(300)
    draw(page, (0.35, 0.45), (0.45, 0.55))
    page.get_by_role("button", name="Mark the background").click()
    draw(page, (0.8, 0.1), (0.9, 0.9))
    saved(page)
    document = stored(service, project)
    (scribble,) = layer_of(document)["scribbles"]
    assert scribble["frame"] == 4
    data = asset(service, document, scribble["image"])
    marks = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert marks is not None
    height, width = HEIGHT // 2, WIDTH
    assert marks[height, int(0.4 * width)].tolist() == [255, 255, 255, 255]
    assert marks[height, int(0.85 * width)].tolist() == [0, 0, 0, 255]
    assert marks[2, 2, 3] == 0, "what is not marked is transparent"


def test_layers_are_shown_hidden_and_rendered(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction")
    document = stored(service, project)
    document["shots"][0]["layers"].append({"id": "l2", "method": "multistyle", "blend": "multiply"})
    answer = HTTP.put(f"{service}/v1/projects/{project}", json=document, headers={"If-Match": '"1"'})
    assert answer.status_code == 200, answer.text
    page.reload()
    page.get_by_role("button", name="Settings of the layer Painting in many styles").click()
    page.get_by_label("Opacity of the layer").fill("50")
    page.get_by_role("button", name="Hide the layer Painting in many styles").click()
    saved(page)
    first, second = stored(service, project)["shots"][0]["layers"]
    assert first.get("visible", True)
    assert (second["blend"], second["opacity"], second["visible"]) == ("multiply", 0.5, False)
    page.get_by_role("button", name="Paint the film").click()
    finished(page)


def test_two_tabs_never_overwrite_each_other_silently(
    watched: Watched, browser: Browser, service: str, video: str
) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction")
    other = open_page(browser).page
    other.goto(page.url)
    expect(other.locator(".stage-canvas")).to_be_visible(timeout=SOON_MS)
    name(page, "First")
    saved(page)
    name(other, "Second")
    expect(other.get_by_role("alert").first).to_contain_text("Another tab", timeout=SOON_MS)
    assert stored(service, project)["name"] == "First"
    other.get_by_role("button", name="Keep mine").click()
    saved(other)
    assert stored(service, project)["name"] == "Second"
    name(page, "Third")
    page.get_by_role("button", name="Load the other").click()
    expect(page.get_by_label("Name of the project")).to_have_value("Second", timeout=SOON_MS)
    other.context.close()


def name(page: Page, text: str) -> None:
    page.get_by_label("Name of the project").fill(text)
    page.keyboard.press("Tab")


def test_offline_edits_are_not_lost(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction")
    page.context.set_offline(True)
    name(page, "Offline")
    expect(page.locator(".save-status")).to_contain_text("kept in this browser", timeout=SOON_MS)
    page.context.set_offline(False)
    saved(page)
    assert stored(service, project)["name"] == "Offline"


@pytest.mark.parametrize("address", ["/", "/#/jobs", "/live", "/ops", "studio:analogy", "studio:multistyle"])
def test_no_page_has_an_accessibility_fault(watched: Watched, service: str, video: str, axe: str, address: str) -> None:
    page = watched.page
    if address.startswith("studio:"):
        open_project(page, service, video, address.removeprefix("studio:"))
    else:
        page.goto(service + address)
    page.wait_for_timeout(800)
    assert accessibility_faults(page, axe) == []
