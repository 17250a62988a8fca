"""Layers and the style library of the studio, from the page to the film."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
from playwright.sync_api import Route, expect

from tests.e2e.pages import Watched, accessibility_faults, until
from tests.e2e.studio import (
    FILM_MS,
    SOON_MS,
    frames_of,
    layer_of,
    open_project,
    render,
    rendered_by_command,
    result,
    saved,
    stored,
)
from tests.waiting import HTTP

SIZE = (96, 64)
FRAMES = 5

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]


def passes(folder: Path) -> tuple[Path, Path, Path]:
    """A rendered shot as a compositor receives it: EXR frames of the beauty and shadow passes, and a matte."""
    made = []
    for name in ("beauty", "shadow"):
        path = folder / f"{name}.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for frame in range(FRAMES):
                archive.writestr(f"{name}/{frame:04d}.exr", exr(folder / "one.exr", name, frame))
        made.append(path)
    matte = folder / "matte.png"
    white = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    white[:, : SIZE[0] // 2] = 255
    cv2.imwrite(str(matte), white)
    return made[0], made[1], matte


def exr(path: Path, name: str, frame: int) -> bytes:
    """A light field with a disc that moves, or a dark band on white; linear light, half floats."""
    picture = np.full((SIZE[1], SIZE[0], 3), (0.3, 0.5, 0.2) if name == "beauty" else 1.0, np.float32)
    if name == "beauty":
        cv2.circle(picture, (20 + 8 * frame, 32), 14, (0.9, 0.6, 0.1), -1)
    else:
        picture[40:] = 0.1
    planes = dict(zip("RGB", np.moveaxis(picture.astype(np.float16), -1, 0).copy(), strict=True))
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(path))
    return path.read_bytes()


def test_a_shot_of_exr_passes_is_two_layers_with_multiply_and_a_matte(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    beauty, shadow, matte = passes(tmp_path)
    shot = HTTP.post(f"{service}/v1/assets", files={"file": (beauty.name, beauty.read_bytes())}).json()["id"]
    project = open_project(page, service, shot, "abstraction", frame=1, params={"lines": "off"})
    page.get_by_role("button", name="Add a layer").click()
    page.locator(".method-choice summary").click()
    page.get_by_role("radio", name="Cartoon").check(force=True)
    page.get_by_role("button", name="Settings of the layer").first.click()
    page.get_by_label("Blend").select_option("multiply")
    page.get_by_label("Opacity of the layer").fill("80")
    page.get_by_label("Own video: choose a file").set_input_files(shadow)
    expect(page.locator(".layer-settings .slot-name", has_text="shadow.zip")).to_be_visible(timeout=SOON_MS)
    page.get_by_label("Matte: choose a file").set_input_files(matte)
    expect(page.locator(".layer-settings .slot-name", has_text="matte.png")).to_be_visible(timeout=SOON_MS)
    saved(page)
    first, second = stored(service, project)["shots"][0]["layers"]
    assert (second["method"], second["blend"], second["opacity"]) == ("abstraction", "multiply", 0.8)
    assert (second["source"], second["matte"]) == ("layer-source", "layer-matte") and "source" not in first
    film = result(service, render(page))
    assert film == rendered_by_command(service, project, tmp_path)
    frames = frames_of(film)
    assert len(frames) == FRAMES
    inside, outside = (frames[0][50:60, columns].mean() for columns in (slice(5, 40), slice(56, 90)))
    assert inside < 0.75 * outside, "the shadow darkens where the matte is white, and nowhere else"


def test_the_order_of_layers_changes_by_buttons(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction")
    page.get_by_role("button", name="Add a layer").click()
    page.get_by_role("button", name="Settings of the layer").first.click()

    def order() -> list[str]:
        saved(page)
        return [layer["id"] for layer in stored(service, project)["shots"][0]["layers"]]

    assert order() == ["l1", "layer"]
    page.get_by_role("button", name="Move down").click()
    assert order() == ["layer", "l1"]
    expect(page.get_by_role("button", name="Move down")).to_be_disabled()
    page.get_by_role("button", name="Move up").click()
    assert order() == ["l1", "layer"]


def test_a_painting_of_the_library_and_a_saved_look_are_used_in_another_project(
    watched: Watched, service: str, video: str, axe: str
) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy")
    cards = page.get_by_role("group", name="Paintings of the library").get_by_role("button")
    expect(cards.first.locator("img")).to_be_visible(timeout=FILM_MS)
    cards.filter(has_text="Swirling strokes").click()
    expect(page.locator(".slot-name", has_text="harbour-swirls.png")).to_be_visible(timeout=FILM_MS)
    page.locator(".looks summary").click()
    page.get_by_label("Name of the look to save").fill("Swan swirls")
    page.get_by_role("button", name="Save look").click()
    expect(page.get_by_role("list", name="Looks").get_by_role("button", name="Swan swirls", exact=True)).to_be_visible()
    saved(page)
    document = stored(service, project)
    inputs = layer_of(document)["inputs"]
    assert set(inputs) == {"style_output", "style"}, "the exemplar's source is its guide"
    painting = document["assets"][inputs["style_output"]]["id"]

    other = open_project(page, service, video, "multistyle")
    page.reload()
    expect(page.locator(".stage-canvas")).to_be_visible(timeout=SOON_MS)
    page.locator(".looks summary").click()
    page.get_by_role("button", name="Swan swirls", exact=True).click()
    saved(page)
    layer = layer_of(stored(service, other))
    assert layer["method"] == "analogy"
    assert stored(service, other)["assets"][layer["inputs"]["style_output"]]["id"] == painting
    open_project(page, service, video, "abstraction")
    expect(page.get_by_role("group", name="Your paintings")).to_be_visible()
    assert accessibility_faults(page, axe) == []


def test_what_ends_late_is_in_the_layer_in_which_it_began(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page, picture = watched.page, tmp_path / "painted.png"
    cv2.imwrite(str(picture), np.full((SIZE[1], SIZE[0], 3), 90, np.uint8))
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    held: list[Route] = []

    def hold(route: Route) -> None:
        if len(held) < 2:
            held.append(route)
        else:
            route.continue_()

    page.route("**/v1/styles/*/assets", hold)
    page.route("**/v1/assets", hold)
    cards = page.get_by_role("group", name="Paintings of the library").get_by_role("button")
    expect(cards.first.locator("img")).to_be_visible(timeout=FILM_MS)
    cards.filter(has_text="Swirling strokes").click()
    page.get_by_label("Import a painted frame").set_input_files(picture)
    until(page, lambda: len(held) == 2)
    page.get_by_role("button", name="Add a layer").click()
    expect(page.locator(".layer-row")).to_have_count(2)
    for route in held:
        route.continue_()

    def layers() -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = stored(service, project)["shots"][0]["layers"]
        return found

    until(page, lambda: "style_output" in layers()[0].get("inputs", {}) and layers()[0].get("parts"))
    saved(page)
    page.unroute_all()
    first, second = layers()
    assert [key["frame"] for key in first["parts"]["keys"]] == [4]
    assert not second.get("parts") and not second.get("inputs")


def test_the_list_of_methods_closes_after_a_choice_but_not_while_arrow_keys_go_through_it(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    open_project(page, service, video, "abstraction")
    methods, listed = page.locator(".method-choice"), page.get_by_role("radiogroup", name="Method")
    methods.locator("summary").click()
    listed.get_by_role("radio", name="Style by example").check(force=True)
    expect(listed).to_be_hidden()
    expect(methods.locator("summary")).to_have_text("Style by example")
    methods.locator("summary").click()
    listed.get_by_role("radio", name="Style by example").press("ArrowUp")
    expect(listed).to_be_visible()
    expect(methods.locator("summary")).not_to_have_text("Style by example")
    page.keyboard.press("Enter")
    expect(listed).to_be_hidden()
    expect(methods.locator("summary")).to_be_focused()
