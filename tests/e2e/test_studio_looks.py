"""Looks: saved with a picture, used on several shots, copied from shot to shot, exported and imported as a file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.pages import Watched, accessibility_faults, until
from tests.e2e.studio import SOON_MS, open_project, saved, stored

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]


def methods(service: str, project: str) -> list[tuple[str, object]]:
    """Method and parameters of each shot."""
    layers = [shot["layers"][0] for shot in stored(service, project)["shots"]]
    return [(layer["method"], layer.get("params", {})) for layer in layers]


def open_looks(page: Page) -> None:
    if not page.get_by_label("Name of the look to save").is_visible():
        page.locator(".looks summary").click()


def painted(page: Page) -> None:
    until(page, lambda: page.locator(".stage-canvas").get_attribute("data-result") == "final")


def test_a_look_is_saved_with_a_picture_and_used_on_several_shots(
    watched: Watched, service: str, video: str, axe: str
) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction", params={"vividness": 1.7}, seed=5)
    painted(page)
    page.get_by_role("button", name="Cut the shot at this frame").click()
    shots = page.get_by_role("listbox", name="Shots").get_by_role("option")
    expect(shots).to_have_count(2)
    page.keyboard.press("ArrowLeft")
    painted(page)
    open_looks(page)
    page.get_by_label("Name of the look to save").fill("Bright")
    page.get_by_role("button", name="Save look").click()
    cards = page.get_by_role("list", name="Looks")
    expect(cards.locator("img").first).to_be_visible(timeout=SOON_MS)
    assert accessibility_faults(page, axe) == []
    shots.nth(1).click()
    expect(shots.nth(1)).to_have_attribute("aria-selected", "true")
    page.locator(".method-choice summary").click()
    page.get_by_role("radio", name="Painting in many styles").click(force=True)
    saved(page)
    assert [method for method, _ in methods(service, project)] == ["abstraction", "multistyle"]
    open_looks(page)
    cards.get_by_role("button", name="Use Bright on several shots").click()
    dialog = page.get_by_role("dialog")
    expect(dialog.get_by_role("checkbox")).to_have_count(2)
    assert accessibility_faults(page, axe) == []
    dialog.get_by_role("button", name="Use it").click()
    saved(page)
    assert methods(service, project) == [("abstraction", {"vividness": 1.7})] * 2
    assert stored(service, project)["shots"][1]["layers"][0]["seed"] == 5
    page.keyboard.press("Control+z")
    saved(page)
    assert [method for method, _ in methods(service, project)] == ["abstraction", "multistyle"]
    watched.check()


def test_a_look_is_copied_to_another_shot_and_exported_to_another_project(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction", params={"vividness": 1.7})
    page.get_by_role("button", name="Cut the shot at this frame").click()
    shots = page.get_by_role("listbox", name="Shots").get_by_role("option")
    open_looks(page)
    page.get_by_role("button", name="Copy the look").click()
    shots.nth(1).click()
    expect(shots.nth(1)).to_have_attribute("aria-selected", "true")
    page.locator(".method-choice summary").click()
    page.get_by_role("radio", name="Painting in many styles").click(force=True)
    open_looks(page)
    page.get_by_role("button", name="Paste the look").click()
    saved(page)
    assert methods(service, project) == [("abstraction", {"vividness": 1.7})] * 2
    painted(page)
    page.get_by_label("Name of the look to save").fill("Bright")
    page.get_by_role("button", name="Save look").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Export Bright").click()
    assert download.value.suggested_filename == "Bright.look.json"
    file = tmp_path / "bright.look.json"
    download.value.save_as(file)
    assert len(json.loads(file.read_text())["files"]) == 1, "its picture"

    other = open_project(page, service, video, "multistyle")
    open_looks(page)
    page.get_by_label("Import a look").set_input_files(file)
    page.get_by_role("list", name="Looks").get_by_role("button", name="Bright", exact=True).first.click(timeout=SOON_MS)
    saved(page)
    assert methods(service, other) == [("abstraction", {"vividness": 1.7})]
    wrong = tmp_path / "wrong.json"
    wrong.write_text("{}")
    open_looks(page)
    page.get_by_label("Import a look").set_input_files(wrong)
    expect(page.get_by_text("“wrong.json” is no look.")).to_be_visible(timeout=SOON_MS)
    watched.check()
