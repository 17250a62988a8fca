"""Works and job pages in Chromium: exports, labels, search."""

from __future__ import annotations

import re
import time
from pathlib import Path

import av
import pytest
from playwright.sync_api import Browser, Page, Route, expect

from pipeline.formats import OUTPUTS
from tests.e2e.pages import FPS, FRAMES, HEIGHT, WIDTH, Watched, open_page, until
from tests.e2e.studio import FILM_MS, SOON_MS, frames_of
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]


@pytest.fixture(scope="module")
def film(service: str, video: str) -> str:
    """A finished job."""
    body = {
        "method": "abstraction", "inputs": {"video": video}, "params": {"lines": "off"}, "name": "Field",
        "labels": {"scene": "12"},
    }  # fmt: skip
    job = str(HTTP.post(f"{service}/v1/jobs", json=body).json()["id"])
    deadline = time.monotonic() + FILM_MS / 1000
    while HTTP.get(f"{service}/v1/jobs/{job}").json()["state"] != "succeeded":
        assert time.monotonic() < deadline
        time.sleep(0.3)
    return job


@pytest.mark.parametrize(
    ("encoding", "name"),
    [("webm vp9", "Field.webm"), ("png 16", "Field.zip"), ("gif 256", "Field.gif"), ("mov 4444", "Field.mov")],
)
def test_a_finished_film_is_saved_in_another_format(
    encoding: str, name: str, watched: Watched, service: str, film: str, tmp_path: Path
) -> None:
    page = watched.page
    page.goto(f"{service}/#/jobs/{film}")
    formats = page.get_by_role("group", name="Export as")
    offered = formats.get_by_label("Encoding of the export")
    expect(offered).to_be_visible(timeout=SOON_MS)
    known = [f"{form.name} {profile.name}" for form in OUTPUTS.values() for profile in form.profiles]
    assert offered.locator("option").evaluate_all("all => all.map(each => each.value)") == [
        each for each in known if each != "mp4 h264"
    ]
    offered.select_option(encoding)
    expect(formats.get_by_label("Quality of the export")).to_have_count(int(encoding == "webm vp9"))
    with page.expect_download(timeout=FILM_MS) as download:
        formats.get_by_role("button", name="Export").click()
    assert download.value.suggested_filename == name
    path = tmp_path / name
    download.value.save_as(path)
    if name.endswith(".zip"):
        frames = frames_of(path.read_bytes())
        assert (len(frames), frames[0].shape[:2]) == (FRAMES, (HEIGHT, WIDTH))
    else:
        with av.open(str(path)) as container:
            assert sum(1 for _ in container.decode(video=0)) == FRAMES
    expect(formats.get_by_role("button", name="Export")).to_be_enabled()
    watched.check()


def test_exports_are_not_among_the_works(watched: Watched, service: str, film: str) -> None:
    made = HTTP.post(f"{service}/v1/jobs/{film}/exports", json={"format": "gif"}).json()
    page = watched.page
    page.goto(f"{service}/#/jobs")
    expect(page.locator(f".work a[href='#/jobs/{film}']")).to_be_visible(timeout=SOON_MS)
    expect(page.locator(f".work a[href='#/jobs/{made['id']}']")).to_have_count(0)


def test_works_are_found_by_label(watched: Watched, service: str, film: str) -> None:
    page = watched.page
    page.goto(f"{service}/#/jobs")
    card = page.locator(".work", has=page.locator(f"a[href='#/jobs/{film}']"))
    expect(card).to_contain_text("scene: 12", timeout=SOON_MS)
    search = page.get_by_role("searchbox", name="Search works")
    search.fill("scene:13")
    expect(card).to_be_hidden()
    expect(page.get_by_text("No work matches.")).to_be_visible()
    search.fill("field scene:12")
    expect(card).to_be_visible()
    page.get_by_label("Works to show").select_option("failed")
    expect(card).to_be_hidden()
    expect(page.get_by_text("No work matches.")).to_be_visible()


def test_the_search_finds_works_that_no_page_has_shown(watched: Watched, service: str, film: str, video: str) -> None:
    body = {"method": "abstraction", "inputs": {"video": video}, "name": "Crowd"}
    made = [HTTP.post(f"{service}/v1/jobs", json={**body, "seed": seed}).json()["id"] for seed in range(25)]
    for job in made:
        HTTP.post(f"{service}/v1/jobs/{job}/cancel")
    page = watched.page
    page.goto(f"{service}/#/jobs")
    expect(page.locator(".work:not(.skeleton)")).to_have_count(24, timeout=SOON_MS)
    card = page.locator(".work", has=page.locator(f"a[href='#/jobs/{film}']"))
    expect(card).to_be_hidden()
    page.get_by_role("searchbox", name="Search works").fill("field")
    expect(card).to_be_visible()
    page.get_by_role("searchbox", name="Search works").fill("crowd")
    page.get_by_role("button", name="Show more").click()
    expect(page.locator(".work")).to_have_count(25)
    for job in made:
        HTTP.delete(f"{service}/v1/jobs/{job}")


