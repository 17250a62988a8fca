"""Figure 5 of the multistyle paper, from an empty page to the finished film: one object in fine strokes, the rest in
rings that turn, keys at two frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.e2e.pages import FRAMES, HEIGHT, SLOW_MS, WIDTH, Watched, until
from tests.e2e.studio import (
    SOON_MS,
    choose_style,
    decoded,
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
from tests.service.records import records
from tests.waiting import HTTP

DISC = (5 + 4) / (FRAMES + 10)
"""Horizontal centre of the disc in frame 4, in widths of the picture."""
LAST = FRAMES - 1
CENTRE, REACH = (0.7, 0.5), 0.3
"""Centre of the rings as fractions of the picture, and their reach in heights of the picture."""

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]


def test_one_object_in_fine_strokes_and_the_rest_in_rings_that_turn(
    watched: Watched, service: str, clip: Path, tmp_path: Path
) -> None:
    page = watched.page
    page.goto(service)
    page.set_input_files(".drop-large input[type=file]", clip)
    expect(page.locator(".stage.painted")).to_be_visible(timeout=SLOW_MS)
    page.locator("input[type=radio][value=multistyle]").check(force=True)
    page.get_by_role("button", name="Draw on it").click()
    canvas = page.locator(".stage-canvas")
    until(page, lambda: canvas.get_attribute("data-frame") == "4")
    project = page.url.rpartition("/")[2]

    page.get_by_role("button", name="Pick regions").click()
    expect(page.get_by_text("Pick one of the 2 objects")).to_be_visible(timeout=SOON_MS)
    page.mouse.click(*on_stage(page, DISC, 0.5))
    expect(page.get_by_role("heading", name="Style of region")).to_be_visible()
    choose_style(page, "Impressionism")
    page.get_by_label("Stroke width", exact=True).fill("4")
    page.get_by_label("Change to the next key").select_option("smooth")
    page.get_by_role("button", name="Everything else").click()
    choose_style(page, "Van Gogh")
    page.get_by_role("group", name="Pattern").get_by_role("button", name="Circles").click()
    right = (CENTRE[0] + REACH * HEIGHT / WIDTH, CENTRE[1])
    draw(page, CENTRE, right)

    page.keyboard.press("End")
    until(page, lambda: canvas.get_attribute("data-frame") == str(LAST))
    draw(page, right, (CENTRE[0], CENTRE[1] + REACH))
    page.get_by_role("button", name="region", exact=True).click()
    page.get_by_label("Stroke width", exact=True).fill("8")
    expect(page.get_by_role("img", name="Stroke width of region: 4 at frame 5, 8 at frame 12")).to_be_visible()
    saved(page)

    document = stored(service, project)
    layer = layer_of(document)
    (picked,) = layer["design"]["regions"]["region"]["objects"]
    assert layer["design"]["regions"] == {"region": layer["design"]["regions"]["region"]} and picked >= 0
    keys = {(key["region"], key["frame"]): key for key in layer["design"]["keys"]}
    assert set(keys) == {("region", 4), ("region", LAST), ("rest", 4)}
    first, last = keys["region", 4], keys["region", LAST]
    assert (first["style"], first["set"], first["ease"]) == ("impressionism", {"size": 4}, "smooth")
    assert (last["style"], last["set"]) == ("impressionism", {"size": 8})
    assert keys["rest", 4]["style"] == "van-gogh"
    rings = [(key["region"], key["frame"], *key["elements"]) for key in layer["design"]["directions"]]
    assert [(region, frame) for region, frame, _ in rings] == [("rest", 4), ("rest", LAST)]
    for (_, _, ring), angle in zip(rings, (0, 90), strict=True):
        assert ring["pattern"] == "center"
        assert ring["at"] == pytest.approx(CENTRE, abs=0.01) and ring["reach"] == pytest.approx(REACH, abs=0.02)
        assert abs((ring["angle"] - angle + 180) % 360 - 180) <= 2

    job = render(page)
    film = result(service, job)
    assert film == rendered_by_command(service, project, tmp_path)
    frames = frames_of(film)
    assert len(frames) == FRAMES
    assert all(np.ptp(frame) > 50 for frame in frames)
    request = HTTP.get(f"{service}/v1/jobs/{job}").json()["request"]
    assert (request["method"], request["labels"]["project"]) == ("multistyle", project)


def test_a_drawn_region_and_a_found_one_are_merged(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "multistyle")
    page.get_by_role("button", name="Pick regions").click()
    expect(page.get_by_text("Pick one of the 2 objects")).to_be_visible(timeout=SOON_MS)
    page.mouse.click(*on_stage(page, DISC, 0.5))
    expect(page.get_by_role("heading", name="Style of region")).to_be_visible()
    page.get_by_role("button", name="Everything else").click()
    page.get_by_role("button", name="Draw a region").click()
    draw(page, (0.75, 0.1), (0.95, 0.1), (0.95, 0.4), (0.75, 0.4))
    page.get_by_label("Merge with").select_option("region")
    saved(page)
    ((name, region),) = layer_of(stored(service, project))["design"]["regions"].items()
    assert name == "region-2" and len(region["objects"]) == len(region["polygons"]) == 1
    options = {"shot": "s1", "layer": "l1", "frame": 4, "film": True, "max_side_px": WIDTH}
    answer = HTTP.post(f"{service}/v1/projects/{project}/previews/regions", json=options)
    found = next(body for header, body in records(answer.content) if header["type"] == "map")
    plane = decoded(found)[..., 0]
    assert plane[HEIGHT // 2, round(DISC * WIDTH)] == plane[HEIGHT // 4, round(0.85 * WIDTH)] == 1
    assert plane[HEIGHT * 3 // 4, round(0.85 * WIDTH)] == 0
    page.get_by_role("button", name="Draw a region").click()
    page.keyboard.down("Shift")
    draw(page, (0.05, 0.1), (0.15, 0.1), (0.15, 0.3), (0.05, 0.3))
    page.keyboard.up("Shift")
    saved(page)
    assert len(layer_of(stored(service, project))["design"]["regions"]["region-2"]["polygons"]) == 2


def test_an_effect_is_edited_like_a_design_of_ones_own(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "multistyle", params={"effect": "emphasis"})
    before = stored(service, project)
    page.get_by_label("Begin with an effect").select_option("rack-focus")
    saved(page)
    layer = layer_of(stored(service, project))
    design = HTTP.get(f"{service}/v1/methods/multistyle/inputs/design/examples?frames={FRAMES}").json()["rack-focus"]
    assert (layer["design"]["regions"], layer["design"]["keys"]) == (design["regions"], design["keys"])
    assert layer["params"] == {}
    page.get_by_role("button", name="background", exact=True).click()
    page.keyboard.press("End")
    page.get_by_label("Stroke width", exact=True).fill("30")
    saved(page)
    keys = layer_of(stored(service, project))["design"]["keys"]
    (changed,) = [key for key in keys if (key["region"], key["frame"]) == ("background", LAST)]
    assert changed["set"]["size"] == 30
    assert HTTP.get(f"{service}/v1/projects/{project}/check").json()["errors"] == []
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    until(page, lambda: stored(service, project) == before)
    watched.check()
