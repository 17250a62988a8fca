"""Figures 4e and 5 of kagaya2011video, made in the page: regions are picked, dimmed and corrected, their strokes
directed, and the film's own directions and regions follow."""

from __future__ import annotations

import json
import struct
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from tests.e2e.pages import FRAMES, HEIGHT, WIDTH, Watched, until
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
    result,
    saved,
    stored,
)
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]

FRAME = 4
DISC = (5 + FRAME) / (FRAMES + 10)
"""Horizontal centre of the disc in the shown frame, in widths of the picture."""
FIELD = (0.75, 0.2)
"""A point of the field behind it."""
Records = list[tuple[dict[str, Any], bytes]]


def ask(service: str, project: str, what: str, **body: Any) -> Records:
    """Records of a preview of the stored document, without the first and the last one."""
    data = HTTP.post(
        f"{service}/v1/projects/{project}/previews/{what}", json={"shot": "s1", "layer": "l1", "frame": FRAME, **body}
    ).content
    found: Records = []
    while data:
        (length,) = struct.unpack_from(">I", data)
        header = json.loads(data[4 : 4 + length])
        end = 4 + length + header["bytes"]
        found.append((header, data[4 + length : end]))
        data = data[end:]
    assert found[-1][0]["type"] == "end", found[-1][0]
    return found[1:-1]


def directions_deg(service: str, project: str) -> NDArray[np.float64]:
    """Angles of the film's strokes at every second pixel."""
    header, payload = ask(service, project, "directions", spacing_px=2)[-1]
    assert header["final"]
    field = np.frombuffer(payload, "<f4").reshape(header["rows"], header["columns"], 2)
    return np.rad2deg(field[..., 0])


def apart_deg(one: NDArray[np.float64], other: NDArray[np.float64] | float) -> NDArray[np.float64]:
    return np.abs((one - other + 90) % 180 - 90)


