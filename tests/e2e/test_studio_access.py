"""Accessibility of the studio: no fault in any state, and a film can be made by keyboard alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.pages import SLOW_MS, Watched, accessibility_faults, open_page
from tests.e2e.studio import FILM_MS, SOON_MS, draw, on_stage, open_project, start_painting
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]


def pick_a_region(page: Page) -> None:
    page.get_by_role("button", name="Pick regions").click()
    expect(page.get_by_text("Pick one of")).to_be_visible(timeout=SOON_MS)
    page.mouse.click(*on_stage(page, 0.4, 0.5))
    page.get_by_role("group", name="Styles").get_by_role("button", name="Watercolor").click()
    page.get_by_role("group", name="Pattern").get_by_role("button", name="Circles").click()
    draw(page, (0.3, 0.5), (0.45, 0.5))
    page.keyboard.press("End")
    page.get_by_label("Stroke width", exact=True).fill("30")
    expect(page.get_by_role("slider", name="Stroke width at frame 12")).to_be_visible()
    for title in ("The segmentation", "All settings of the style", "All settings of the directions"):
        page.locator("summary", has_text=title).click()
    page.get_by_label("Show all objects and their parts").check()
    page.get_by_role("button", name="Correct with a brush").click()
    draw(page, (0.6, 0.5), (0.8, 0.5))
    expect(page.get_by_role("button", name="Remove the corrections of this frame (1)")).to_be_visible()


def paint_a_key(page: Page) -> None:
    start_painting(page)
    draw(page, (0.2, 0.3), (0.8, 0.3))
    group = page.get_by_role("group", name="Frames painted from this key")
    expect(group.get_by_role("button")).to_have_count(7, timeout=90_000)
    page.get_by_role("button", name="Suggest keys").click()
    expect(page.get_by_role("group", name="Suggested keys")).to_be_visible(timeout=SOON_MS)


def paint_offline(page: Page) -> None:
    start_painting(page)
    page.context.set_offline(True)
    draw(page, (0.2, 0.3), (0.8, 0.3))
    expect(page.get_by_role("alert").filter(has_text="kept in this browser")).to_be_visible(timeout=SOON_MS)


def open_layer_settings(page: Page) -> None:
    page.get_by_role("button", name="Add a layer").click()
    page.get_by_role("list", name="Layers of the shot").get_by_role("button", name="Settings").first.click()


def show_flicker(page: Page) -> None:
    page.get_by_role("group", name="View").get_by_role("button", name="Flicker").click()
    expect(page.get_by_role("status").filter(has_text="Flicker of this frame")).to_be_visible(timeout=SOON_MS)
    page.get_by_role("button", name="Find the worst frames").click()
    expect(page.get_by_role("img", name=re.compile("^Flicker of"))).to_be_visible(timeout=SOON_MS)


def find_clusters(page: Page) -> None:
    page.get_by_role("button", name="Mark the foreground").click()
    page.wait_for_timeout(300)
    draw(page, (0.2, 0.5), (0.4, 0.5))
    group = page.get_by_role("group", name="Foreground of the next frames")
    expect(group.get_by_role("button").first).to_be_visible(timeout=FILM_MS)
    page.get_by_role("button", name="Find the clusters").click()
    chips = page.get_by_role("group", name="Paint with the label")
    expect(chips.get_by_role("button").first).to_be_visible(timeout=FILM_MS)


def open_library(page: Page) -> None:
    page.get_by_role("button", name="Keep these settings").click()
    page.locator("summary", has_text="Style library").click()
    page.get_by_role("button", name="Compare on this frame").click()


def open_drawing_panel(page: Page) -> None:
    start_painting(page)
    page.get_by_role("button", name="Brush:").click()
    page.get_by_role("list", name="Brushes").get_by_role("button", name="Oil").click()
    page.locator("summary", has_text="Settings of Oil").click()


def open_colours(page: Page) -> None:
    start_painting(page)
    page.get_by_role("button", name="Colours", exact=True).click()
    page.get_by_role("button", name="Take the colours of this frame").click()
    expect(page.get_by_role("group", name="Colours of the painting")).to_be_visible(timeout=SOON_MS)


STATES: dict[str, tuple[str, Callable[[Page], None]]] = {
    "region": ("multistyle", pick_a_region),
    "key": ("analogy", paint_a_key),
    "offline": ("analogy", paint_offline),
    "layers": ("abstraction", open_layer_settings),
    "flicker": ("abstraction", show_flicker),
    "clusters": ("patches", find_clusters),
    "library": ("analogy", open_library),
    "brushes": ("analogy", open_drawing_panel),
    "colours": ("analogy", open_colours),
}


@pytest.mark.parametrize("state", STATES)
def test_no_studio_state_has_an_accessibility_fault(
    watched: Watched, service: str, video: str, axe: str, state: str
) -> None:
    page = watched.page
    method, reach = STATES[state]
    open_project(page, service, video, method)
    page.evaluate(axe)
    reach(page)
    assert accessibility_faults(page, axe) == []


def test_lesson_and_comparison_have_no_accessibility_fault(
    watched: Watched, service: str, video: str, axe: str
) -> None:
    page = watched.page
    body = {"method": "abstraction", "inputs": {"video": video}}
    jobs = [HTTP.post(f"{service}/v1/jobs", json={**body, "seed": seed}).json()["id"] for seed in (1, 2)]
    page.goto(service)
    page.get_by_role("button", name="Learn painted keys in two minutes").click()
    expect(page.get_by_role("region", name="Your first keys")).to_be_visible(timeout=SOON_MS)
    found = accessibility_faults(page, axe)
    page.goto(f"{service}/#/compare/{','.join(jobs)}")
    expect(page.get_by_role("slider", name=re.compile("^Compare"))).to_be_visible(timeout=FILM_MS)
    found += accessibility_faults(page, axe)
    page.goto(f"{service}/#/jobs")
    page.get_by_role("searchbox", name="Search works").fill("nothing like it")
    expect(page.get_by_text("No work matches.")).to_be_visible(timeout=SOON_MS)
    found += accessibility_faults(page, axe)
    assert found == []


def tab_to(page: Page, name: str) -> None:
    """Press Tab until the element with this text or label has the focus."""
    for _ in range(150):
        page.keyboard.press("Tab")
        text = page.evaluate(
            "(() => { const it = document.activeElement; if (it === document.body) return '';"
            " return it.getAttribute('aria-label') || it.innerText || it.labels?.[0]?.innerText || ''; })()"
        )
        if name in str(text):
            return
    pytest.fail(f"Tab never reached {name!r}")


def test_a_film_is_made_from_a_file_by_keyboard_alone(watched: Watched, service: str, clip: Path) -> None:
    page = watched.page
    page.goto(service)
    expect(page.locator(".drop-large")).to_be_visible(timeout=SOON_MS)
    with page.expect_file_chooser() as chooser:
        tab_to(page, "Choose")
        page.keyboard.press("Enter")
    chooser.value.set_files(clip)
    expect(page.locator(".stage.painted")).to_be_visible(timeout=SLOW_MS)
    tab_to(page, "Draw on it")
    page.keyboard.press("Enter")
    expect(page.locator(".stage-canvas")).to_be_visible(timeout=SOON_MS)
    page.keyboard.press("End")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "11", timeout=SOON_MS)
    tab_to(page, "Paint the film")
    page.keyboard.press("Enter")
    film_state = page.get_by_role("region", name="The film")
    expect(film_state).to_contain_text("Finished", timeout=FILM_MS)
    tab_to(page, "Show it on the stage")
    page.keyboard.press("Enter")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-film", "11", timeout=SOON_MS)
    tab_to(page, "Page of the film")
    page.keyboard.press("Enter")
    page.wait_for_url("**/#/jobs/*", timeout=SOON_MS)
    expect(page.get_by_role("button", name="Download MP4")).to_be_visible(timeout=FILM_MS)
    tab_to(page, "Download MP4")
    with page.expect_download() as film:
        page.keyboard.press("Enter")
    assert film.value.suggested_filename.endswith(".mp4")


def test_every_tool_is_reached_on_a_tablet_that_has_lost_its_connection(
    browser: Browser, service: str, video: str
) -> None:
    """The connection is lost before the worker that encodes pictures has been loaded."""
    page = open_page(browser, viewport={"width": 1024, "height": 768}, has_touch=True).page
    page.route("**/png-worker*", lambda route: route.abort())
    open_project(page, service, video, "analogy")
    page.get_by_role("button", name="Brush", exact=True).click()
    page.context.set_offline(True)
    draw(page, (0.2, 0.3), (0.8, 0.3))
    expect(page.get_by_role("alert").filter(has_text="kept in this browser")).to_be_visible(timeout=SOON_MS)
    toolbar = page.get_by_role("toolbar", name="Tools")
    assert toolbar.evaluate("bar => bar.scrollHeight <= bar.clientHeight + 1"), "no tool is cut off"
    for tool in toolbar.get_by_role("button").all():  # the last ones by scrolling
        tool.scroll_into_view_if_needed()
        expect(tool).to_be_in_viewport(ratio=1)
    box = page.locator(".stage-canvas").bounding_box()
    assert box is not None and box["width"] > 450, "the tools leave most of the room to the picture"
    assert page.locator(".designer-main").evaluate("main => main.scrollWidth <= main.clientWidth")
    page.context.close()
