"""Variants in the studio: kept with a frame, compared in the wipe, rendered together, compared as films; flicker."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import expect

from pipeline.quality.coherence import measure_pair
from pipeline.video.guard.reader import GuardedReader
from tests.e2e.pages import FRAMES, Watched, until
from tests.e2e.studio import (
    FILM_MS,
    SOON_MS,
    decoded,
    draw,
    frames_of,
    on_stage,
    open_project,
    render,
    result,
    saved,
    stored,
)
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]


def test_variants_are_compared_on_a_frame_and_as_films(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction", params={"lines": "off"})
    presets = page.get_by_role("group", name="Presets").get_by_role("button")
    pictures = presets.locator("img")
    expect(pictures.last).to_be_visible(timeout=FILM_MS)
    shown = [decoded(picture.screenshot())[:40, :60] for picture in pictures.all()]
    assert max(np.abs(one.astype(int) - shown[0]).mean() for one in shown[1:]) > 0.5, "they show different paintings"
    keep = page.get_by_role("button", name="Keep these settings")
    keep.click()
    presets.nth(2).click()
    keep.click()
    saved(page)
    first, second = stored(service, project)["variants"]
    assert (first["frame"], first["set"]) == (4, {"method": "abstraction", "params": {"lines": "off"}})
    assert second["set"]["params"] != first["set"]["params"]
    cards = page.get_by_role("group", name="Variants")
    expect(cards.locator("img")).to_have_count(2, timeout=FILM_MS)

    page.get_by_role("button", name="Compare on this frame").click()
    page.get_by_label("Left of the divider").select_option("v1")
    page.get_by_label("Right of the divider").select_option("v1-2")
    canvas = page.locator(".stage-canvas")
    expect(canvas).to_have_attribute("data-compared", "variants", timeout=FILM_MS)
    page.wait_for_timeout(800)
    at = on_stage(page, 0.62, 0.2)
    clip_ = {"x": at[0], "y": at[1], "width": 40, "height": 40}
    right = decoded(page.screenshot(clip=clip_)).astype(int)
    page.mouse.move(*on_stage(page, 0.5, 0.5))
    page.mouse.down()
    page.mouse.move(*on_stage(page, 0.95, 0.5), steps=4)
    page.mouse.up()
    page.wait_for_timeout(300)
    left = decoded(page.screenshot(clip=clip_)).astype(int)
    assert abs(left - right).mean() > 0.5, "the divider uncovers the other variant"
    page.get_by_role("button", name="End the comparison").click()
    expect(canvas).to_have_attribute("data-compared", "")

    page.get_by_role("button", name="Paint all 2 variants").click()
    page.wait_for_url("**/#/compare/*", timeout=SOON_MS)
    expect(page.get_by_role("slider", name="Compare variant 1 and variant 2")).to_be_visible(timeout=FILM_MS)
    views = page.get_by_role("group", name="View").get_by_role("button")
    expect(views).to_have_text(["Variant 1", "Compare", "Variant 2"])
    ids = page.url.rpartition("/")[2].split(",")
    requests = [HTTP.get(f"{service}/v1/jobs/{job}").json()["request"] for job in ids]
    assert [request["labels"]["variant"] for request in requests] == ["v1", "v1-2"]
    assert [request["name"] for request in requests] == ["Disc: Variant 1", "Disc: Variant 2"]
    assert requests[0]["params"] == {"lines": "off"} != requests[1]["params"]

    page.goto(f"{service}/#/jobs/{ids[0]}")
    page.get_by_role("link", name="Compare variants").click()
    page.wait_for_url(f"**/#/compare/{ids[0]},{ids[1]}")


def test_the_divider_of_the_stage_is_dragged(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    open_project(page, service, video, "abstraction")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-result", "final", timeout=FILM_MS)

    def disc() -> NDArray[np.int64]:
        """The left half of the disc, on the screen."""
        page.wait_for_timeout(300)
        (left, top), (right, bottom) = on_stage(page, 0.27, 0.3), on_stage(page, 0.41, 0.7)
        box = {"x": left, "y": top, "width": right - left, "height": bottom - top}
        return decoded(page.screenshot(clip=box)).astype(int)

    source = disc()
    draw(page, (0.5, 0.5), (0.1, 0.6))
    painted = disc()
    assert abs(painted - source).mean() > 0.5, "right of the divider is the painting"
    draw(page, (0.1, 0.5), (0.9, 0.6))
    assert (disc() == source).all(), "left of it is the video's frame, where it was"
    page.get_by_role("group", name="View").get_by_role("button", name="Painted").click()
    assert (disc() == painted).all()


def flickers(source: Path, film: bytes) -> dict[int, float]:
    """Flicker of every frame of a film in PNG frames, as `impasto report` measures it."""
    with GuardedReader(source) as reader:
        pairs = pairwise(zip(reader.read(0, FRAMES), frames_of(film), strict=True))
        found = [measure_pair((before[0], now[0]), (before[1], now[1])).flicker for before, now in pairs]
    return dict(enumerate(found, 1))


def test_flicker_is_shown_in_the_frame_and_over_time(watched: Watched, service: str, video: str, clip: Path) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction")
    page.locator("summary", has_text="Film").click()
    page.get_by_role("switch", name="Quality report").check()
    job = render(page)
    assert HTTP.get(f"{service}/v1/jobs/{job}").json()["request"]["output"]["report"] is True
    page.goto(f"{service}/#/projects/{project}")
    canvas = page.locator(".stage-canvas")
    until(page, lambda: canvas.get_attribute("data-result") == "final")
    views = page.get_by_role("group", name="View")
    views.get_by_role("button", name="Painted").click()
    painted = canvas.screenshot()
    views.get_by_role("button", name="Flicker").click()
    status = page.get_by_role("status").filter(has_text="Flicker of this frame")
    expect(status).to_be_visible(timeout=SOON_MS)
    assert canvas.screenshot() != painted, "the heat map lies over the frame"

    page.get_by_role("button", name="Find the worst frames").click()
    worst = page.get_by_role("group", name="Frames with the most flicker").locator(".chip-button")
    expect(worst).to_have_count(3, timeout=SOON_MS)
    expect(page.get_by_role("img", name=f"Flicker of {FRAMES - 1} frames")).to_be_visible(timeout=SOON_MS)
    of_film = flickers(clip, result(service, job))
    shown = dict(text.removeprefix("Frame ").split(" · ") for text in worst.all_inner_texts())
    measured = {int(number) - 1: float(value) for number, value in shown.items()}
    for frame, value in measured.items():
        assert value == pytest.approx(of_film[frame], abs=0.06)
    worst.last.click()
    until(page, lambda: canvas.get_attribute("data-frame") == str(max(measured)))
    expect(status).to_contain_text(f"{measured[max(measured)]:.1f}")
