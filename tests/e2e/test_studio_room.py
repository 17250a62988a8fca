"""Room and keys of the studio: the share of the stage, the hidden panel, the list of keys, tab stops, markers."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.pages import Watched, accessibility_faults
from tests.e2e.studio import SOON_MS, open_project, saved, stored

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]


def stage_share(page: Page) -> float:
    """Width of the stage as a share of the window's."""
    box, size = page.locator(".stage-canvas").bounding_box(), page.viewport_size
    assert box is not None and size is not None
    return box["width"] / size["width"]


def test_the_stage_has_most_of_the_window_and_all_of_it_without_the_panel(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    open_project(page, service, video, "abstraction")
    assert stage_share(page) > 0.65
    page.set_viewport_size({"width": 1024, "height": 768})
    page.keyboard.press("p")
    expect(page.get_by_role("complementary", name="Settings")).to_have_count(0)
    assert stage_share(page) > 0.8
    page.reload()
    expect(page.get_by_role("button", name="Show the panel")).to_be_visible(timeout=SOON_MS)
    page.get_by_role("button", name="Show the panel").click()
    expect(page.get_by_role("complementary", name="Settings")).to_be_visible()
    watched.check()


def test_paint_the_film_is_reached_within_ten_tab_stops(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    open_project(page, service, video, "abstraction")
    page.reload()  # the first tab stop is the first one of the page
    expect(page.locator(".stage-canvas")).to_be_visible(timeout=SOON_MS)
    names: list[str] = []
    while "Skip to painting" not in names and len(names) < 9:
        page.keyboard.press("Tab")
        names.append(page.evaluate("document.activeElement.textContent"))
    assert "Skip to painting" in names, names
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="Paint the film", exact=True)).to_be_focused()


def test_the_keys_are_listed_and_frames_are_marked_with_notes(
    watched: Watched, service: str, video: str, axe: str
) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction")
    page.keyboard.press("?")
    dialog = page.get_by_role("dialog", name="Keys of the studio")
    expect(dialog).to_contain_text("Play again and again")
    assert accessibility_faults(page, axe) == []
    page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    page.keyboard.press("m")
    page.get_by_label("Note at frame 5").fill("The disc is too red")
    page.get_by_label("Note at frame 5").press("Tab")
    page.get_by_role("slider", name="Frame", exact=True).press("ArrowRight")
    expect(page.get_by_label("Note at frame 5")).to_be_hidden()
    page.get_by_role("button", name="Marker at frame 5: The disc is too red").click()
    expect(page.get_by_label("Note at frame 5")).to_have_value("The disc is too red")
    saved(page)
    markers = stored(service, project)["shots"][0]["ui"]["markers"]
    assert markers == [{"frame": 4, "note": "The disc is too red"}]
    assert accessibility_faults(page, axe) == []
    page.get_by_role("button", name="Remove the marker").click()
    expect(page.get_by_role("group", name="Markers")).to_be_hidden()
    watched.check()
