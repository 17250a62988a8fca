"""All shots of a film are played over the stage, in order and in a loop; dragging along them is heard."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.e2e.pages import FPS, Watched, accessibility_faults, make_two_shots, until
from tests.e2e.studio import FILM_MS, SOON_MS, saved
from tests.e2e.test_studio_whole_film import with_tone
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]

TONE_HZ = 660
NOTE_FRAMES = """() => {
  window.seen = [];
  const look = () => {
    const canvas = document.querySelector(".film-screen canvas");
    const { shot, frame, painted } = canvas?.dataset ?? {};
    const last = window.seen.at(-1);
    const now = shot === undefined ? null : [Number(shot), Number(frame), painted === "true"];
    if (String(last) !== String(now)) window.seen.push(now);
    requestAnimationFrame(look);
  };
  look();
}"""
NOTE_TIMES = """() => {
  window.times = [];
  const look = (now) => {
    const { shot, frame } = document.querySelector(".film-screen canvas")?.dataset ?? {};
    if (shot !== undefined && String(window.times.at(-1)?.slice(0, 2)) !== String([shot, frame]))
      window.times.push([shot, frame, now]);
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
}"""
NOTE_SOUND = """
  window.heard = [];
  const start = AudioBufferSourceNode.prototype.start;
  AudioBufferSourceNode.prototype.start = function (when, offset, length) {
    const samples = this.buffer.getChannelData(0);
    const from = Math.round(offset * this.buffer.sampleRate);
    const piece = samples.slice(from, from + Math.round(length * this.buffer.sampleRate));
    let crossings = 0;
    for (let i = 1; i < piece.length; i++) crossings += piece[i - 1] < 0 && piece[i] >= 0;
    window.heard.push([offset, crossings / length]);
    return start.call(this, when, offset, length);
  };
"""


def open_film(page: Page, service: str, folder: Path, ranges: list[tuple[int, int]]) -> str:
    """Open a film with a shot for each of these ranges of a clip of 40 frames; the project's id."""
    data = with_tone(make_two_shots(folder / "two.mp4", 40), TONE_HZ).read_bytes()
    clip = HTTP.post(f"{service}/v1/assets", files={"file": ("two.mp4", data)}).json()["id"]
    shots = [
        {"id": f"s{i}", "video": "clip", "range": frames, "layers": [{"id": f"l{i}", "method": "abstraction"}]}
        for i, frames in enumerate(ranges, start=1)
    ]
    document = {"schema": 2, "name": "Film", "assets": {"clip": {"id": clip}}, "shots": shots}
    project = str(HTTP.post(f"{service}/v1/projects", json={"name": "Film", "document": document}).json()["id"])
    page.goto(f"{service}/#/projects/{project}")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-exact", "true", timeout=SOON_MS)
    return project


def screen(page: Page) -> Locator:
    return page.get_by_role("img", name="The film", exact=True)


def seen(page: Page) -> list[tuple[int, int, bool]]:
    """(shot from 1, frame of its clip, whether painted) of everything that the film has shown, in order."""
    return [(shot, frame, painted) for shot, frame, painted in page.evaluate("window.seen.filter((one) => one)")]


def on_film(page: Page, second: float, length_s: float) -> tuple[float, float]:
    box = page.get_by_role("slider", name="Film", exact=True).bounding_box()
    assert box is not None
    return box["x"] + box["width"] * second / length_s, box["y"] + box["height"] / 2


def test_all_shots_are_played_from_in_to_out_point_and_what_is_not_painted_is_said(
    watched: Watched, service: str, tmp_path: Path, axe: str
) -> None:
    page = watched.page
    ranges = [(2, 11), (25, 32), (12, 20)]
    project = open_film(page, service, tmp_path, ranges)
    HTTP.post(f"{service}/v1/projects/{project}/jobs", json={"shots": ["s2"]}).raise_for_status()
    expect(page.locator(".film-piece[data-painted=true]")).to_have_count(0)
    page.reload()
    until(
        page,
        lambda: all(
            one["job"]["state"] == "succeeded"
            for one in HTTP.get(f"{service}/v1/projects/{project}/jobs").json()["items"]
        ),
    )
    page.reload()
    expect(page.locator(".film-piece[data-painted=true]")).to_have_count(1, timeout=FILM_MS)
    assert accessibility_faults(page, axe) == []
    page.emulate_media(color_scheme="light")
    page.evaluate(NOTE_FRAMES)
    page.get_by_role("slider", name="Film", exact=True).press("Home")
    page.keyboard.press("Shift+Space")
    told = page.locator(".film-screen p")
    expect(told).to_contain_text("Shot 1 of 3: not painted as it is now, this is its video", timeout=SOON_MS)
    expect(told).to_contain_text("Shot 2 of 3: painted", timeout=SOON_MS)
    expect(screen(page)).to_be_hidden(timeout=SOON_MS)
    shown = seen(page)
    assert [shot for shot, *_ in shown] == sorted(shot for shot, *_ in shown), "in order"
    for number, (first, end) in enumerate(ranges, start=1):
        frames = [frame for shot, frame, _ in shown if shot == number]
        assert set(frames) <= set(range(first, end)), (number, frames)
        assert frames == sorted(frames)
        assert frames, f"shot {number} is shown"
    assert {painted for shot, _, painted in shown if shot == 2} == {True}
    assert {painted for shot, _, painted in shown if shot != 2} == {False}
    expect(page.locator(".shot-card[aria-selected=true]")).to_contain_text("3.")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "19", timeout=SOON_MS)

    page.evaluate("() => { window.seen = []; }")
    page.get_by_role("group", name="View").get_by_role("button", name="Original").click()
    page.get_by_role("slider", name="Film", exact=True).press("Home")
    page.get_by_role("button", name="Play all shots").click()
    expect(told).to_contain_text("Shot 2 of 3: the original video", timeout=SOON_MS)
    page.keyboard.press("Escape")
    expect(screen(page)).to_be_hidden()
    expect(page.locator(".shot-card[aria-selected=true]")).not_to_contain_text("1.")
    watched.check()


