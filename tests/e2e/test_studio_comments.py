"""Comments on frames by people with a link, on the shared page of the whole film and in the studio; chosen keys."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.pages import Watched, accessibility_faults, open_page, until
from tests.e2e.studio import FILM_MS, SOON_MS, open_project
from tests.e2e.test_studio_play_film import open_film
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]


def test_people_with_a_link_see_the_whole_film_and_comment_on_frames(
    browser: Browser, watched: Watched, service: str, tmp_path: Path, axe: str
) -> None:
    page = watched.page
    project = open_film(page, service, tmp_path, [(2, 11), (25, 32)])
    HTTP.post(f"{service}/v1/projects/{project}/jobs", json={"changed": True}).raise_for_status()
    at = f"{service}/v1/projects/{project}"
    until(page, lambda: HTTP.get(f"{at}/film").json()["ready"], FILM_MS / 1000)
    page.get_by_role("button", name="Share, versions").click()
    page.get_by_label("They may comment on frames").check()
    page.get_by_role("button", name="Copy a link").click()
    address = page.get_by_label("Link to this project").input_value()
    page.get_by_role("button", name="Close", exact=True).click()

    guest = open_page(browser)
    guest.page.goto(address)
    film = guest.page.get_by_label("Film", exact=True)
    until(guest.page, lambda: bool(film.evaluate("(one) => one.duration > 1.2")))
    guest.page.get_by_role("button", name=re.compile("Shot 2")).click()
    expect(guest.page.get_by_role("button", name=re.compile("Shot 2"))).to_have_attribute("aria-current", "true")
    guest.page.get_by_label("On Shot 2, frame 26").fill("The bar is too blue.")
    guest.page.get_by_label("Your name").fill("Mia")
    guest.page.get_by_role("button", name="Comment", exact=True).click()
    written = guest.page.get_by_role("button", name="Shot 2, frame 26")
    expect(written).to_be_visible(timeout=SOON_MS)
    film.evaluate("(one) => { one.currentTime = 0; }")
    expect(guest.page.get_by_label("On Shot 1, frame 3")).to_be_visible(timeout=SOON_MS)
    written.click()
    expect(guest.page.get_by_label("On Shot 2, frame 26")).to_be_visible(timeout=SOON_MS)
    assert accessibility_faults(guest.page, axe) == []
    guest.check()
    guest.page.context.close()

    page.reload()
    page.locator(".shot-card").nth(1).click()
    mark = page.get_by_role("button", name="Comment at frame 26: The bar is too blue.")
    mark.click(timeout=SOON_MS)
    comments = page.get_by_role("group", name="Comments")
    expect(comments).to_contain_text("Mia The bar is too blue.")
    page.get_by_role("button", name="Comment on this frame").click()
    page.get_by_label("Comment on frame 26").fill("It is dusk.")
    page.keyboard.press("Enter")
    expect(comments).to_contain_text("The owner It is dusk.", timeout=SOON_MS)
    page.keyboard.press("m")
    page.get_by_label("Note at frame 26").fill("Warmer light")
    page.locator(".shot-card").first.click()
    page.get_by_role("button", name="Comments and markers of the film: 3").click()
    notes = page.get_by_role("dialog", name="Comments and markers")
    expect(notes.get_by_role("listitem")).to_have_count(3)
    expect(notes).to_contain_text("Warmer light")
    assert accessibility_faults(page, axe) == []
    notes.get_by_role("button", name="Shot 2, frame 26 Mia").click()
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "25", timeout=SOON_MS)
    comments.get_by_role("button", name="Delete the comment").first.click()
    expect(comments).not_to_contain_text("too blue", timeout=SOON_MS)
    assert [one["text"] for one in HTTP.get(f"{at}/comments").json()["items"]] == ["It is dusk."]
    watched.check()


def test_keys_are_changed_conflicts_are_named_and_all_are_reset(
    watched: Watched, service: str, video: str, axe: str
) -> None:
    page = watched.page
    open_project(page, service, video, "abstraction")
    page.keyboard.press("?")
    dialog = page.get_by_role("dialog", name="Keys of the studio")
    dialog.get_by_role("button", name="A marker at this frame, or none: M. Change it").click()
    page.keyboard.press("t")
    alert = dialog.get_by_role("alert")
    expect(alert).to_contain_text("T is the key of “Move the in and out points”.")
    assert accessibility_faults(page, axe) == []
    alert.get_by_role("button", name="Use it here").click()
    expect(dialog.get_by_role("button", name="Move the in and out points: no key. Change it")).to_be_visible()
    dialog.get_by_role("button", name="Next frame: Right. Change it").click()
    page.keyboard.press("5")
    page.keyboard.press("Escape")
    page.reload()
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "4", timeout=SOON_MS)
    page.keyboard.press("5")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "5", timeout=SOON_MS)
    expect(page.get_by_role("button", name="Next frame")).to_have_attribute("title", "Next frame (5)")
    page.keyboard.press("t")
    expect(page.get_by_role("button", name="Marker at frame 6")).to_be_visible()
    page.keyboard.press("t")
    page.keyboard.press("?")
    dialog.get_by_role("button", name="Use the usual keys").click()
    page.keyboard.press("Escape")
    page.keyboard.press("5")
    page.keyboard.press("t")
    expect(page.get_by_role("slider", name="In point")).to_be_visible()
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "5")
    watched.check()
