"""Colours and detail in the studio: palette, ink, hue histogram and painted importance, from the page to the film."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Locator, Page, expect

from pipeline.scenes import scene
from pipeline.video.stills import encode_png
from tests.e2e.pages import FRAMES, HEIGHT, WIDTH, Watched, accessibility_faults, until
from tests.e2e.studio import (
    SOON_MS,
    asset,
    draw,
    frames_of,
    layer_of,
    on_stage,
    open_project,
    render,
    rendered_by_command,
    result,
    saved,
    stored,
)
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]

FLAT = {"lines": "off", "paint_memory": 0}


def shares(frame: Any, *colours: str) -> float:
    """Share of the pixels that have one of the colours."""
    given = np.array([list(bytes.fromhex(colour[1:])) for colour in colours], np.uint8)
    return float((frame[..., None, :] == given).all(axis=-1).any(axis=-1).mean())


def open_group(page: Page, title: str) -> None:
    page.locator(".all-settings summary", has_text=title).click()


def press_until(page: Page, button: str, reached: Callable[[], bool]) -> None:
    while not reached():
        page.get_by_role("button", name=button).click()


def test_the_film_has_the_colours_of_a_palette_that_is_edited_by_swatches(
    watched: Watched, service: str, video: str, tmp_path: Path, axe: str
) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction", params=FLAT)

    def palette() -> list[str]:
        saved(page)
        found: list[str] = layer_of(stored(service, project))["params"].get("palette", [])
        return found

    open_group(page, "Colour")
    add = page.get_by_role("button", name="Add a colour")
    add.click()
    page.get_by_label("Palette: colour 1", exact=True).fill("#206030")
    add.click()
    page.get_by_label("Palette: colour 2", exact=True).fill("#f0c060")
    assert palette() == ["#206030", "#f0c060"]
    page.get_by_role("button", name="Remove colour 1").click()
    assert palette() == ["#f0c060"]
    press_until(page, "Undo", lambda: palette() == [])  # quick changes of settings are undone together
    press_until(page, "Redo", lambda: palette() == ["#f0c060"])
    add.click()
    page.get_by_label("Palette: colour 2", exact=True).fill("#206030")
    assert accessibility_faults(page, axe) == []
    chosen = palette()
    film = result(service, render(page))
    assert film == rendered_by_command(service, project, tmp_path)
    frames = frames_of(film)
    assert min(shares(frame, *chosen) for frame in frames) > 0.8
    assert min(shares(frame, colour) for frame in frames for colour in chosen) > 0.02, "the disc is not the field"


def test_a_palette_is_taken_from_a_picture_and_the_ink_has_its_colour(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page, picture = watched.page, tmp_path / "two.png"
    half = np.full((40, 60, 3), (30, 20, 200), np.uint8)  # BGR
    half[:, 30:] = (180, 220, 250)
    cv2.imwrite(str(picture), half)
    project = open_project(page, service, video, "abstraction", params={"line_threshold": 0})
    open_group(page, "Colour")
    page.locator(".all-settings").get_by_label("From a picture").set_input_files(picture)
    expect(page.locator(".colour-list li")).to_have_count(2)
    open_group(page, "Lines")
    page.get_by_label("Line colour", exact=True).fill("#1040f0")
    saved(page)
    params = layer_of(stored(service, project))["params"]
    assert params == {"line_threshold": 0, "palette": ["#c8141e", "#fadcb4"], "line_colour": "#1040f0"}
    frames = frames_of(result(service, render(page)))
    blue = [frame[..., 2].astype(int) > frame[..., 0] for frame in frames]
    assert min(found.mean() for found in blue) > 0.005, "the lines are blue"


def test_a_hue_histogram_is_drawn_over_the_hues_of_the_shot_and_the_film_follows(
    watched: Watched, service: str, video: str, tmp_path: Path, axe: str
) -> None:
    page = watched.page
    params = {**FLAT, "hue_neighbourhood": 180, "keep_brightness": 1}
    project = open_project(page, service, video, "abstraction", params=params)

    def scheme() -> dict[str, Any]:
        saved(page)
        found: dict[str, Any] = layer_of(stored(service, project)).get("histogram") or {}
        return found

    page.locator("summary", has_text="Colour scheme").click()
    histogram = page.get_by_role("slider", name="Hues of the painting")
    from_video = page.get_by_role("button", name="From the video")
    expect(from_video).to_be_enabled()
    from_video.click()
    own = scheme()
    assert {index for index, weight in enumerate(own["hue"]) if weight > 0.05} == {4, 10}, "orange on green"
    drag(page, histogram, (18.5, 0.99), (18.5, 1))
    drag(page, histogram, (0.5, 0.02), (15.5, -0.1))
    hue = scheme()["hue"]
    assert hue[18] > 0.95 and max(hue[:16]) < 0.03
    press_until(page, "Undo", lambda: scheme() == own)
    press_until(page, "Redo", lambda: scheme().get("hue") == hue)
    histogram.focus()
    for _ in range(4):
        page.keyboard.press("ArrowRight")
    expect(histogram).to_have_attribute("aria-valuetext", "Hue 190°, weight 0")
    page.keyboard.press("ArrowUp")
    assert scheme()["hue"][19] == 0.05
    page.locator(".scheme-editor").get_by_label("Saturation", exact=True).last.fill("0.8")
    assert scheme()["saturation_mean"] == 0.8
    assert accessibility_faults(page, axe) == []
    film = result(service, render(page))
    assert film == rendered_by_command(service, project, tmp_path)
    red, green, blue = np.median([frame[4:20, 60:].reshape(-1, 3).mean(axis=0) for frame in frames_of(film)], axis=0)
    assert red < min(green, blue) - 40 and abs(green - blue) < 25, "the green field is cyan"


def drag(page: Page, histogram: Locator, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Draw from one bin and weight to another."""
    box = histogram.bounding_box()
    assert box is not None
    (left, top), (right, bottom) = (
        (box["x"] + x / 36 * box["width"], box["y"] + (1 - weight) * box["height"]) for x, weight in (start, end)
    )
    page.mouse.move(left, top)
    page.mouse.down()
    page.mouse.move(right, bottom, steps=8)
    page.mouse.up()


