"""Cuts on the filmstrip: the service finds them, buttons and keys step between them."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.pages import Watched, accessibility_faults, make_two_shots, until
from tests.e2e.studio import SOON_MS, open_project
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

CUT = 20


def middle_of_the_cut(page: Page) -> float:
    """Horizontal position of the only cut, px."""
    mark = page.locator(".cut-mark").bounding_box()
    assert mark is not None
    return mark["x"] + mark["width"] / 2


def test_cuts_are_marked_and_stepped_by_keys_and_buttons(
    watched: Watched, service: str, tmp_path: Path, axe: str
) -> None:
    page = watched.page
    data = make_two_shots(tmp_path / "two.mp4", 2 * CUT).read_bytes()
    video = HTTP.post(f"{service}/v1/assets", files={"file": ("two.mp4", data)}).json()["id"]
    open_project(page, service, video, "abstraction", frame=13)
    canvas, strip = page.locator(".stage-canvas"), page.get_by_role("slider", name="Frame", exact=True)
    expect(page.locator(".cut-mark")).to_have_count(1, timeout=SOON_MS)
    box = page.locator(".strip").bounding_box()
    assert box is not None
    assert middle_of_the_cut(page) == pytest.approx(box["x"] + box["width"] / 2, abs=1)
    expect(strip).to_have_attribute("aria-valuetext", "Frame 14 of 40, piece 1 of 2")
    expect(page.locator(".strip-time")).to_contain_text("piece 1 of 2")
    page.keyboard.press(".")
    expect(canvas).to_have_attribute("data-frame", str(CUT), timeout=SOON_MS)
    expect(strip).to_have_attribute("aria-valuetext", "Frame 21 of 40, piece 2 of 2")
    expect(page.get_by_role("button", name="Next cut")).to_be_disabled()
    page.keyboard.press("ArrowRight")
    expect(canvas).to_have_attribute("data-frame", str(CUT + 1), timeout=SOON_MS)
    page.keyboard.press(",")
    expect(canvas).to_have_attribute("data-frame", str(CUT), timeout=SOON_MS)
    page.get_by_role("button", name="Previous cut").click()
    expect(canvas).to_have_attribute("data-frame", "0", timeout=SOON_MS)
    expect(page.get_by_role("button", name="Previous cut")).to_be_disabled()
    strip.press("+")
    expect(page.locator(".cut-mark")).to_have_count(0)
    page.keyboard.press("End")
    expect(canvas).to_have_attribute("data-frame", str(2 * CUT - 1), timeout=SOON_MS)
    expect(page.locator(".cut-mark")).to_have_count(1)
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 10)
    page.mouse.wheel(0, 600)
    until(page, lambda: middle_of_the_cut(page) == pytest.approx(box["x"] + box["width"] / 2, abs=1))
    assert accessibility_faults(page, axe) == []
