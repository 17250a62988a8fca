"""A film is followed in the studio: progress, cancel, and the finished film on the stage."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.pages import FPS, FRAMES, Watched, accessibility_faults, make_clip, until
from tests.e2e.studio import FILM_MS, SOON_MS, decoded, on_stage, open_project
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]


def stage_picture(page: Page) -> np.ndarray:
    """The middle of the stage as displayed on the screen."""
    left, top = on_stage(page, 0.1, 0.1)
    right, bottom = on_stage(page, 0.9, 0.9)
    box = {"x": left, "y": top, "width": right - left, "height": bottom - top}
    return decoded(page.screenshot(clip=box)).astype(int)


def test_a_finished_film_is_played_on_the_stage(watched: Watched, service: str, video: str, axe: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction")
    canvas, state = page.locator(".stage-canvas"), page.get_by_role("region", name="The film")
    views = page.get_by_role("group", name="View")
    expect(views.get_by_role("button", name="Film")).to_be_hidden()
    page.get_by_role("button", name="Paint the film").click()
    expect(state).to_contain_text("Finished", timeout=FILM_MS)
    assert "/projects/" in page.url
    (job,) = HTTP.get(f"{service}/v1/projects/{project}/jobs").json()["items"]
    link = state.get_by_role("link", name="Page of the film")
    expect(link).to_have_attribute("href", f"#/jobs/{job['job']['id']}")
    assert accessibility_faults(page, axe) == []
    page.emulate_media(color_scheme="light")

    views.get_by_role("button", name="Original").click()
    source = stage_picture(page)
    state.get_by_role("button", name="Show it on the stage").click()
    expect(canvas).to_have_attribute("data-film", "4", timeout=SOON_MS)
    until(page, lambda: np.abs(stage_picture(page) - source).mean() > 3)
    film = decoded(HTTP.get(f"{service}/v1/jobs/{job['job']['id']}/frames/4").content)
    shown = stage_picture(page)
    middle = film[film.shape[0] // 10 : -film.shape[0] // 10, film.shape[1] // 10 : -film.shape[1] // 10]
    assert shown.mean((0, 1)) == pytest.approx(middle.mean((0, 1)), abs=4)

    page.keyboard.press("Home")
    expect(canvas).to_have_attribute("data-film", "0", timeout=SOON_MS)
    page.keyboard.press("l")
    expect(canvas).to_have_attribute("data-film", str(FRAMES - 1), timeout=SOON_MS)
    expect(page.get_by_role("button", name="Play", exact=True)).to_be_visible(timeout=SOON_MS)
    page.keyboard.press("ArrowLeft")
    expect(canvas).to_have_attribute("data-film", str(FRAMES - 2), timeout=SOON_MS)

    page.reload()
    expect(views.get_by_role("button", name="Film")).to_be_visible(timeout=SOON_MS)
    state = page.get_by_role("region", name="The film")
    expect(state).to_be_hidden()
    watched.check()


def test_a_film_is_seen_on_the_stage_while_it_is_painted_found_after_a_reload_and_cancelled(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    long = make_clip(tmp_path / "long.mp4", size=(640, 352), frames=40 * FPS)
    video = HTTP.post(f"{service}/v1/assets", files={"file": (long.name, long.read_bytes())}).json()["id"]
    project = open_project(page, service, video, "multistyle", frame=160)
    page.get_by_role("button", name="Paint the film").click()
    state = page.get_by_role("region", name="The film")
    expect(state).to_be_visible(timeout=SOON_MS)
    page.reload()
    expect(state.get_by_role("progressbar", name="Progress of the film")).to_be_visible(timeout=SOON_MS)
    views, hint = page.get_by_role("group", name="View"), page.locator(".stage-hint")
    views.get_by_role("button", name="Original").click()
    source = stage_picture(page)
    expect(state.get_by_role("img", name="The newest finished frame")).to_be_visible(timeout=FILM_MS)
    state.get_by_role("button", name="Show it on the stage").click()
    expect(hint).to_contain_text("The newest finished frame of the film, which is being painted")
    expect(hint).to_contain_text(re.compile(r"\d %$"))
    assert np.abs(stage_picture(page) - source).mean() > 2, "another picture than the video's frame"
    state.get_by_role("button", name="Cancel").click()
    expect(state).to_contain_text("Cancelled", timeout=SOON_MS)
    (job,) = HTTP.get(f"{service}/v1/projects/{project}/jobs").json()["items"]
    assert job["job"]["state"] == "cancelled"
    expect(views.get_by_role("button", name="Compare")).to_have_attribute("aria-pressed", "true")
    expect(views.get_by_role("button", name="Film")).to_be_hidden()
    state.get_by_role("button", name="Close this message").click()
    expect(state).to_be_hidden()
