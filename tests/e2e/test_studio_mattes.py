"""Clicks on the stage make a layer's matte through the shot, and a key's mask; the film has what the stage shows."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from tests.e2e.pages import FRAMES, HEIGHT, WIDTH, Watched, accessibility_faults, make_three_things, until
from tests.e2e.studio import (
    FILM_MS,
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
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]
Gray = NDArray[np.uint8]


def disc_at(frame: int) -> Gray:
    """Pixels of the clip's disc."""
    disc = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.circle(disc, (WIDTH * (5 + frame) // (FRAMES + 10), HEIGHT // 2), HEIGHT * 14 // 64, 1, -1)
    return disc


def overlap(matte: Gray, wanted: NDArray[Any]) -> float:
    found = matte > 127
    return float((found & (wanted > 0)).sum() / max((found | (wanted > 0)).sum(), 1))


def unzipped(content: bytes) -> list[NDArray[np.uint8]]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        files = [np.frombuffer(archive.read(name), np.uint8) for name in sorted(archive.namelist())]
    return [np.asarray(cv2.imdecode(file, cv2.IMREAD_UNCHANGED), np.uint8) for file in files]


def start_marking(page: Page) -> None:
    page.get_by_role("button", name="Settings of the layer").first.click()
    page.get_by_role("button", name="Mark the matte on the stage").click()
    expect(page.get_by_role("button", name="Mark the layer's matte")).to_have_attribute("aria-pressed", "true")


def open_three_things(page: Page, service: str, folder: Path) -> str:
    """Open a project with a clip of a disc, a bar and a field at rest; the project's id."""
    clip = make_three_things(folder / "three.mp4")
    things = str(HTTP.post(f"{service}/v1/assets", files={"file": ("three.mp4", clip.read_bytes())}).json()["id"])
    return open_project(page, service, things, "abstraction", frame=2)


def click(page: Page, x: float, y: float) -> None:
    page.mouse.click(*on_stage(page, x, y))


def matte_of(page: Page, service: str, project: str, before: str = "") -> tuple[str, list[Gray]]:
    """The id of the layer's matte once it is another one than `before`, and its frames."""

    def present() -> str:
        document = stored(service, project)
        return str(document["assets"].get(layer_of(document).get("matte", ""), {}).get("id", ""))

    until(page, lambda: present() not in ("", before))
    saved(page)
    return present(), unzipped(HTTP.get(f"{service}/v1/assets/{present()}/content").content)


def film_alone(page: Page, service: str, project: str) -> list[NDArray[np.uint8]]:
    """The film of the layer alone, with its opacity: frames in the order of blue, green, red, opacity."""
    wishes = {"output": {"format": "png", "layer": "l1"}}
    job = HTTP.post(f"{service}/v1/projects/{project}/jobs", json=wishes).json()["items"][0]["job"]["id"]
    until(page, lambda: HTTP.get(f"{service}/v1/jobs/{job}").json()["state"] == "succeeded", FILM_MS / 1000)
    return unzipped(HTTP.get(f"{service}/v1/jobs/{job}/result").content)


def shown(page: Page, *points: tuple[float, float]) -> list[int]:
    """Brightness of the stage at points of the picture, once the shown frame is drawn."""
    box = page.locator(".stage-canvas").bounding_box()
    assert box is not None
    picture = cv2.imdecode(np.frombuffer(page.locator(".stage-canvas").screenshot(), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    at = [on_stage(page, *point) for point in points]
    return [int(picture[round(y - box["y"]), round(x - box["x"])]) for x, y in at]


def test_a_clicked_object_is_the_matte_of_its_layer_through_the_shot(
    watched: Watched, service: str, video: str, axe: str
) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction", params={"lines": "off"})
    page.get_by_role("button", name="Original").click()
    start_marking(page)
    inside, outside = (9 / 22, 0.5), (0.9, 0.15)
    before = shown(page, inside, outside)
    click(page, *inside)
    _, mattes = matte_of(page, service, project)
    assert len(mattes) == FRAMES and all(matte.shape == (HEIGHT, WIDTH) for matte in mattes)
    assert min(overlap(matte, disc_at(frame)) for frame, matte in enumerate(mattes)) > 0.8
    until(page, lambda: shown(page, outside)[0] < 0.7 * before[1])
    assert shown(page, inside)[0] == pytest.approx(before[0], abs=4), "the veil is on what the layer does not cover"
    page.keyboard.press("End")
    until(page, lambda: shown(page, (16 / 22, 0.5))[0] > 1.4 * shown(page, inside)[0])
    assert accessibility_faults(page, axe) == []
    film = film_alone(page, service, project)
    assert all(np.array_equal(frame[..., 3], matte) for frame, matte in zip(film, mattes, strict=True))
    page.get_by_role("button", name="Undo").click()
    saved(page)
    assert "matte" not in layer_of(stored(service, project))


def test_more_clicks_add_to_a_matte_and_take_away_from_their_frame_on(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_three_things(page, service, tmp_path)
    disc, bar = np.zeros((2, HEIGHT, WIDTH), np.uint8)
    cv2.circle(disc, (WIDTH // 4, HEIGHT // 2), 16, 1, -1)
    cv2.rectangle(bar, (WIDTH * 5 // 8, 8), (WIDTH * 7 // 8, HEIGHT - 9), 1, -1)
    start_marking(page)
    page.keyboard.press("Home")
    click(page, 0.25, 0.5)
    first, mattes = matte_of(page, service, project)
    assert min(overlap(matte, disc) for matte in mattes) > 0.85
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    draw(page, (0.58, 0.05), (0.92, 0.95))
    second, mattes = matte_of(page, service, project, first)
    assert [overlap(matte, disc | bar) > 0.85 for matte in mattes] == [False] * 2 + [True] * 4
    page.keyboard.press("End")
    page.keyboard.down("Alt")
    click(page, 0.25, 0.5)
    page.keyboard.up("Alt")
    _, mattes = matte_of(page, service, project, second)
    assert [overlap(matte, disc | bar) > 0.85 for matte in mattes] == [False] * 2 + [True] * 3 + [False]
    assert overlap(mattes[5], bar) > 0.85


def test_brush_and_eraser_correct_a_matte_and_each_stroke_is_one_step(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_three_things(page, service, tmp_path)
    page.get_by_role("button", name="Original").click()
    start_marking(page)
    page.keyboard.press("Home")
    page.keyboard.press("Shift+Y")
    expect(page.get_by_role("button", name="Erase the matte")).to_have_attribute("aria-pressed", "true")
    click(page, 0.25, 0.5)
    expect(page.get_by_text("There is no matte to take away from")).to_be_visible()
    page.keyboard.press("u")
    click(page, 0.25, 0.5)
    first, clicked = matte_of(page, service, project)
    page.keyboard.press("ArrowRight")
    page.keyboard.press("y")
    expect(page.get_by_role("slider", name="Brush size")).to_be_visible()
    page.get_by_role("slider", name="Brush size").fill("10")
    draw(page, (0.45, 0.2), (0.45, 0.8))
    second, painted = matte_of(page, service, project, first)
    column, middle = round(0.45 * WIDTH), slice(HEIGHT * 2 // 5, HEIGHT * 3 // 5)
    assert [int(matte[middle, column].min()) > 200 for matte in painted] == [False] + [True] * 5
    assert painted[1][HEIGHT // 2, column + 9] < 50, "what the brush covers, and no more"
    assert np.array_equal(painted[0], clicked[0])
    until(page, lambda: shown(page, (0.45, 0.5))[0] > 1.2 * shown(page, (0.55, 0.5))[0])
    page.keyboard.down("Alt")
    draw(page, (0.2, 0.4), (0.3, 0.6))
    page.keyboard.up("Alt")
    third, erased = matte_of(page, service, project, second)
    assert erased[1][HEIGHT // 2, WIDTH // 4] < 50 and erased[1][HEIGHT // 2, column] > 200
    assert erased[0][HEIGHT // 2, WIDTH // 4] > 200
    page.keyboard.press("Control+z")
    until(page, lambda: matte_of(page, service, project, third)[0] == second)
    page.keyboard.press("Control+z")
    until(page, lambda: matte_of(page, service, project, second)[0] == first)


def test_a_matte_of_a_trimmed_shot_is_followed_again_when_the_shot_grows(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    layer = {"id": "l1", "method": "abstraction"}
    shot = {"id": "s1", "video": "clip", "range": [3, 8], "layers": [layer]}
    document = {"schema": 2, "name": "Disc", "assets": {"clip": {"id": video}}, "shots": [shot]}
    project = str(HTTP.post(f"{service}/v1/projects", json={"name": "Disc", "document": document}).json()["id"])
    page.goto(f"{service}/#/projects/{project}")
    until(page, lambda: page.locator(".stage-canvas").get_attribute("data-frame") == "4")
    start_marking(page)
    click(page, 9 / 22, 0.5)
    first, mattes = matte_of(page, service, project)
    assert [overlap(matte, disc_at(frame)) > 0.8 for frame, matte in enumerate(mattes)] == [
        3 <= frame < 8 for frame in range(FRAMES)
    ]
    expect(page.get_by_role("button", name="Follow it through the shot")).to_be_hidden()
    page.keyboard.press("t")
    page.get_by_role("button", name="Whole clip").click()
    page.get_by_role("button", name="Follow it through the shot").click()
    _, mattes = matte_of(page, service, project, first)
    assert min(overlap(matte, disc_at(frame)) for frame, matte in enumerate(mattes)) > 0.8


def test_a_click_makes_the_mask_of_a_painted_key(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={"levels": 1})
    start_painting(page)
    draw(page, (0.1, 0.1), (0.9, 0.9))

    def mask() -> Gray:
        saved(page)
        document = stored(service, project)
        return decoded(asset(service, document, layer_of(document)["keys"][0]["mask"]))[..., 0]

    expect(page.get_by_role("button", name="Mask of the key")).to_be_visible(timeout=SOON_MS)
    page.get_by_role("button", name="Mask of the key").click()
    page.get_by_role("button", name="Mark an object").click()
    click(page, 9 / 22, 0.5)
    until(page, lambda: "mask" in layer_of(stored(service, project)).get("keys", [{}])[0] and mask().mean() < 200)
    assert overlap(mask(), disc_at(4)) > 0.85, "the first click replaces the full mask"
    page.keyboard.down("Alt")
    draw(page, (0.2, 0.1), (9 / 22, 0.9))
    page.keyboard.up("Alt")
    until(page, lambda: mask()[HEIGHT // 2, WIDTH * 9 // 22 - 8] == 0)
    assert mask()[HEIGHT // 2, WIDTH * 9 // 22 + 8] == 255, "a box with Alt takes away what is in it"
