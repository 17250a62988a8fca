"""Response times of the studio: real Chromium, real pointer events, a real service on the same machine.

    python -m benchmarks.studio                   everything
    python -m benchmarks.studio drop change pen   some: drop, change, pen, ink, scrub, open

Each row shows the median, the 95th percentile (with few repetitions, nearly the maximum) and the goal. Times are
measured with the page's clock, from the time stamp of the user's event until the picture is decoded; the stage draws it
at the next refresh.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np
from playwright.sync_api import Browser, Page

from benchmarks import studio_page as studio
from benchmarks.clips import MEDIA
from benchmarks.loops import looped
from pipeline.errors import ImpastoError

HD, FULL_HD, SMALL = (1280, 720), (1920, 1080), (640, 480)
PROXY_PX = 480
"""Longest side of the pictures of frames near a key."""
NEIGHBOURS = 6
DROPS, CHANGES, STROKES, OPENINGS = 5, 20, 30, 5
SCRUB_S, SCRUB_FPS = 6.0, 24
LONG_S, KEYS = 600, 50


@dataclass(frozen=True)
class Row:
    """Measurements of one quantity in one unit, and its goal in words."""

    title: str
    values: Sequence[float]
    unit: str
    goal: str

    def __str__(self) -> str:
        if not len(self.values):
            return f"| {self.title} | - | - | {self.goal} |"
        middle, high = np.median(self.values), np.percentile(self.values, 95)
        return (
            f"| {self.title} ({len(self.values)}) | {middle:.0f} {self.unit} | {high:.0f} {self.unit} | {self.goal} |"
        )


def drop(browser: Browser, address: str, folder: Path) -> list[Row]:
    """Time from the choice of a file to its first painted picture. The first run also loads the kernels."""
    video = studio.written(folder / "drop.mp4", HD, 72)
    found = []
    for _ in range(DROPS):
        with studio.opened(browser) as page:
            page.goto(address)
            page.locator(".drop-large").wait_for()
            page.locator("input[type=file]").first.set_input_files(video)
            painted = studio.wait_probed(page, "painted")
            found.append(painted[0] - studio.probed(page, "inputs")[0])
    return [Row("Drop to the first painted preview: 720p, abstraction; first time", found[:1], "ms", "2000 ms"),
            Row("the same, later", found[1:], "ms", "2000 ms")]  # fmt: skip


MOVE_SLIDER = """share => {
  const slider = [...document.querySelectorAll(".form .group-body input[type=range]")][0];
  slider.value = String(share);
  slider.dispatchEvent(new Event("input", { bubbles: true }));
}"""


def change(browser: Browser, address: str, folder: Path) -> list[Row]:
    """Time from a change of a slider to the picture painted with it, on the first page and in the studio."""
    video = studio.upload(address, "change.mp4", studio.written(folder / "change.mp4", SMALL, 48).read_bytes())
    with studio.opened(browser) as page:
        page.goto(f"{address}/#/?method=multistyle&video={video}")
        studio.wait(lambda: studio.probed(page, "painted"), page)
        quick = [_changed(page, i, lambda: list(studio.probed(page, "painted"))) for i in range(CHANGES)]
    with studio.opened(browser) as page:
        page.goto(studio.project(address, video, "multistyle"))
        studio.wait(lambda: _bitmaps(page, 640), page)
        first, final = [], []
        for i in range(CHANGES):
            final.append(_changed(page, i, lambda: _bitmaps(page, 640)))
            first.append(studio.probed(page, "bitmaps")[0][0] - studio.probed(page, "inputs")[0])
    return [Row("Parameter to preview: multistyle, 640 px, first page", quick, "ms", "500 ms"),
            Row("the same in the studio: first picture, coarse or not", first, "ms", "500 ms"),
            Row("the same in the studio: final picture", final, "ms", "500 ms")]  # fmt: skip


def _changed(page: Page, number: int, times: Callable[[], list[float]]) -> float:
    page.wait_for_timeout(700)
    studio.clear(page)
    page.evaluate(MOVE_SLIDER, 0.3 + 0.4 * ((number * 7) % CHANGES) / CHANGES)
    studio.wait(lambda: bool(times()), page)
    return times()[0] - float(studio.probed(page, "inputs")[0])


def _bitmaps(page: Page, side_px: int) -> list[float]:
    return [at for at, side in studio.probed(page, "bitmaps") if side == side_px]


def pen(browser: Browser, address: str, folder: Path) -> list[Row]:
    """Time from the end of a stroke on a key to its repainted neighbours, and tasks that block the page meanwhile."""
    video = studio.upload(address, "pen.mp4", studio.written(folder / "pen.mp4", HD, 48).read_bytes())
    rng = np.random.default_rng(1)
    nearest, all_, tasks = [], [], []
    with studio.opened(browser) as page:
        page.goto(studio.project(address, video, "analogy"))
        page.locator(".stage-canvas[data-frame='16']").wait_for()
        page.get_by_role("button", name="Brush", exact=True).click()
        page.wait_for_timeout(5000)
        for number in range(STROKES + 1):
            studio.clear(page)
            _stroke(page, rng)
            studio.wait(lambda: len(_neighbours(page)) > NEIGHBOURS, page)
            if number:  # the first one waits for the motion of the shot
                nearest.append(_neighbours(page)[2])
                all_.append(_neighbours(page)[NEIGHBOURS])
            page.wait_for_timeout(int(rng.integers(300, 900)))
            tasks += [duration for _, duration in studio.probed(page, "tasks")]
    return [Row("Pen rest to the two nearest frames: 720p, proxy", nearest, "ms", "300 ms, 95 %: 1000 ms"),
            Row(f"Pen rest to all {NEIGHBOURS} frames", all_, "ms", "300 ms, 95 %: 1000 ms"),
            Row("Tasks of more than 50 ms while drawing", tasks, "ms", "none")]  # fmt: skip


def _stroke(page: Page, rng: np.random.Generator) -> None:
    points = 0.1 + 0.8 * rng.random((2, 2))
    page.mouse.move(*studio.on_stage(page, HD, *points[0]))
    page.mouse.down()
    for share in np.linspace(0, 1, 20)[1:]:
        page.mouse.move(*studio.on_stage(page, HD, *(points[0] + share * (points[1] - points[0]))))
    page.mouse.up()


def _neighbours(page: Page) -> list[float]:
    """Times of the key's own picture and then of its neighbours, nearest first, ms after the pen was lifted."""
    ups = studio.probed(page, "ups")
    return [at - ups[-1] for at in _bitmaps(page, PROXY_PX) if ups and at > ups[-1]]


