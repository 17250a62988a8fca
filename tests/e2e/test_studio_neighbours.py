"""The frames around a painted key: repainted while the key itself is still to be uploaded."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.e2e.pages import Watched
from tests.e2e.studio import SOON_MS, draw, layer_of, open_project, saved, start_painting, stored

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


COUNT_VIDEOS = """const make = document.createElement.bind(document);
window.videos = 0;
document.createElement = (name, ...rest) => { videos += name === "video"; return make(name, ...rest); };"""
STEPS = """() => {
  const press = () => new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true });
  for (let i = 0; i < 7; i++) document.body.dispatchEvent(press());
}"""


def test_frames_that_are_only_passed_with_the_brush_take_no_decoder(watched: Watched, service: str, video: str) -> None:
    """Each decoder takes some 100 MB for 1080p: going through fifty keys took more than a gigabyte."""
    page = watched.page
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
