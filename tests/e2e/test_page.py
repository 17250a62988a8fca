"""The web page in Chromium, against a real service with a local pool and an empty home."""

from __future__ import annotations

import re
from pathlib import Path

import av
import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from tests.e2e.pages import FRAMES, KEY, SLOW_MS, WIDTH, Watched, make_clip, serve, until
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(180)]


@pytest.fixture
def watched(watched: Watched) -> Watched:
    """The page with animations: films play automatically only if the user does not prefer reduced motion."""
    watched.page.emulate_media(reduced_motion="no-preference")
    return watched


def enter_studio(page: Page, service: str, clip: Path) -> None:
    """Drop `clip` and wait until one of its frames is painted."""
    page.goto(service)
    page.set_input_files(".drop-large input[type=file]", clip)
    expect(page.locator(".stage.painted")).to_be_visible(timeout=SLOW_MS)


def painted(page: Page) -> str:
    """Address of the painted frame, which changes with each painting."""
    return page.locator(".wipe-after img").get_attribute("src") or ""


def submit(page: Page) -> None:
    page.get_by_role("button", name="Paint the film").click()
    expect(page.locator(".player")).to_be_visible(timeout=SLOW_MS)


def now(page: Page, which: str = "after") -> float:
    """Playback position of the painted ("after") or original ("before") film in seconds."""
    return float(page.evaluate(f"document.querySelector('.wipe-{which} video').currentTime"))


def test_a_dropped_clip_becomes_a_playing_painted_video(watched: Watched, service: str, clip: Path) -> None:
    page = watched.page
    enter_studio(page, service, clip)
    before = painted(page)
    page.get_by_text("Lines", exact=True).first.click()
    page.get_by_label("Line width").last.fill("4")
    until(page, lambda: painted(page) != before)
    assert "line_width" in page.url
    submit(page)
    assert re.search(r"#/jobs/job_", page.url)

    until(page, lambda: now(page) > 0.2)
    assert page.evaluate("document.querySelector('.wipe-after video').videoWidth") == WIDTH
    handle = page.get_by_role("slider", name="Compare original and painted")
    handle.focus()
    page.keyboard.press("ArrowRight")
    expect(handle).to_have_attribute("aria-valuenow", "52")
    box = page.locator(".wipe").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 4, box["y"] + 40, steps=3)
    page.mouse.up()
    expect(handle).to_have_attribute("aria-valuenow", "25")

    with page.expect_download() as download:
        page.get_by_role("button", name="Download MP4").click()
    assert re.fullmatch(r"disc.*field\.mp4", download.value.suggested_filename)
    with av.open(str(download.value.path())) as film:
        assert sum(1 for _ in film.decode(video=0)) == FRAMES
    watched.check()


def test_a_method_that_requires_a_second_video_asks_for_it(watched: Watched, service: str, clip: Path) -> None:
    page = watched.page
    enter_studio(page, service, clip)
    page.locator("input[type=radio][value=steady]").check()
    expect(page.locator(".slot.wrong .field-error")).to_contain_text("missing", timeout=SLOW_MS)
    page.locator(".slot:not(.more-inputs .slot) input[type=file]").first.set_input_files(clip)
    expect(page.get_by_role("button", name="Remove Styled video")).to_be_visible(timeout=SLOW_MS)
    submit(page)


def test_both_films_play_synchronously(watched: Watched, service: str, clip: Path) -> None:
    page = watched.page
    enter_studio(page, service, clip)
    submit(page)
    until(page, lambda: now(page) > 0.1)
    page.get_by_role("button", name="Pause").click()
    page.get_by_role("slider", name="Position").fill("0.5")
    until(page, lambda: abs(now(page, "before") - 0.5) < 0.05)
    assert now(page) == pytest.approx(0.5, abs=0.05)
    watched.check()