def test_the_job_page_names_what_was_used(watched: Watched, service: str, film: str) -> None:
    page = watched.page
    page.goto(f"{service}/#/jobs/{film}")
    page.locator("summary", has_text="Settings").click()
    settings = page.locator(".facts .pairs").first
    for text in ("Abstraction", "Lines", "scene: 12", film):
        expect(settings).to_contain_text(text)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"], origin=service)
    page.get_by_role("group", name="Copy this job as").get_by_role("button", name="Command").click()
    copied = page.evaluate("navigator.clipboard.readText()")
    assert re.fullmatch(r"impasto render VIDEO -o film.mp4 --method abstraction .*--param lines=off.*", copied)


def test_the_worst_moments_of_the_report_are_shown_in_the_player(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    body = {"method": "abstraction", "inputs": {"video": video}, "params": {"temporal": "off"}}
    job = HTTP.post(f"{service}/v1/jobs", json=body | {"output": {"report": True}}).json()["id"]
    page.goto(f"{service}/#/jobs/{job}")
    chart = page.get_by_role("group", name="Flicker over time")
    expect(chart).to_be_visible(timeout=FILM_MS)
    quality = HTTP.get(f"{service}/v1/jobs/{job}/files/report").json()["quality"]
    bars = chart.get_by_role("button")
    expect(bars).to_have_count(len(quality["samples"]))
    assert chart.locator(".worst").count() == len(quality["worst"]) > 0
    heights = [bar.bounding_box()["height"] for bar in bars.all()]
    flicker = [sample["flicker"] for sample in quality["samples"]]
    assert heights[flicker.index(max(flicker))] == max(heights), "the highest bar is that of the most flicker"
    film = page.get_by_label("The painted film")
    for frame, button in zip(
        quality["worst"],
        page.get_by_role("group", name="Frames with the most flicker").get_by_role("button").all(),
        strict=True,
    ):
        expect(button).to_have_text(re.compile(f"^Frame {frame + 1} · "))
        button.click()
        until(page, lambda frame=frame: int(film.evaluate("film => film.currentTime") * FPS) == frame)
    last = quality["samples"][-1]["frame"]
    bars.last.click()
    until(page, lambda: int(film.evaluate("film => film.currentTime") * FPS) == last)
    assert film.evaluate("film => film.paused")
    watched.check()


def show_failed(page: Page, service: str, film: str, code: str) -> None:
    """Show the page of a job that has failed with this error."""
    error = {"code": code, "message": "It cannot be painted.", "remedy": "Choose another."}
    steps = [{"name": "scan", "title": "Find the shots", "state": "failed", "counts": {}, "progress": 0, "seconds": 0}]

    def fail(route: Route) -> None:
        job = route.fetch().json()
        route.fulfill(json=job | {"state": "failed", "progress": 0.4, "error": error, "results": [], "steps": steps})

    page.route(f"**/v1/jobs/{film}", fail)
    page.goto(f"{service}/#/jobs/{film}")
    expect(page.get_by_text("The job failed")).to_be_visible()


@pytest.mark.parametrize(("code", "first"), [("not-found", "Change settings"), ("internal", "Try again")])
def test_a_failed_job_offers_what_may_help_first(
    code: str, first: str, watched: Watched, service: str, film: str
) -> None:
    page = watched.page
    show_failed(page, service, film, code)
    expect(page.locator(".job-panel .button.primary")).to_have_text([first])
    expect(page.get_by_text("Nothing was painted.")).to_be_visible()
    expect(page.locator(".progress-number")).to_be_hidden()
    expect(page.get_by_label("Progress of the film")).to_be_hidden()


def test_the_player_of_a_tablet_has_a_long_slider(browser: Browser, service: str, film: str) -> None:
    watched = open_page(browser, viewport={"width": 1024, "height": 768}, has_touch=True)
    watched.page.goto(f"{service}/#/jobs/{film}")
    box = watched.page.get_by_role("slider", name="Position").bounding_box()
    assert box is not None and box["width"] > 300 and box["height"] >= 44
    watched.check()
    watched.page.context.close()
