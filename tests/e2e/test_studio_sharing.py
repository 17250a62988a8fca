"""Sharing of projects: shown to others by a link, exported to a file, restored to an earlier version."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.pages import Watched, accessibility_faults, open_page, until
from tests.e2e.studio import SOON_MS, open_project, saved, stored
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]


def test_a_project_is_shared_exported_and_brought_back(
    browser: Browser, watched: Watched, service: str, video: str, axe: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction")
    first = stored(service, project)
    name = page.get_by_label("Name of the project")
    name.fill("Disc with a new name")
    name.press("Tab")
    saved(page)

    page.get_by_role("button", name="Share, versions").click()
    dialog = page.get_by_role("dialog", name="Disc with a new name")
    dialog.get_by_role("button", name="Copy a link").click()
    link = dialog.get_by_label("Link to this project")
    expect(link).to_be_visible(timeout=SOON_MS)
    address = link.input_value()
    assert address.startswith(f"{service}/shared/")
    assert accessibility_faults(page, axe) == []
    guest = open_page(browser)
    guest.page.goto(address)
    expect(guest.page.get_by_role("heading", name="Disc with a new name")).to_be_visible(timeout=SOON_MS)
    expect(guest.page.get_by_text("No film of it is finished yet.")).to_be_visible()
    original = "document.querySelector('.shared-page video').videoWidth"
    until(guest.page, lambda: guest.page.evaluate(original) == 96)
    assert accessibility_faults(guest.page, axe) == []
    guest.check()

    with page.expect_download() as download:
        dialog.get_by_role("button", name="Save as a file").click()
    archive = tmp_path / download.value.suggested_filename
    assert archive.name == "Disc with a new name.zip"
    download.value.save_as(archive)

    dialog.get_by_role("button", name="End all links").click()
    expect(link).to_be_hidden()
    guest.page.reload()
    expect(guest.page.get_by_text("This link shows nothing any more.")).to_be_visible(timeout=SOON_MS)
    guest.page.context.close()

    dialog.get_by_label("Name or note of version 1").fill("Before the red")
    dialog.get_by_label("Name or note of version 1").press("Tab")
    versions = f"{service}/v1/projects/{project}/versions"
    until(page, lambda: HTTP.get(f"{versions}/1").json()["label"] == "Before the red")
    dialog.get_by_role("button", name="Restore version 1").click()
    expect(page.get_by_label("Name of the project")).to_have_value("Disc", timeout=SOON_MS)
    assert stored(service, project) == first

    page.goto(service)
    page.get_by_label("Open a project file").set_input_files(archive)
    page.wait_for_url("**/#/projects/*", timeout=SOON_MS)
    expect(page.get_by_label("Name of the project")).to_have_value("Disc with a new name", timeout=SOON_MS)
    other = page.url.rpartition("/")[2]
    assert other != project
    assert stored(service, other) == first | {"name": "Disc with a new name"}
