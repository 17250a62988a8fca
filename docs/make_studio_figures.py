"""Takes the screenshots of docs/studio.md and docs/tutorials/shot.md in Chromium, with a clip of Impasto's own.

python -m docs.make_studio_figures

It needs Playwright, Chromium and about two minutes. Strokes are drawn by real pointer events.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import httpx
import numpy as np
from playwright.sync_api import Page, expect, sync_playwright

from docs.pictures import DOCS, save
from service import bundle

FOLDER = DOCS / "studio"
WIDTH, HEIGHT = 1280, 800
"""Width and height of the browser window, px."""
SLOW_MS = 180_000
SUN = (0.695, 0.41)
"""Position of the sun on the stage, as shares of the stage's width and height."""


@contextmanager
def service() -> Iterator[str]:
    """Start a service with an empty home; yields its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with tempfile.TemporaryDirectory() as home:
        words = ["serve", "--port", str(port), "--home", home, "--workers", "1"]
        server = subprocess.Popen([sys.executable, "-m", "impasto", *words], env=os.environ)
        try:
            yield _ready(f"http://127.0.0.1:{port}")
        finally:
            server.terminate()
            server.wait(60)


def _ready(address: str) -> str:
    for _ in range(600):
        try:
            if httpx.get(f"{address}/readyz").is_success:
                return address
        except httpx.TransportError:
            pass
        time.sleep(0.2)
    raise RuntimeError(f"no service at {address}")


def shoot(page: Page, name: str) -> Path:
    """Save the page as docs/studio/NAME.jpg."""
    page.wait_for_timeout(1200)
    shot = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR_RGB)
    assert shot is not None
    return save(np.asarray(shot, np.uint8), FOLDER / f"{name}.jpg")


def stroke(page: Page, radius: float) -> None:
    """Draw an arc around the sun."""
    box = page.locator(".stage-canvas").bounding_box()
    assert box is not None
    x, y = box["x"] + SUN[0] * box["width"], box["y"] + SUN[1] * box["height"]
    points = [
        (x + radius * box["height"] * np.cos(turn), y + radius * box["height"] * np.sin(turn))
        for turn in np.linspace(-2.6, 2.0, 24)
    ]
    page.mouse.move(*points[0])
    page.mouse.down()
    for point in points[1:]:
        page.mouse.move(*point, steps=2)
    page.mouse.up()


def painted_key(page: Page, address: str) -> None:
    """Take a screenshot of the first project with one painted key, and of the frames around it."""
    page.goto(address)
    shoot(page, "start")
    page.get_by_role("button", name="Learn painted keys in two minutes").click()
    page.get_by_role("button", name="Paint frame 11").click(timeout=SLOW_MS)
    page.get_by_label("Brush size").fill("12")
    for radius, colour in ((0.12, "#f2b632"), (0.17, "#e8743b")):
        page.locator(".brush-settings input[type=color]").fill(colour)
        stroke(page, radius)
    around = page.get_by_role("group", name="Frames painted from this key").get_by_role("button")
    expect(around).to_have_count(7, timeout=SLOW_MS)
    around.last.evaluate("element => element.scrollIntoView({ block: 'end' })")
    expect(page.locator(".save-status")).to_have_text("Saved", timeout=SLOW_MS)
    shoot(page, "key")


def library(page: Page) -> None:
    """Take a screenshot of the style library with a selected painting."""
    page.get_by_role("group", name="View").get_by_role("button", name="Compare").click()
    page.get_by_role("button", name="End the lesson").click()
    cards = page.get_by_role("group", name="Paintings of the library")
    expect(cards.locator("img")).to_have_count(6, timeout=SLOW_MS)
    cards.get_by_role("button", name="Swirling strokes").click()
    expect(page.locator(".slot-name").first).to_be_visible(timeout=SLOW_MS)
    page.locator(".style-library").evaluate("element => { element.open = true; }")
    page.get_by_role("slider", name="Frame", exact=True).press("End")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-result", "final", timeout=SLOW_MS)
    shoot(page, "library")


def film(page: Page) -> None:
    """Take screenshots of the first project's finished film and of the heat map of its flicker."""
    page.get_by_role("button", name="Paint the film").click()
    page.get_by_role("link", name="Page of the film").click()
    expect(page.get_by_role("button", name="Download")).to_be_visible(timeout=SLOW_MS)
    page.wait_for_timeout(2000)
    shoot(page, "film")


def flicker(page: Page, project: str) -> None:
    """Take a screenshot of the flicker view of the newest film."""
    page.goto(project)
    page.get_by_role("group", name="View").get_by_role("button", name="Flicker").click()
    page.get_by_role("button", name="Find the worst frames").click()
    worst = page.get_by_role("group", name="Frames with the most flicker").locator(".chip-button")
    expect(worst).to_have_count(3, timeout=SLOW_MS)
    expect(page.get_by_role("button", name="Find the worst frames")).to_be_enabled(timeout=SLOW_MS)
    worst.first.click()
    expect(page.get_by_role("status").filter(has_text="Flicker of this frame")).to_be_visible(timeout=SLOW_MS)
    shoot(page, "flicker")


def main() -> None:
    """Take all screenshots."""
    bundle.build()
    chromium = shutil.which("chromium")
    with service() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light")
        page.set_default_timeout(SLOW_MS)
        painted_key(page, address)
        project = page.url
        film(page)
        flicker(page, project)
        library(page)
        browser.close()


if __name__ == "__main__":
    main()