INKED = """() => {
  window.inked = [];
  let oldest = 0;
  const channel = new MessageChannel();
  channel.port1.onmessage = () => {
    inked.push(performance.now() - oldest);
    oldest = 0;
  };
  addEventListener("pointermove", (event) => {
    if (!event.buttons || oldest) return;
    oldest = (event.getCoalescedEvents()[0] ?? event).timeStamp;
    requestAnimationFrame(() => channel.port2.postMessage(0));
  }, true);
}"""
"""Records, for each frame in which the pen has moved, ms from the oldest event to the end of the frame's drawing."""


def ink(browser: Browser, address: str, folder: Path) -> list[Row]:
    """Time from a movement of the pen until the page has drawn it, at 1080p with a textured brush, 120 events a second.
    The screen shows it at its next refresh, which is not counted."""
    video = studio.upload(address, "ink.mp4", studio.written(folder / "ink.mp4", FULL_HD, 24).read_bytes())
    with studio.opened(browser) as page:
        page.goto(studio.project(address, video, "analogy"))
        page.locator(".stage-canvas[data-frame]").wait_for()
        page.get_by_role("button", name="Brush", exact=True).click()
        page.get_by_role("button", name="Brush:").click()
        page.get_by_role("list", name="Brushes").get_by_role("button", name="Pastel", exact=True).click()
        page.get_by_role("button", name="Close the drawing panel").click()
        page.get_by_label("Brush size").fill("48")
        page.wait_for_timeout(3000)
        page.evaluate(INKED)
        studio.clear(page)
        pen_down = page.context.new_cdp_session(page)
        for number in range(STROKES // 3):
            for step in range(90):
                x, y = studio.on_stage(
                    page, FULL_HD, 0.1 + 0.8 * step / 90, 0.1 + 0.08 * number + 0.02 * np.sin(step / 5)
                )
                kind = "mouseMoved" if step else "mousePressed"
                event = {"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "pointerType": "pen"}
                pen_down.send("Input.dispatchMouseEvent", event | {"force": 0.3 + 0.6 * step / 90})
                page.wait_for_timeout(1000 / 120)
            pen_down.send("Input.dispatchMouseEvent", event | {"type": "mouseReleased", "force": 0})
            page.wait_for_timeout(1500)
        shown = page.evaluate("inked")
        tasks = [duration for _, duration in studio.probed(page, "tasks")]
    return [Row("Pen event to drawn pixels: 1080p, pastel of 48 px", shown, "ms", "95 %: 20 ms"),
            Row("Tasks of more than 50 ms meanwhile", tasks, "ms", "none")]  # fmt: skip


def scrub(browser: Browser, address: str, folder: Path) -> list[Row]:
    """Frames drawn per second while the playhead is dragged over 720p video at 24 frames a second, both ways."""
    frames = 240
    video = studio.upload(address, "scrub.mp4", studio.written(folder / "scrub.mp4", HD, frames).read_bytes())
    rows = []
    with studio.opened(browser) as page:
        page.goto(studio.project(address, video, "abstraction"))
        page.locator(".stage-canvas[data-frame='80']").wait_for()
        page.get_by_role("button", name="Original").click()
        box = page.locator(".strip").bounding_box()
        assert box is not None
        for title, start, step in (("forwards", 60, 1), ("backwards", 204, -1)):
            page.mouse.move(box["x"] + (start + 0.5) * box["width"] / frames, box["y"] + 20)
            page.mouse.down()
            page.wait_for_timeout(1500)
            studio.clear(page)
            began = page.evaluate("performance.now()")
            for number in range(int(SCRUB_S * SCRUB_FPS)):
                page.mouse.move(box["x"] + (start + step * number + 0.5) * box["width"] / frames, box["y"] + 20)
                left = began + 1000 * (number + 1) / SCRUB_FPS - page.evaluate("performance.now()")
                page.wait_for_timeout(max(0, left))
            page.mouse.up()
            shown = np.array([at for at, _ in studio.probed(page, "frames")]) - began
            seconds = [float(((shown >= 1000 * s) & (shown < 1000 * (s + 1))).sum()) for s in range(int(SCRUB_S))]
            rows.append(Row(f"Scrubbing 720p {title}: frames in a second", seconds, "", "24"))
    return rows


def open_(browser: Browser, address: str, folder: Path) -> list[Row]:
    """Time to open a project of ten minutes in 1080p with fifty painted keys, and the memory of its page."""
    short = MEDIA / "street_pan_1080p.mp4"
    source = short if short.is_file() else studio.written(folder / "short.mp4", FULL_HD, 48)
    film = looped(source, 25 * LONG_S, folder / "long.mp4")
    video = studio.upload(address, film.name, film.read_bytes())
    frames = int(httpx.get(f"{address}/v1/assets/{video}").json()["info"]["frames"])
    stroke = {"kind": "brush", "color": "#204080", "size": 24, "opacity": 1}
    strokes = [stroke | {"samples": [[i, (i * k) % 1080, 0.5] for i in range(0, 1920, 4)]} for k in range(1, 11)]
    data = json.dumps({"version": 1, "strokes": strokes}).encode()
    assets = {"strokes": {"id": studio.upload(address, "strokes.json", data)}}
    keys = []
    for number in range(KEYS):
        assets[f"key-{number}"] = {"id": studio.upload(address, f"{number}.png", studio.painting(FULL_HD, number))}
        layers = [{"id": "frame", "name": "Video frame"}, {"id": "paint", "name": "Paint", "strokes": "strokes"}]
        at = (number + 1) * frames // (KEYS + 2)
        keys.append({"frame": at, "image": f"key-{number}", "paint": {"layers": layers}})
    place = studio.project(address, video, "analogy", assets, keys=keys)
    took, memory = [], []
    for _ in range(OPENINGS):
        with studio.opened(browser) as page:
            page.goto(place)
            page.locator(".stage-canvas[data-frame]").wait_for()
            page.locator(".key-mark").nth(KEYS - 1).wait_for()
            took.append(studio.wait_probed(page, "frames")[0][0])
            page.wait_for_timeout(3000)
            memory.append(studio.renderer_mib())
    return [Row("Ten minutes of 1080p with 50 keys: open", took, "ms", "3000 ms"),
            Row("Memory of that page", memory, "MiB", "1000 MiB"),
            Row("Memory while all keys are opened", [_all_opened(browser, place)], "MiB", "1000 MiB")]  # fmt: skip


def _all_opened(browser: Browser, place: str) -> float:
    """Peak memory of the page while every key is opened for painting, one after the other, MiB."""
    with studio.opened(browser) as page:
        page.goto(place)
        page.locator(".key-mark").nth(KEYS - 1).wait_for()
        page.get_by_role("button", name="Brush", exact=True).click()
        most = 0.0
        for number in range(KEYS):
            page.locator(".key-mark").nth(number).evaluate("mark => mark.click()")
            page.wait_for_timeout(500)
            most = max(most, studio.renderer_mib())
        return most


PARTS = {"drop": drop, "change": change, "pen": pen, "ink": ink, "scrub": scrub, "open": open_}


def main(names: Sequence[str] = ()) -> None:
    """Print the table."""
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} at the start\n")
    print("| | median | 95th percentile | goal |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="impasto-studio-") as name, studio.chromium() as browser:
        folder = Path(name)
        with studio.service(folder) as address:
            for part in names or PARTS:
                for row in PARTS[part](browser, address, folder):
                    print(row, flush=True)
    print(f"\nload {os.getloadavg()[0]:.1f} at the end")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (ImpastoError, TimeoutError) as error:
        sys.exit(str(error))
