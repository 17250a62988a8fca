"""The studio says what it shows: playback, the base of a new key, a style of one region, the pictures of a method."""

from __future__ import annotations

import re

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.pages import Watched, make_clip, until
from tests.e2e.studio import (
    FILM_MS,
    SOON_MS,
    asset,
    choose_style,
    decoded,
    draw,
    layer_of,
    open_project,
    saved,
    stored,
)
from tests.service.records import picture, records
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]


def painted(page: Page) -> None:
    """Wait until the stage shows the film's picture."""
    expect(page.locator(".stage-canvas")).to_have_attribute("data-result", "final", timeout=FILM_MS)


@pytest.fixture(scope="module")
def long(service: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = make_clip(tmp_path_factory.mktemp("truth") / "long.mp4", frames=36)
    return str(HTTP.post(f"{service}/v1/assets", files={"file": (path.name, path.read_bytes())}).json()["id"])


def test_playing_says_what_is_played(watched: Watched, service: str, long: str) -> None:
    page = watched.page
    open_project(page, service, long, "abstraction", frame=12)
    painted(page)
    hint = page.locator(".stage-hint")
    page.get_by_role("button", name="Painted", exact=True).click()
    page.get_by_role("button", name="Play", exact=True).click()
    expect(hint).to_have_text("Playing the video: these frames are not painted", timeout=SOON_MS)
    page.get_by_role("button", name="Pause", exact=True).or_(
        page.get_by_role("button", name="Play", exact=True)
    ).click()
    page.get_by_role("button", name="Paint the film").click()
    expect(page.locator(".film-progress")).to_have_attribute("data-state", "succeeded", timeout=FILM_MS)
    page.get_by_role("slider", name="Frame", exact=True).press("Home")
    page.locator(".stage-canvas").press("Home")
    page.get_by_role("button", name="Play", exact=True).click()
    expect(hint).to_have_text(re.compile("Playing the (newest )?film"), timeout=SOON_MS)
    expect(page.locator(".stage-canvas")).to_have_attribute("data-painting", "film")


def test_the_first_stroke_on_a_frame_keeps_its_painting(watched: Watched, service: str, long: str) -> None:
    page = watched.page
    keys = {"params": {"levels": 2, "iterations": 2}, "inputs": {}}
    project = open_project(page, service, long, "analogy", frame=12, **keys)
    painted(page)
    at = f"{service}/v1/projects/{project}/previews/paint"
    found = records(HTTP.post(at, json={"shot": "s1", "frame": 12}).content)
    film = picture([data for header, data in found if header["type"] == "frame"][-1])[..., ::-1].astype(int)
    page.get_by_role("button", name="Brush", exact=True).click()
    page.get_by_label("Brush size").fill("6")
    draw(page, (0.1, 0.1), (0.3, 0.1))
    saved(page)
    until(page, lambda: bool(layer_of(stored(service, project)).get("keys")))
    document = stored(service, project)
    (key,) = layer_of(document)["keys"]
    image = decoded(asset(service, document, key["image"])).astype(int)
    assert [layer["name"] for layer in key["paint"]["layers"]] == ["Painted frame", "Paint"]
    assert np.array_equal(image[16:], film[16:]), "the painting, below the stroke"
    assert not np.array_equal(image[:16], film[:16])


def test_a_style_for_a_region_leaves_the_rest_as_it_is(watched: Watched, service: str, long: str) -> None:
    page = watched.page
    box = {"box": {"polygons": [{"frame": 12, "points": [[0.6, 0.1], [0.95, 0.1], [0.95, 0.9], [0.6, 0.9]]}]}}
    project = open_project(page, service, long, "multistyle", frame=12, parts={"design": {"regions": box}})
    page.get_by_role("button", name="box", exact=True).click()
    choose_style(page, "Pointillism")
    saved(page)
    until(page, lambda: bool(layer_of(stored(service, project))["design"].get("keys")))
    design = layer_of(stored(service, project))["design"]
    assert [(key["region"], key["frame"], key["style"]) for key in design["keys"]] == [("box", 12, "pointillism")]
    assert design["regions"]["box"]["border"] == "sharp", "the style does not spread to regions without a style"


def test_a_method_that_cannot_paint_yet_does_not_show_the_pictures_of_another(
    watched: Watched, service: str, long: str
) -> None:
    page = watched.page
    open_project(page, service, long, "abstraction", frame=12)
    painted(page)
    page.locator(".method-choice summary").click()
    page.get_by_role("radio", name="Steady frames").check(force=True)
    expect(page.locator(".stage-hint")).to_contain_text("styled", timeout=SOON_MS)
    expect(page.locator(".stage-canvas")).to_have_attribute("data-painting", "none")


def test_corrections_can_be_solved_as_soon_as_they_are_made(watched: Watched, service: str, long: str) -> None:
    page = watched.page
    open_project(page, service, long, "patches", frame=12)
    page.get_by_role("button", name="Paint the film").click()
    expect(page.locator(".film-progress")).to_have_attribute("data-state", "succeeded", timeout=FILM_MS)
    page.get_by_label("Show the clusters").check(timeout=SOON_MS)
    chips = page.get_by_role("group", name="Paint with the label")
    chips.get_by_role("button", name="New object").click(timeout=SOON_MS)
    page.get_by_label("Brush size").fill("12")
    draw(page, (0.1, 0.2), (0.3, 0.2))
    expect(page.get_by_role("button", name="Solve 13 frames again")).to_be_visible(timeout=SOON_MS)
