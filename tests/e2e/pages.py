"""The service as a process, a page whose errors are recorded, and the clip of the tests in Chromium."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import av
import cv2
import httpx
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser, BrowserContext, Page, ViewportSize, expect

from service import bundle
from tests.ports import free_port
from tests.waiting import answers, pause_s

ROOT = Path(__file__).resolve().parents[2]
FRAMES, WIDTH, HEIGHT, FPS = 12, 96, 64, 12
CHROMIUM_ARGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run"]
SHELL = "chromium-headless-shell"
"""Chromium without windows and menus: the same engine, for two fifths of the CPU time."""
VIEWPORT: ViewportSize = {"width": 1440, "height": 900}
SLOW_MS = 60_000
"""The first painted frame may compile kernels; the film needs a moment on a busy machine."""
KEY = "a-key-for-this-test-only"
COLOURS_HAVE_CHANGED = """async () => {
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  await frame();
  await frame();
  const endless = ({ effect }) => effect.getComputedTiming().iterations === Infinity;
  await Promise.allSettled(document.getAnimations().filter((each) => !endless(each)).map((each) => each.finished));
  await frame();
}"""
"""Waits for the end of all transitions, which a stopped machine may begin late."""
CHECKS = 5
"""Number of axe runs; a finding counts only if every run reports it."""
RULES = {"light": "{}", "dark": "{runOnly: ['color-contrast', 'link-in-text-block']}"}
"""Options of axe: all rules in light; in dark those of colours, since nothing else differs."""


def make_clip(
    path: Path, codec: str = "libx264", size: tuple[int, int] = (WIDTH, HEIGHT), frames: int = FRAMES
) -> Path:
    """A disc that crosses a field."""
    width, height = size

    def draw(index: int) -> NDArray[np.uint8]:
        frame = np.full((height, width, 3), (90, 140, 70), np.uint8)
        at = (width * (5 + index) // (frames + 10), height // 2)
        cv2.circle(frame, at, height * 14 // 64, (220, 170, 40), -1)
        return frame

    return _encode(path, map(draw, range(frames)), codec)


def make_three_things(path: Path) -> Path:
    """Six frames, 96x64 px: a disc and a bar in front of a field."""
    frame = np.full((HEIGHT, WIDTH, 3), (90, 140, 70), np.uint8)
    cv2.circle(frame, (WIDTH // 4, HEIGHT // 2), 16, (220, 170, 40), -1)
    cv2.rectangle(frame, (WIDTH * 5 // 8, 8), (WIDTH * 7 // 8, HEIGHT - 9), (20, 30, 160), -1)
    return _encode(path, [frame] * 6)


def make_two_shots(path: Path, frames: int) -> Path:
    """Two shots of `frames` / 2 frames each, 96x64 px: a disc that crosses a field, then a bar on another one.

    A frame takes 0.1 ms; one of the synthetic scenes takes 20 ms.
    """

    def draw(index: int) -> NDArray[np.uint8]:
        x = index * WIDTH // frames
        frame = np.full((HEIGHT, WIDTH, 3), (90, 140, 70) if 2 * index < frames else (230, 225, 40), np.uint8)
        if 2 * index < frames:
            cv2.circle(frame, (x, HEIGHT // 2), 14, (220, 170, 40), -1)
        else:
            cv2.rectangle(frame, (x - 20, 10), (x - 5, 50), (20, 30, 160), -1)
        return frame

    return _encode(path, map(draw, range(frames)))


def _encode(path: Path, frames: Iterable[NDArray[np.uint8]], codec: str = "libx264") -> Path:
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=FPS)
        assert isinstance(stream, av.VideoStream)
        for index, frame in enumerate(frames):
            if index == 0:
                stream.height, stream.width = frame.shape[:2]
                stream.pix_fmt = "yuv420p"
            out.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        out.mux(stream.encode(None))
    return path


def serve(home: Path, **settings: str) -> Iterator[str]:
    """Run `impasto serve` with one worker until the test ends; its address. "PORT" in a setting becomes its port."""
    bundle.build()
    port, log = free_port(), home.with_suffix(".log")
    command = [sys.executable, "-m", "impasto", "serve", "--port", str(port), "--home", str(home), "--workers", "1"]
    env = os.environ | {f"IMPASTO_{name}": value.replace("PORT", str(port)) for name, value in settings.items()}
    with log.open("wb") as sink:
        server = subprocess.Popen(command, cwd=ROOT, stdout=sink, stderr=sink, env=env)
    try:
        address = f"http://127.0.0.1:{port}"
        wait_ready(address, server, log)
        yield address
    finally:
        server.terminate()
        server.wait(60)


def wait_ready(address: str, server: subprocess.Popen[bytes], log: Path) -> None:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and server.poll() is None:
        if answers(f"{address}/readyz"):
            return
        time.sleep(0.1)
    pytest.fail(f"the service did not start:\n{log.read_text()[-3000:]}")


class Watched:
    """A page of which every complaint and every request is noted.

    Attributes:
        complaints: errors and warnings of the console.
        hosts: of its requests.
        lost: whether it was closed, or its process has crashed.
    """

    def __init__(self, context: BrowserContext) -> None:
        self.page = context.new_page()
        self.complaints: list[str] = []
        self.hosts: set[str] = set()
        self.lost = False
        self.page.on("crash", self._lose)
        self.page.on("close", self._lose)
        self.page.on("pageerror", lambda error: self.complaints.append(f"uncaught: {error}"))
        self.page.on("console", self._hear)
        self.page.on("request", lambda request: self.hosts.add(httpx.URL(request.url).host))

    def _lose(self, _page: Page) -> None:
        self.lost = True

    def _hear(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.complaints.append(f"{message.type}: {message.text} {message.location}")

    def forget(self) -> None:
        """Forget what was noted so far."""
        self.complaints.clear()
        self.hosts.clear()

    def leave(self, address: str) -> None:
        """Go to the start page of the service, and undo what a test may have set."""
        self.page.unroute_all()
        self.page.context.set_offline(False)
        self.page.emulate_media(color_scheme="null", reduced_motion="reduce")
        self.page.set_viewport_size(VIEWPORT)
        self.page.goto(f"{address}/#/elsewhere")
        expect(self.page.locator(".home")).to_be_visible()
        self.page.evaluate("localStorage.clear(); sessionStorage.clear()")

    def check(self) -> None:
        """Check that there were no complaints and no requests to other hosts."""
        assert not self.complaints, "\n".join(self.complaints)
        assert self.hosts <= {"127.0.0.1", ""}, "blob: and data: addresses have no host"


def open_page(browser: Browser, **options: Any) -> Watched:
    """Open a page of the size `VIEWPORT` without animations, which would cost drawing time while a test waits."""
    given = {"viewport": VIEWPORT, "reduced_motion": "reduce"}
    context = browser.new_context(**(given | options))
    context.set_default_timeout(SLOW_MS)
    return Watched(context)


def until(page: Page, condition: Callable[[], bool], seconds: float = SLOW_MS / 1000) -> None:
    """Wait until `condition()`; the page's events are heard meanwhile.

    Playwright's own wait_for_function needs `eval`, which the page's policy forbids.
    """
    start = time.monotonic()
    while not condition():
        waited_s = time.monotonic() - start
        assert waited_s < seconds, "it never came true"
        page.wait_for_timeout(1000 * pause_s(waited_s))


def accessibility_faults(page: Page, axe: str) -> list[tuple[str, str, list[str]]]:
    """What axe-core finds in the page as it is, in light and dark: rule, help and elements.

    A finding counts if it is still there in each of `CHECKS` runs of axe, a second apart: on a busy machine colours
    may be on their way from one scheme to the other.

    Args:
        axe: the fixture of that name.
    """
    if not page.evaluate("typeof axe === 'object'"):
        page.evaluate(axe)
    faults = []
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        until(page, lambda: bool(page.evaluate(f"matchMedia('(prefers-color-scheme: {scheme})').matches")))  # noqa: B023
        for check in range(CHECKS):
            page.wait_for_timeout(300 if check == 0 else 1000)
            page.evaluate(COLOURS_HAVE_CHANGED)
            found = page.evaluate(f"async () => (await axe.run({RULES[scheme]})).violations")
            if not found:
                break
        faults += [
            (f"{fault['id']} ({scheme})", fault["help"], [node["html"][:160] for node in fault["nodes"]])
            for fault in found
        ]
    return faults