def from_disc(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Distance of each point of a grid from the disc's centre, radii of the disc."""
    y, x = np.indices(shape, np.float64)
    scale = HEIGHT / shape[0]
    return np.hypot((x + 0.5) * scale - DISC * WIDTH, (y + 0.5) * scale - HEIGHT / 2) / 14


def brightness(page: Page, *points: tuple[float, float]) -> list[int]:
    """Largest channel of the stage at points of the picture."""
    shot = decoded(page.screenshot())
    return [int(shot[round(y), round(x)].max()) for x, y in (on_stage(page, *point) for point in points)]


def pick(page: Page) -> None:
    page.get_by_role("button", name="Pick regions").click()
    expect(page.get_by_text("Pick one of the 2 objects")).to_be_visible(timeout=SOON_MS)
    page.mouse.click(*on_stage(page, DISC, 0.5))
    expect(page.get_by_role("heading", name="Style of region")).to_be_visible()


def test_figure_4e_one_constraint_directs_the_background_and_leaves_the_object_alone(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    project = open_project(page, service, video, "multistyle")
    pick(page)
    page.get_by_role("button", name="Everything else").click()
    saved(page)
    before = directions_deg(service, project)
    page.get_by_role("group", name="Pattern").get_by_role("button", name="Parallel").click()
    draw(page, FIELD, (FIELD[0] + 0.1, FIELD[1]))
    page.get_by_label("Angle", exact=True).fill("60")
    page.get_by_role("checkbox", name="Everywhere in the region alike").check()
    page.locator("summary", has_text="All settings of the directions").click()
    page.get_by_label("Edges of the picture").fill("0")
    expect(page.get_by_text("The stage shows the directions of the film.")).to_be_visible(timeout=SOON_MS)
    saved(page)
    (key,) = layer_of(stored(service, project))["design"]["directions"]
    (element,) = key["elements"]
    assert (key["region"], key["edge_weight"]) == ("rest", 0)
    assert (element["pattern"], element["angle"], element["reach"]) == ("regular", 60, "everywhere")
    found = directions_deg(service, project)
    far = from_disc(found.shape)
    assert apart_deg(found, 60)[far > 1.3].max() < 0.5, "the background has one direction"
    assert apart_deg(before, 60)[far > 1.3].mean() > 20
    assert apart_deg(found, before)[far < 0.7].max() < 0.5, "the object keeps its own"
    drawn = decoded(page.screenshot())
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    expect(page.get_by_text("The stage shows the directions of the film.")).to_be_visible(timeout=SOON_MS)
    assert np.abs(decoded(page.screenshot()).astype(int) - drawn).max() > 100, "the stage draws the field"
    watched.check()


def test_settings_of_directions_reach_the_film(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "multistyle")
    pick(page)
    page.get_by_role("group", name="Pattern").get_by_role("button", name="Three ways").click()
    draw(page, (DISC, 0.5), (DISC + 0.2, 0.5))
    saved(page)
    own = directions_deg(service, project)
    more = page.locator("summary", has_text="All settings of the directions")
    more.click()
    inside = from_disc(own.shape) < 0.8
    for label, expected in (("Edges of the picture", 0.9), ("Move, turn", False), ("Take the directions", True)):
        control = page.get_by_label(label)
        if isinstance(expected, bool):
            control.set_checked(expected)
        else:
            control.fill(str(expected))
        saved(page)
        (key,) = layer_of(stored(service, project))["design"]["directions"]
        assert expected in (key["edge_weight"], key.get("follow"), key.get("free"))
    assert key["elements"][0]["pattern"] == "trisector"
    assert apart_deg(directions_deg(service, project), own)[inside].max() > 20, "they are the surroundings' now"
    for _ in range(2):
        page.get_by_label("At its border").select_option(label="Styles change gradually")
        saved(page)
        assert layer_of(stored(service, project))["design"]["regions"]["region"]["border"] == "soft"
        page.keyboard.press("Escape")
        page.locator(".stage-canvas").focus()
        page.keyboard.press("Control+z")
        saved(page)
        assert layer_of(stored(service, project))["design"]["regions"]["region"].get("border") != "soft"
    assert HTTP.get(f"{service}/v1/projects/{project}/check").json()["errors"] == []
    watched.check()


def test_an_element_is_shown_where_its_region_is_and_a_new_key_takes_its_place(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    project = open_project(page, service, video, "multistyle")
    pick(page)
    page.get_by_role("group", name="Pattern").get_by_role("button", name="Circles").click()
    draw(page, (DISC, 0.5), (DISC + 0.2, 0.5))
    page.locator(".stage-canvas").focus()
    page.keyboard.press("End")
    until(page, lambda: page.locator(".stage-canvas").get_attribute("data-frame") == str(FRAMES - 1))
    expect(page.get_by_text("The stage shows the directions of the film.")).to_be_visible(timeout=SOON_MS)
    there = (5 + FRAMES - 1) / (FRAMES + 10)
    draw(page, (there, 0.5), (there, 0.4))
    saved(page)
    first, last = layer_of(stored(service, project))["design"]["directions"]
    assert (first["frame"], last["frame"]) == (FRAME, FRAMES - 1)
    assert first["elements"][0]["at"] == pytest.approx([DISC, 0.5], abs=0.02)
    assert len(last["elements"]) == 1, "the handle was there, so that no other element was placed"
    assert last["elements"][0]["at"] == pytest.approx([there, 0.4], abs=0.03)
    assert last["elements"][0]["reach"] == pytest.approx(first["elements"][0]["reach"], rel=0.1)
    page.keyboard.press("Control+z")
    saved(page)
    assert layer_of(stored(service, project))["design"]["directions"] == [first]
    watched.check()


def test_figure_5_a_region_is_picked_dims_the_others_gets_a_style_and_is_unselected(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    open_project(page, service, video, "multistyle")
    page.get_by_role("button", name="Original").click()
    until(page, lambda: brightness(page, FIELD)[0] > 120)
    page.locator("summary", has_text="The segmentation").click()
    plain = brightness(page, FIELD, (DISC, 0.5))
    page.get_by_label("Show all objects and their parts").check()
    until(page, lambda: brightness(page, FIELD, (DISC, 0.5)) != plain)
    page.get_by_label("Show all objects and their parts").uncheck()
    until(page, lambda: brightness(page, FIELD, (DISC, 0.5)) == plain)
    pick(page)
    page.mouse.move(5, 5)
    until(page, lambda: brightness(page, FIELD)[0] < 0.7 * plain[0])
    assert brightness(page, (DISC, 0.5))[0] == pytest.approx(plain[1], abs=3), "the selected one keeps its colours"
    choose_style(page, "Pointillism")
    page.locator("summary", has_text="All settings of the style").click()
    page.get_by_role("slider", name="Brightness").first.fill("-0.6")
    page.keyboard.press("Escape")
    page.locator(".stage-canvas").focus()
    page.keyboard.press("End")
    page.get_by_role("slider", name="Brightness").first.fill("0")
    page.locator(".stage-canvas").focus()
    page.get_by_role("button", name="Previous key").click()
    canvas = page.locator(".stage-canvas")
    until(page, lambda: canvas.get_attribute("data-frame") == str(FRAME))
    expect(page.get_by_role("heading", name="Style of region")).to_be_visible()
    until(page, lambda: brightness(page, FIELD)[0] < 0.7 * plain[0])  # the regions of this frame have arrived
    page.mouse.click(*on_stage(page, DISC, 0.5))
    expect(page.get_by_role("heading", name="Style of everything else")).to_be_visible()
    page.mouse.move(5, 5)
    until(page, lambda: brightness(page, FIELD)[0] == pytest.approx(plain[0], abs=3))
    saved(page)
    frames = frames_of(result(service, render(page)))
    far = from_disc(frames[FRAME].shape[:2])
    disc = frames[FRAME][far < 0.6].mean()
    last = frames[-1][HEIGHT // 2, round((5 + FRAMES - 1) / (FRAMES + 10) * WIDTH)].mean()
    assert disc < 90 < last, "the dot is dark at its first key and bright at its last"
    assert abs(frames[FRAME][far > 1.6].mean() - frames[-1][:, :40].mean()) < 12, "the field keeps its colours"
    watched.check()


def test_drawn_regions_dim_the_rest_are_unselected_and_merged(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "multistyle")
    page.get_by_role("button", name="Original").click()
    page.get_by_role("button", name="Draw a region").click()
    until(page, lambda: brightness(page, FIELD)[0] > 120)
    (plain,) = brightness(page, FIELD)
    draw(page, (0.05, 0.1), (0.3, 0.1), (0.3, 0.9), (0.05, 0.9), (0.05, 0.15))
    until(page, lambda: brightness(page, FIELD)[0] < 0.7 * plain)
    assert brightness(page, (0.15, 0.2))[0] == pytest.approx(plain, abs=3)
    page.keyboard.down("Shift")
    draw(page, (0.6, 0.05), (0.9, 0.05), (0.9, 0.4), (0.6, 0.4), (0.6, 0.1))
    page.keyboard.up("Shift")
    until(page, lambda: brightness(page, FIELD)[0] == pytest.approx(plain, abs=3))
    page.get_by_role("button", name="region", exact=True).click()
    expect(page.get_by_role("heading", name="Style of everything else")).to_be_visible()
    draw(page, (0.6, 0.6), (0.9, 0.6), (0.9, 0.9), (0.6, 0.9), (0.6, 0.65))
    saved(page)
    regions = layer_of(stored(service, project))["design"]["regions"]
    assert {name: len(region["polygons"]) for name, region in regions.items()} == {"region": 2, "region-2": 1}
    page.get_by_label("Merge with").select_option(label="region")
    saved(page)
    regions = layer_of(stored(service, project))["design"]["regions"]
    assert {name: len(region["polygons"]) for name, region in regions.items()} == {"region-2": 3}
    header, payload = ask(service, project, "regions", film=True)[0]
    plane = cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert plane is not None and header["names"] == ["rest", "region-2"]
    inside = [
        int(plane[round(y * HEIGHT), round(x * WIDTH)]) for x, y in ((0.15, 0.5), FIELD, (0.75, 0.75), (0.5, 0.5))
    ]
    assert inside == [1, 1, 1, 0]
    assert HTTP.get(f"{service}/v1/projects/{project}/check").json()["errors"] == []
    page.keyboard.press("Control+z")
    saved(page)
    assert set(layer_of(stored(service, project))["design"]["regions"]) == {"region", "region-2"}
    watched.check()


def test_the_segmentation_is_corrected_with_a_brush(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "multistyle")
    pick(page)
    page.locator("summary", has_text="The segmentation").click()
    page.get_by_role("button", name="Correct with a brush").click()
    page.get_by_label("Width of the correcting brush").fill("12")
    draw(page, (0.7, 0.2), (0.9, 0.2))
    draw(page, (0.7, 0.8), (0.9, 0.8))
    page.keyboard.down("Alt")
    draw(page, (DISC, 0.45), (DISC, 0.55))
    page.keyboard.up("Alt")
    expect(page.get_by_role("button", name="Remove the corrections of this frame (3)")).to_be_visible()
    saved(page)
    strokes = layer_of(stored(service, project))["design"]["corrections"]
    assert [(one["region"], one["frame"]) for one in strokes] == [("region", 4), ("region", 4), ("rest", 4)]
    assert all(one["width"] == pytest.approx(12 / HEIGHT, abs=0.001) for one in strokes)

    def regions_at(*points: tuple[float, float]) -> list[int]:
        _, payload = ask(service, project, "regions", film=True)[0]
        plane = cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert plane is not None
        return [int(plane[round(y * HEIGHT), round(x * WIDTH)]) for x, y in points]

    points = ((0.8, 0.2), (0.8, 0.8), (DISC, 0.5), (0.8, 0.5))
    assert regions_at(*points) == [1, 1, 0, 0]
    page.keyboard.press("Control+z")
    saved(page)
    assert regions_at(*points) == [1, 1, 1, 0]
    page.get_by_role("button", name="Remove the corrections of this frame (2)").click()
    saved(page)
    assert regions_at(*points) == [0, 0, 1, 0]
    watched.check()
