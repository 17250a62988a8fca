"""Pointers in the studio: only the left button, a pen and single fingers draw; drags on the filmstrip always scrub."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, CDPSession, Page, expect

from tests.e2e.pages import Watched, make_clip, open_page, until
from tests.e2e.studio import SOON_MS, draw_with_pen, layer_of, on_stage, open_project, saved, start_painting, stored
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]


@pytest.fixture
def tablet(browser: Browser) -> Iterator[Watched]:
    watched = open_page(browser, viewport={"width": 1024, "height": 768}, has_touch=True)
    yield watched
    watched.page.context.close()


def touch(session: CDPSession, kind: str, *points: tuple[float, float]) -> None:
    places = [{"x": x, "y": y, "id": number, "radiusX": 8, "radiusY": 8} for number, (x, y) in enumerate(points)]
    session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})


def keys_of(page: Page, service: str, project: str) -> list[Any]:
    """The stored keys, once everything is saved that was drawn."""
    page.wait_for_timeout(900)  # a key is uploaded 600 ms after its last stroke
    saved(page)
    found: list[Any] = layer_of(stored(service, project)).get("keys") or []
    return found


def test_the_right_button_and_the_barrel_button_do_not_paint(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    for kind in ("mouse", "pen"):
        session = page.context.new_cdp_session(page)
        for step, name in enumerate(("mousePressed", "mouseMoved", "mouseReleased")):
            x, y = on_stage(page, 0.2 + 0.2 * step, 0.3)
            event = {"type": name, "x": x, "y": y, "button": "right", "buttons": 2, "pointerType": kind, "force": 0.5}
            session.send("Input.dispatchMouseEvent", event)
    assert keys_of(page, service, project) == []


def test_two_fingers_zoom_and_leave_no_paint(tablet: Watched, service: str, video: str) -> None:
    page = tablet.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    session = page.context.new_cdp_session(page)
    a, b, wide, wider = (on_stage(page, x, 0.5) for x in (0.4, 0.6, 0.3, 0.75))
    touch(session, "touchStart", a)  # a pinch, whose fingers arrive one after the other
    touch(session, "touchStart", a, b)
    touch(session, "touchMove", wide, wider)
    touch(session, "touchEnd")
    touch(session, "touchStart", a, b)  # a tap with two fingers
    touch(session, "touchEnd")
    touch(session, "touchStart", a)  # the first finger had moved already
    touch(session, "touchMove", wide)
    touch(session, "touchStart", wide, b)
    touch(session, "touchEnd")
    assert keys_of(page, service, project) == []
    touch(session, "touchStart", a)
    touch(session, "touchMove", wide)
    touch(session, "touchEnd")
    assert len(keys_of(page, service, project)) == 1, "one finger paints"


def test_a_palm_paints_nothing_while_and_after_a_pen_draws(tablet: Watched, service: str, video: str) -> None:
    page = tablet.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    draw_with_pen(page, [(0.3 + 0.05 * step, 0.4, 0.6) for step in range(6)])
    (before,) = keys_of(page, service, project)
    session = page.context.new_cdp_session(page)
    palm = [on_stage(page, x, 0.8) for x in (0.5, 0.6, 0.7)]
    for place in palm:
        touch(session, "touchStart", place)
        touch(session, "touchMove", (place[0] + 25, place[1]))
        touch(session, "touchEnd")
    assert keys_of(page, service, project) == [before]


@pytest.mark.parametrize("button", ["Pan", "Brush"])
def test_every_drag_on_the_filmstrip_scrubs(watched: Watched, service: str, tmp_path: Path, button: str) -> None:
    page = watched.page
    clip = make_clip(tmp_path / "long.mp4", frames=60)
    video = HTTP.post(f"{service}/v1/assets", files={"file": (clip.name, clip.read_bytes())}).json()["id"]
    open_project(page, service, video, "analogy", frame=20)
    if button == "Brush":
        start_painting(page)
    strip = page.get_by_role("slider", name="Frame", exact=True)
    box = strip.bounding_box()
    assert box is not None
    expect(strip.locator("img").first).to_be_visible(timeout=SOON_MS)
    for drag in range(11):
        start, stop = (0.108, 0.908) if drag % 2 == 0 else (0.908, 0.108)
        page.mouse.move(box["x"] + start * box["width"], box["y"] + 30)
        page.mouse.down()
        page.mouse.move(box["x"] + stop * box["width"], box["y"] + 30 + drag, steps=12)
        page.mouse.up()
        wanted = str(int(stop * 60) + 1)
        until(page, lambda: strip.get_attribute("aria-valuenow") == wanted)  # noqa: B023 (called at once)
        assert page.evaluate("getSelection().toString()") == ""