def test_an_original_that_the_browser_cannot_play_is_still_compared(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    enter_studio(page, service, make_clip(tmp_path / "old.avi", "mpeg4"))
    sketch = page.locator(".wipe-before img")
    expect(sketch).to_be_visible()
    before = sketch.get_attribute("src")
    page.get_by_role("slider", name="Frame to preview").fill("9")
    until(page, lambda: sketch.get_attribute("src") != before)
    submit(page)
    until(page, lambda: now(page) > 0.2)
    page.get_by_role("button", name="Pause").click()
    page.get_by_role("slider", name="Position").fill("0")
    until(page, lambda: disc_at(page) < 0.45)
    page.get_by_role("slider", name="Position").fill("0.9")
    until(page, lambda: disc_at(page) > 0.55)
    expect(page.get_by_role("slider", name="Compare original and painted")).to_be_visible()
    watched.check()


def disc_at(page: Page) -> float:
    """Horizontal position of the disc in the displayed original: 0 left, 1 right; NaN while the next one is coming."""
    picture = page.locator(".wipe-before img")
    data = picture.evaluate(
        """async image => { try { await image.decode(); } catch { return []; }
        const c = document.createElement('canvas');
        c.width = image.naturalWidth; c.height = image.naturalHeight; c.getContext('2d').drawImage(image, 0, 0);
        return Array.from(c.getContext('2d').getImageData(0, c.height / 2, c.width, 1).data); }"""
    )
    red = np.array(data).reshape(-1, 4)[:, 0]
    return float(np.flatnonzero(red > 160).mean() / len(red)) if len(red) else float("nan")


def test_a_running_job_shows_its_newest_frame(watched: Watched, service: str, tmp_path: Path) -> None:
    page, statuses = watched.page, []
    page.emulate_media(reduced_motion="reduce")  # to animate a bar while frames are painted takes 3 s of a processor
    page.on("response", lambda answer: statuses.append(answer.status) if "/files/preview" in answer.url else None)
    large = make_clip(tmp_path / "large.mp4", "mpeg4", size=(1280, 720), frames=90)  # one run of frames
    asset = HTTP.post(f"{service}/v1/assets", files={"file": ("large.mp4", large.read_bytes())}).json()["id"]
    request = {"method": "abstraction", "inputs": {"video": asset}, "params": {"analysis": "full"}}
    job = HTTP.post(f"{service}/v1/jobs", json=request).json()["id"]
    page.goto(f"{service}/#/jobs/{job}")
    expect(page.get_by_role("img", name="The newest finished frame")).to_be_visible(timeout=SLOW_MS)
    steps = HTTP.get(f"{service}/v1/jobs/{job}").json()["steps"]
    assert steps[2]["counts"]["succeeded"] == 0, "the run that it comes from is not over"
    expect(page.locator(".player")).to_be_visible(timeout=2 * SLOW_MS)
    assert set(statuses) == {200}
    watched.check()


def test_a_reload_restores_the_page(watched: Watched, service: str, clip: Path) -> None:
    page = watched.page
    enter_studio(page, service, clip)
    page.get_by_role("button", name="Soft shapes, no lines").click()
    page.get_by_role("slider", name="Frame to preview").fill("7")
    expect(page.locator(".scrubber output")).to_contain_text("Frame 8 of 12")
    page.reload()
    expect(page.locator(".stage.painted")).to_be_visible(timeout=SLOW_MS)
    expect(page.get_by_role("button", name="Soft shapes, no lines")).to_have_attribute("aria-pressed", "true")
    expect(page.locator(".scrubber output")).to_contain_text("Frame 8 of 12")
    submit(page)
    page.reload()
    expect(page.locator(".player")).to_be_visible()
    watched.check()


def test_the_fault_of_a_parameter_is_shown_beside_it(watched: Watched, service: str, clip: Path) -> None:
    page = watched.page
    enter_studio(page, service, clip)
    width = page.get_by_label("Region tolerance").last
    width.fill("7000")
    field = page.locator(".field", has=width)
    expect(field.locator(".field-error")).to_have_text("Enter a number from 4 to 60.")
    page.get_by_role("button", name="Paint the film").click()
    expect(width).to_be_focused()
    page.get_by_role("button", name="Reset Region tolerance").click()
    expect(width).to_have_value("20")
    expect(field.locator(".field-error")).to_be_empty()
    watched.check()


def test_a_file_that_is_no_video_is_refused_with_a_remedy(watched: Watched, service: str, tmp_path: Path) -> None:
    page = watched.page
    page.goto(service)
    fake = tmp_path / "holiday.mp4"
    fake.write_bytes(b"PK\x03\x04 this is not a video")
    page.set_input_files(".drop-large input[type=file]", fake)
    problem = page.get_by_role("alert")
    expect(problem).to_be_visible()
    expect(problem.locator(".remedy")).not_to_be_empty()
    expect(page.get_by_text("Drop a video here")).to_be_visible()


def test_an_interrupted_large_upload_resumes(watched: Watched, service: str, clip: Path, tmp_path: Path) -> None:
    page, padding = watched.page, 40 << 20
    large = tmp_path / "large.mp4"
    large.write_bytes(clip.read_bytes() + (padding + 8).to_bytes(4, "big") + b"free" + bytes(padding))
    offsets: list[int] = []

    def break_the_third(route: Route) -> None:
        if route.request.method == "PATCH":
            offsets.append(int(route.request.headers["upload-offset"]))
            if len(offsets) == 3:
                return route.abort("connectionreset")
        return route.continue_()

    page.route("**/v1/uploads/*", break_the_third)
    enter_studio(page, service, large)
    assert offsets[3] == offsets[2] > 0, "the broken piece alone was sent again"
    assert offsets == sorted(offsets)


def test_jobs_are_listed_retried_and_deleted(watched: Watched, service: str, clip: Path) -> None:
    page = watched.page
    enter_studio(page, service, clip)
    page.get_by_text("Film", exact=True).click()
    page.get_by_role("textbox", name="Name").fill("To be deleted")
    submit(page)
    page.get_by_role("link", name="Works").click()
    card = page.locator(".work", has_text="To be deleted")
    expect(card.locator("img")).to_be_visible()
    job = (card.locator(".work-link").get_attribute("href") or "").rpartition("/")[2]
    assert job
    card.get_by_role("button", name="Delete To be deleted").click()
    expect(card).to_be_hidden()
    page.get_by_role("button", name="Undo").click()
    expect(card).to_be_visible()
    card.get_by_role("button", name="Delete To be deleted").click()
    page.get_by_role("button", name="Close").click()
    page.reload()
    expect(page.locator(".works-page [aria-busy=false]")).to_be_visible()
    # The list requested at once may be older than the deletion, and show a picture that is gone; the next one is not.
    expect(card).to_have_count(0)
    watched.complaints = [complaint for complaint in watched.complaints if job not in complaint]
    watched.check()


def test_works_deleted_elsewhere_leave_the_list(watched: Watched, service: str, clip: Path, video: str) -> None:
    page = watched.page
    body = {"method": "abstraction", "inputs": {"video": video}, "name": "Deleted elsewhere"}
    job = HTTP.post(f"{service}/v1/jobs", json=body).json()["id"]
    until(page, lambda: HTTP.get(f"{service}/v1/jobs/{job}").json()["state"] == "succeeded")
    page.goto(f"{service}/#/jobs")
    card = page.locator(".work", has_text="Deleted elsewhere")
    expect(card.get_by_role("button", name="Delete Deleted elsewhere")).to_be_visible()
    until(page, lambda: card.locator("img").evaluate_all("(all) => all.length && all.every((one) => one.naturalWidth)"))
    HTTP.delete(f"{service}/v1/jobs/{job}").raise_for_status()
    expect(card).to_have_count(0)
    watched.check()


def test_a_phone_never_scrolls_sideways(phone: Watched, service: str, clip: Path) -> None:
    page = phone.page

    def check_width() -> None:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, page.url

    page.goto(service)
    check_width()
    enter_studio(page, service, clip)
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    check_width()
    submit(page)
    check_width()
    page.goto(f"{service}/#/jobs")
    expect(page.locator(".work img").first).to_be_visible()
    check_width()
    phone.check()


def test_the_page_asks_for_a_key_only_where_required(clip: Path, tmp_path: Path, watched: Watched) -> None:
    page = watched.page
    for address in serve(tmp_path / "home", AUTH="required", ADMIN_KEY=KEY):
        page.goto(address)
        page.get_by_label("API key").fill("wrong")
        page.get_by_role("button", name="Continue").click()
        expect(page.get_by_text("refused that key")).to_be_visible()
        page.get_by_label("API key").fill(KEY)
        page.get_by_role("button", name="Continue").click()
        enter_studio(page, address, clip)
        submit(page)
        until(page, lambda: now(page) > 0.2)
        assert page.evaluate("Object.keys(localStorage).length") == 0, "a key outlives no tab"