def textured(service: str) -> str:
    """Id of a video with many small things: 6 frames as a zip."""
    made, packed = scene("harbour", (WIDTH, HEIGHT), frames=6), io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for number in range(6):
            archive.writestr(f"{number:04d}.png", encode_png(made.image(number)))
    answer = HTTP.post(f"{service}/v1/assets", files={"file": ("harbour.zip", packed.getvalue())})
    return str(answer.json()["id"])


def brightness(page: Page) -> NDArray[np.float32]:
    """Gray values of the stage at the size of the picture."""
    canvas = page.locator(".stage-canvas")
    box, (left, top), (right, bottom) = canvas.bounding_box(), on_stage(page, 0, 0), on_stage(page, 1, 1)
    assert box is not None
    picture = cv2.imdecode(np.frombuffer(canvas.screenshot(), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    rows, columns = (
        slice(*(round(at - box[edge]) for at in ends)) for edge, ends in (("y", (top, bottom)), ("x", (left, right)))
    )
    return np.asarray(cv2.resize(picture[rows, columns], (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), np.float32)


def test_detail_is_painted_on_the_stage_and_the_film_follows(
    watched: Watched, service: str, tmp_path: Path, axe: str
) -> None:
    page, params = watched.page, {"face_importance": 0}
    video = textured(service)
    open_project(page, service, video, "abstraction", frame=2, params=params)
    plain = frames_of(result(service, render(page)))
    project = open_project(page, service, video, "abstraction", frame=2, params=params)
    page.get_by_role("button", name="Mark the unimportant").click()
    page.get_by_label("Brush size").fill("60")
    draw(page, (0.1, 0.5), (0.9, 0.5))
    saved(page)
    document = stored(service, project)
    (mask,) = layer_of(document)["importance"]
    image = cv2.imdecode(np.frombuffer(asset(service, document, mask["image"]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None and mask["frame"] == 2
    assert image[32, 48].tolist() == [0, 0, 0, 255] and image[0, 0, 3] == 0, "black, and transparent elsewhere"
    page.get_by_role("button", name="Undo").click()
    saved(page)
    assert not layer_of(stored(service, project)).get("importance")
    page.get_by_role("button", name="Redo").click()
    expect(page.get_by_role("button", name="Remove the marks of this frame")).to_be_visible()
    page.get_by_role("button", name="Move the view").click()
    page.get_by_role("button", name="Original").click()
    page.keyboard.press("End")
    moved = page.get_by_role("group", name="Detail of the next frames").get_by_role(
        "button", name="Frame 6", exact=True
    )
    expect(moved).to_be_visible(timeout=SOON_MS)
    canvas = page.locator(".stage-canvas")
    until(page, lambda: (canvas.get_attribute("data-frame"), canvas.get_attribute("data-exact")) == ("5", "true"))
    page.get_by_label("Show the marks where they move").uncheck()
    page.wait_for_timeout(500)  # until the stage is drawn without them
    bare = brightness(page)
    page.get_by_label("Show the marks where they move").check()
    until(page, lambda: brightness(page)[30:34, 20:76].mean() < 0.75 * bare[30:34, 20:76].mean())
    assert abs(brightness(page)[:2, :4] - bare[:2, :4]).mean() < 8, "where nothing is marked, nothing is dimmed"
    assert accessibility_faults(page, axe) == []
    film = result(service, render(page))
    assert film == rendered_by_command(service, project, tmp_path)
    changed = [bool((frame != before).any()) for frame, before in zip(frames_of(film), plain, strict=True)]
    assert changed == [False] * 2 + [True] * 4, "from the frame of the marks on"


def test_an_object_is_marked_by_a_click_and_by_a_box(watched: Watched, service: str, video: str, axe: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction")

    def marked() -> Any:
        """Opacity of the marks of frame 4."""
        saved(page)
        document = stored(service, project)
        (mask,) = layer_of(document)["importance"]
        return cv2.imdecode(np.frombuffer(asset(service, document, mask["image"]), np.uint8), cv2.IMREAD_UNCHANGED)

    page.get_by_role("button", name="Mark an object").click()
    assert accessibility_faults(page, axe) == []
    page.emulate_media(color_scheme="light")
    x, y = on_stage(page, 9 / 22, 0.5)
    page.mouse.click(x, y)
    expect(page.get_by_role("button", name="Remove the marks of this frame")).to_be_visible()
    disc = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.circle(disc, (WIDTH * 9 // 22, HEIGHT // 2), HEIGHT * 14 // 64, 1, -1)
    found = marked()[..., 3] > 127
    assert (found & (disc > 0)).sum() / (found | (disc > 0)).sum() > 0.85
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_role("button", name="Remove the marks of this frame")).to_be_hidden()
    page.get_by_role("group", name="The brush marks").get_by_role("button", name="Unimportant").click()
    draw(page, (0.24, 0.22), (0.58, 0.78))
    expect(page.get_by_role("button", name="Remove the marks of this frame")).to_be_visible()
    boxed = marked()
    assert ((boxed[..., 3] > 127) & (disc > 0)).sum() / ((boxed[..., 3] > 127) | (disc > 0)).sum() > 0.85
    assert boxed[HEIGHT // 2, WIDTH * 9 // 22].tolist() == [0, 0, 0, 255]
    x, y = on_stage(page, 9 / 22, 0.5)
    page.keyboard.down("Alt")
    page.mouse.click(x, y)
    page.keyboard.up("Alt")
    until(page, lambda: (marked()[..., 3] > 127).sum() < 0.1 * (boxed[..., 3] > 127).sum())


def test_a_number_gets_keys_over_time_and_the_film_follows(
    watched: Watched, service: str, video: str, tmp_path: Path, axe: str
) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction", params=FLAT)
    row = page.locator(".all-settings .field", has=page.get_by_text("Vividness", exact=True))
    slider = row.get_by_role("slider", name="Vividness", exact=True)

    def keys() -> Any:
        saved(page)
        return layer_of(stored(service, project))["params"].get("vividness")

    def to_frame(key: str, frame: int) -> None:
        page.locator(".stage-canvas").focus()
        page.keyboard.press(key)
        expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", str(frame))

    open_group(page, "Colour")
    to_frame("Home", 0)
    row.get_by_role("button", name="Vividness over time").click()
    assert keys() == [[0, 1]]
    to_frame("End", FRAMES - 1)
    row.get_by_role("spinbutton").fill("0")
    assert keys() == [[0, 1], [FRAMES - 1, 0]]
    to_frame("ArrowLeft", FRAMES - 2)
    expect(slider).to_have_attribute("aria-valuetext", f"{1 / (FRAMES - 1):.4g} ratio")
    row.get_by_role("button", name="Add a key at this frame").click()
    assert keys()[1] == [FRAMES - 2, pytest.approx(1 / (FRAMES - 1))], "a new key has the value of its time"
    row.get_by_role("button", name="Remove the key at this frame").click()
    row.get_by_role("slider", name="Vividness at frame 1", exact=True).press("ArrowUp")
    changed = keys()
    assert changed == [[0, 1.05], [FRAMES - 1, 0]]
    expect(row.get_by_role("img", name=f"0 at frame {FRAMES}")).to_be_visible()
    press_until(page, "Undo", lambda: keys() is None)
    press_until(page, "Redo", lambda: keys() == changed)
    assert accessibility_faults(page, axe) == []
    film = result(service, render(page))
    assert film == rendered_by_command(service, project, tmp_path)
    chroma = [float(np.ptp(frame.astype(int), axis=-1).mean()) for frame in frames_of(film)]
    assert chroma == sorted(chroma, reverse=True) and chroma[0] > 30 and chroma[-1] < 0.3 * chroma[0]
    watched.check()
