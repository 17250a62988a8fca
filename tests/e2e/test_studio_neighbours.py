"""The frames around a painted key are repainted even before the key has been uploaded."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Page, Request, expect

from tests.e2e.pages import Watched, make_clip
from tests.e2e.studio import SOON_MS, draw, layer_of, open_project, saved, start_painting, stored
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

MIDDLES = """() => [...document.querySelectorAll(".neighbours canvas")].map((canvas) => [
  ...canvas.getContext("2d").getImageData(canvas.width / 2, 0.3 * canvas.height, 1, 1).data.slice(0, 3)])"""


def test_neighbours_follow_a_stroke_that_is_not_uploaded_yet(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy")
    start_painting(page)
    page.context.route("**/v1/assets", lambda route: route.abort())
    draw(page, (0.2, 0.3), (0.8, 0.3))
    group = page.get_by_role("group", name="Frames painted from this key")
    expect(group.get_by_role("button")).to_have_count(7, timeout=90_000)
    assert "keys" not in layer_of(stored(service, project))
    assert all(blue > 150 > red for red, _green, blue in page.evaluate(MIDDLES)), "each frame shows the blue stroke"
    page.context.unroute("**/v1/assets")
    saved(page)
    expect(page.get_by_role("button", name="Key at frame 5")).to_be_visible(timeout=SOON_MS)
    assert [key["frame"] for key in layer_of(stored(service, project))["keys"]] == [4]


def paint_wide_key(page: Page, service: str, folder: Path) -> None:
    """Paint a key at frame 3 of a video of 1000 px, which is larger than the stage's previews (at most 960 px)."""
    wide = make_clip(folder / "wide.mp4", size=(1000, 96), frames=9)
    video = HTTP.post(f"{service}/v1/assets", files={"file": (wide.name, wide.read_bytes())}).json()["id"]
    project = open_project(page, service, video, "analogy", frame=3)
    start_painting(page)
    box = page.locator(".stage-canvas").bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.3 * box["width"], middle)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], middle, steps=6)
    page.mouse.up()
    saved(page)
    assert [key["frame"] for key in layer_of(stored(service, project))["keys"]] == [3]


def test_a_frame_near_a_key_is_painted_at_full_size_when_one_rests_on_it(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    full: list[int] = []

    def record(request: Request) -> None:
        if request.url.endswith("/paint") and request.post_data_json["max_side_px"] == 1000:
            frame = request.post_data_json["frame"]
            full.extend([frame] if frame != 3 else [])  # the painting below the key at 3

    page.on("request", record)
    hint = page.locator(".stage-hint")
    paint_wide_key(page, service, tmp_path)
    page.keyboard.press("v")
    page.keyboard.press("End")
    expect(hint).to_have_text("Preview at 96 % of full size", timeout=90_000)
    page.wait_for_timeout(1500)
    assert full == [], "it is five frames away from the key"
    page.get_by_role("slider", name="Frame", exact=True).press("Home")
    expect(hint).to_have_text("Preview at 100 % of full size", timeout=90_000)
    assert set(full) == {0}


DECODE_LATE = """() => {
  const decode = window.createImageBitmap.bind(window);
  window.createImageBitmap = async (...words) => {
    const picture = await decode(...words);
    await new Promise((ready) => setTimeout(ready, 400));
    return picture;
  };
}"""


def test_a_small_preview_that_is_decoded_late_is_followed_by_one_at_full_size(
    fresh: Watched, service: str, tmp_path: Path
) -> None:
    page = fresh.page
    paint_wide_key(page, service, tmp_path)
    page.evaluate(DECODE_LATE)
    page.keyboard.press("v")
    expect(page.locator(".stage-hint")).to_have_text("Preview at 100 % of full size", timeout=60_000)


def test_the_stage_is_not_busy_after_a_return_from_an_unfinished_preview(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    open_project(page, service, video, "multistyle")
    hint, frame = page.locator(".stage-hint"), page.get_by_role("slider", name="Frame", exact=True)
    frame.press("Home")
    expect(page.locator(".stage-canvas[data-frame='0']")).to_be_visible()
    expect(hint).to_have_text("Preview at 100 % of full size", timeout=60_000)
    page.route("**/previews/paint", lambda route: None)
    frame.press("End")
    expect(hint).to_have_text("Painting this frame…")
    frame.press("Home")
    expect(hint).to_have_text("Preview at 100 % of full size")
    page.unroute("**/previews/paint")


COUNT_VIDEOS = """const make = document.createElement.bind(document);
window.videos = 0;
document.createElement = (name, ...rest) => { videos += name === "video"; return make(name, ...rest); };"""
STEPS = """() => {
  const press = () => new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true });
  for (let i = 0; i < 7; i++) document.body.dispatchEvent(press());
}"""


def test_frames_that_are_only_passed_with_the_brush_take_no_decoder(fresh: Watched, service: str, video: str) -> None:
    """Each decoder takes about 100 MB for 1080p: stepping through fifty keys took more than a gigabyte."""
    page = fresh.page
    page.add_init_script(COUNT_VIDEOS)
    project = open_project(page, service, video, "analogy")
    start_painting(page)
    page.evaluate(STEPS)
    expect(page.locator(".stage-canvas[data-frame='11'][data-exact='true']")).to_be_visible()
    draw(page, (0.2, 0.3), (0.8, 0.3))
    expect(page.get_by_role("button", name="Key at frame 12")).to_be_visible(timeout=SOON_MS)
    saved(page)
    assert [key["frame"] for key in layer_of(stored(service, project))["keys"]] == [11]
    assert page.evaluate("videos") <= 2, "the stage's own, and one for a frame that the stage has left"
