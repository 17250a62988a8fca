"""The service and Chromium for `benchmarks.studio`: probes in the page, pointer input, clips and projects."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import av
import cv2
import httpx
import numpy as np
import psutil
from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.clips import clip
from service import bundle

ARGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run"]
STAGE_MARGIN_PX = 12
WAIT_S = 60.0
Document = dict[str, Any]
Size = tuple[int, int]

PROBE = """
window.probe = { bitmaps: [], ups: [], inputs: [], tasks: [], frames: [], painted: [] };
const make = window.createImageBitmap.bind(window);
window.createImageBitmap = async (...given) => {
  const made = await make(...given);
  probe.bitmaps.push([performance.now(), Math.max(made.width, made.height)]);
  return made;
};
addEventListener("pointerup", (event) => probe.ups.push(event.timeStamp), true);
for (const kind of ["input", "change"]) addEventListener(kind, (event) => probe.inputs.push(event.timeStamp), true);
document.addEventListener("load", ({ target }) => {
  if (target.alt === "The frame, painted") probe.painted.push(performance.now());
}, true);
new PerformanceObserver((list) => {
  for (const entry of list.getEntries()) probe.tasks.push([entry.startTime, entry.duration]);
}).observe({ type: "longtask", buffered: true });
new MutationObserver((changes) => {
  for (const { target } of changes) {
    const frame = Number(target.dataset.frame);
    if (probe.frames.at(-1)?.[1] !== frame) probe.frames.push([performance.now(), frame]);
  }
}).observe(document, { subtree: true, attributes: true, attributeFilter: ["data-frame"] });
"""
"""A script that runs before the page's own. It records times of the page's clock, ms: decoded pictures with their
longer side, the end of pen strokes, form input, main thread tasks of more than 50 ms, and frames that the stage has
drawn."""


@contextmanager
def service(folder: Path) -> Iterator[str]:
    """Run `impasto serve` with one worker, as a user does; yields its address."""
    bundle.build()
    command = [
        sys.executable,
        "-m",
        "impasto",
        "serve",
        "--port",
        "0",
        "--home",
        str(folder / "home"),
        "--workers",
        "1",
    ]
    log = (folder / "serve.log").open("wb")
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, env=dict(os.environ)) as process:
        assert process.stdout is not None
        try:
            address = f"http://127.0.0.1:{int(process.stdout.readline().rpartition(':')[2])}"
            wait(lambda: httpx.get(f"{address}/readyz").status_code == 200)
            yield address
        finally:
            process.terminate()


@contextmanager
def chromium() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        program = shutil.which("chromium-headless-shell") or shutil.which("chromium")
        browser = playwright.chromium.launch(executable_path=program, args=ARGS)
        yield browser
        browser.close()


@contextmanager
def opened(browser: Browser) -> Iterator[Page]:
    """A page that runs the script `PROBE`."""
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    context.set_default_timeout(1000 * WAIT_S)
    context.add_init_script(PROBE)
    yield context.new_page()
    context.close()


def wait(condition: Callable[[], object], page: Page | None = None, seconds: float = WAIT_S) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("The expected condition was not met in time.")
        page.wait_for_timeout(15) if page else time.sleep(0.05)


def probed(page: Page, name: str) -> Any:
    return page.evaluate(f"probe.{name}")


def wait_probed(page: Page, name: str) -> Any:
    """Wait until the probe has a result, and return it."""
    wait(lambda: probed(page, name), page)
    return probed(page, name)


def clear(page: Page) -> None:
    page.evaluate("for (const list of Object.values(probe)) list.length = 0")


def renderer_mib() -> float:
    """Resident memory of the largest renderer process of Chromium, MiB."""
    children = psutil.Process().children(recursive=True)
    sizes = [child.memory_info().rss for child in children if "--type=renderer" in " ".join(child.cmdline())]
    return max(sizes, default=0) / 2**20


def on_stage(page: Page, size: Size, x: float, y: float) -> tuple[float, float]:
    """Screen position of a point of the fitted picture; (x, y) are fractions of its width and height."""
    box = page.locator(".stage-canvas").bounding_box()
    assert box is not None
    width, height = size
    scale = min((box["width"] - 2 * STAGE_MARGIN_PX) / width, (box["height"] - 2 * STAGE_MARGIN_PX) / height)
    left = box["x"] + (box["width"] - scale * width) / 2
    top = box["y"] + (box["height"] - scale * height) / 2
    return left + x * scale * width, top + y * scale * height


def written(path: Path, size: Size, frames: int, fps: int = 24) -> Path:
    """An MP4 (H.264, a key frame at least every 250 frames, as x264 does by default)."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=fps, options={"preset": "veryfast"})
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        for frame in clip(size, frames):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")))
        out.mux(stream.encode(None))
    return path


def upload(address: str, name: str, data: bytes) -> str:
    answer = httpx.post(f"{address}/v1/assets", files={"file": (name, data)}, timeout=WAIT_S)
    return str(answer.raise_for_status().json()["id"])


def project(address: str, video: str, method: str, assets: Document | None = None, **layer: Any) -> str:
    """Create a project of one layer; the address of its page."""
    shot = {"id": "s1", "video": "clip", "layers": [{"id": "l1", "method": method, **layer}]}
    document = {"schema": 2, "name": "Measured", "assets": {"clip": {"id": video}, **(assets or {})}, "shots": [shot]}
    made = httpx.post(f"{address}/v1/projects", json={"name": "Measured", "document": document}, timeout=WAIT_S)
    return f"{address}/#/projects/{made.raise_for_status().json()['id']}"


def painting(size: Size, seed: int) -> bytes:
    """A PNG that resembles a painting: soft areas and some strokes."""
    rng = np.random.default_rng(seed)
    ground = rng.integers(0, 256, (9, 16, 3), np.uint8)
    picture = cv2.resize(ground, size, interpolation=cv2.INTER_CUBIC)
    for _ in range(40):
        a, b = (tuple(int(v) for v in rng.integers(0, size)) for _ in range(2))
        cv2.line(picture, a, b, [int(v) for v in rng.integers(0, 256, 3)], int(rng.integers(4, 30)), cv2.LINE_AA)
    return cv2.imencode(".png", picture)[1].tobytes()