def test_many_shots_keep_the_time_of_the_film_while_the_machine_is_busy(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    length = 16
    open_film(page, service, tmp_path, [(4 * k, 4 * k + length) for k in range(6)])
    page.evaluate(NOTE_TIMES)
    throttle = page.context.new_cdp_session(page)
    throttle.send("Emulation.setCPUThrottlingRate", {"rate": 4})
    page.get_by_role("slider", name="Film", exact=True).press("Home")
    page.keyboard.press("Shift+Space")
    expect(screen(page)).to_be_visible(timeout=SOON_MS)
    expect(screen(page)).to_be_hidden(timeout=SOON_MS)
    throttle.send("Emulation.setCPUThrottlingRate", {"rate": 1})
    times = [(int(shot) - 1, int(frame), now / 1000) for shot, frame, now in page.evaluate("window.times")]
    film = [(shot * length + frame - 4 * shot, now) for shot, frame, now in times]
    assert {shot for shot, *_ in times} == set(range(6))
    began, ended = next(one for one in film if one[0] > 0), film[-1]
    late = (ended[1] - began[1]) * FPS - (ended[0] - began[0])
    assert abs(late) < 4, f"{late:.1f} frames late at the end of six shots"
    watched.check()


def test_a_range_across_shots_is_played_again_and_again(watched: Watched, service: str, tmp_path: Path) -> None:
    page = watched.page
    open_film(page, service, tmp_path, [(0, 12), (20, 32), (2, 6)])
    track = page.get_by_role("slider", name="Film", exact=True)
    track.press("Home")
    for _ in range(8):
        track.press("ArrowRight")
    expect(page.locator(".film-bar output")).to_contain_text("0:00.7 of")
    page.get_by_role("button", name="Loop from this frame").click()
    for _ in range(7):
        track.press("ArrowRight")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "23", timeout=SOON_MS)
    page.get_by_role("button", name="Loop to this frame").click()
    page.evaluate(NOTE_FRAMES)
    page.keyboard.press("Shift+Space")
    until(page, lambda: [shot for shot, *_ in seen(page)].count(1) > 0 and _passes(seen(page)) >= 2)
    page.keyboard.press("Shift+Space")
    shown = {(shot, frame) for shot, frame, _ in seen(page)}
    assert shown <= {(1, frame) for frame in range(8, 12)} | {(2, frame) for frame in range(20, 24)}, shown
    page.get_by_role("button", name="Loop the whole film").click()
    expect(page.locator(".film-range")).to_have_count(0)
    watched.check()


def _passes(shown: list[tuple[int, int, bool]]) -> int:
    return sum(later[0] < earlier[0] for earlier, later in pairwise(shown))


def test_dragging_along_the_film_and_the_filmstrip_is_heard_where_the_pointer_is(
    fresh: Watched, service: str, tmp_path: Path
) -> None:
    page = fresh.page
    page.add_init_script(NOTE_SOUND)
    open_film(page, service, tmp_path, [(0, 12), (20, 32)])
    x, y = on_film(page, 0.3, 2.0)
    page.mouse.move(x, y)
    page.mouse.down()
    expect(screen(page)).to_be_visible()
    heard: list[Any] = []
    for second in (0.5, 0.8, 1.3, 1.5):
        page.mouse.move(*on_film(page, second, 2.0))
        until(page, lambda before=len(heard): len(page.evaluate("window.heard")) > before)
        heard = page.evaluate("window.heard")
    page.mouse.up()
    offsets = [offset for offset, _ in heard]
    assert any(abs(offset - 0.5) < 2 / FPS for offset in offsets), offsets
    assert any(abs(offset - (20 / FPS + 0.5)) < 2 / FPS for offset in offsets), "the second shot has frames 20 to 31"
    assert all(rate == pytest.approx(TONE_HZ, rel=0.05) for _, rate in heard), heard
    expect(screen(page)).to_be_hidden()
    expect(page.locator(".shot-card[aria-selected=true]")).to_contain_text("2.")

    page.get_by_role("button", name="Sound off").click()
    before = len(page.evaluate("window.heard"))
    box = page.locator(".strip").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 20, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 20, steps=5)
    page.mouse.up()
    assert len(page.evaluate("window.heard")) == before, "sound is off"
    page.get_by_role("button", name="Sound on").click()
    page.mouse.move(box["x"] + 20, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 700, box["y"] + 20, steps=5)
    page.mouse.up()
    until(page, lambda: len(page.evaluate("window.heard")) > before)
    saved(page)
    fresh.check()
