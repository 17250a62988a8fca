"""The first project teaches painted keys: its steps are ticked off as they are done."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.pages import Watched
from tests.e2e.studio import FILM_MS, SOON_MS, open_project, saved

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]


def stroke(page: Page) -> None:
    """A stroke across the middle of the stage."""
    box = page.locator(".stage-canvas").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x - 60, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 20, steps=6)
    page.mouse.up()


def test_the_first_project_leads_to_two_keys(watched: Watched, service: str) -> None:
    page = watched.page
    page.goto(service)
    page.get_by_role("button", name="Learn painted keys in two minutes").click()
    lesson = page.get_by_role("region", name="Your first keys")
    steps = lesson.get_by_role("listitem")
    current = lesson.locator("[aria-current=step]")
    expect(steps).to_have_count(4, timeout=SOON_MS)
    expect(current).to_contain_text("Press “Paint frame”")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "10", timeout=SOON_MS)
    page.get_by_role("button", name="Paint frame 11").click()
    expect(current).to_contain_text("Draw over the picture")
    stroke(page)
    expect(lesson.locator("[data-done]")).to_have_count(3, timeout=FILM_MS)
    page.get_by_role("slider", name="Frame", exact=True).press("End")
    page.get_by_role("button", name="Paint frame 30").click()
    stroke(page)
    expect(lesson.get_by_role("status")).to_contain_text("Well done", timeout=SOON_MS)
    saved(page)
    page.reload()
    expect(lesson.locator("[data-done]")).to_have_count(2, timeout=SOON_MS)
    lesson.get_by_role("button", name="End the lesson").click()
    expect(lesson).to_be_hidden()
    saved(page)


def test_the_guide_is_one_link_away(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    page.goto(service)
    expect(page.get_by_role("link", name="Guide: paint a shot in ten minutes")).to_be_visible(timeout=SOON_MS)
    open_project(page, service, video, "analogy")
    with page.expect_popup() as guide:
        page.get_by_role("link", name="Guide: paint a shot in ten minutes").click()
    expect(guide.value.get_by_role("heading", name="Paint a shot in ten minutes")).to_be_visible(timeout=SOON_MS)
    expect(guide.value.get_by_role("link", name="To the studio")).to_be_visible()
    watched.check()
