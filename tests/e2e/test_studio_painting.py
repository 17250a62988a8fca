"""Painting keys: the stage shows what is stored, exported and rendered; smudge, undo, pressure, keyboard."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from tests.e2e.pages import FRAMES, HEIGHT, WIDTH, Watched, until
from tests.e2e.studio import (
    SOON_MS,
    asset,
    decoded,
    draw,
    draw_with_pen,
    frames_of,
    layer_of,
    on_stage,
    open_project,
    render,
    result,
    saved,
    start_painting,
    stored,
)

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

BAR, BELOW = 0.25, 0.45
"""Heights of a painted bar and of a place below it, as fractions of the picture."""


def exported(page: Page) -> bytes:
    with page.expect_download() as download:
        page.get_by_role("button", name="Export PNG").click()
    return download.value.path().read_bytes()


def test_a_smudge_carries_paint_and_is_undone_exported_and_rendered(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    page.get_by_role("button", name="Original", exact=True).click()
    start_painting(page)
    draw(page, (0.6, BAR), (0.95, BAR))
    saved(page)
    before = stored(service, project)
    page.keyboard.press("s")
    expect(page.get_by_role("button", name="Smudge", exact=True)).to_have_attribute("aria-pressed", "true")
    page.get_by_label("Brush strength").fill("90")
    draw_with_pen(page, [(0.8, BAR + 0.02 * step, 0.6) for step in range(12)])
    saved(page)
    document = stored(service, project)
    (key,) = layer_of(document)["keys"]
    strokes = json.loads(asset(service, document, key["paint"]["layers"][1]["strokes"]))["strokes"]
    assert [stroke["kind"] for stroke in strokes] == ["brush", "smudge"]
    assert strokes[1]["opacity"] == 0.9
    assert {sample[2] for sample in strokes[1]["samples"]} == {0.6}
    png = asset(service, document, key["image"])
    image = decoded(png).astype(int)
    x, y = int(0.8 * WIDTH), int(BELOW * HEIGHT)
    assert image[y, x, 2] > image[y, x - 12, 2] + 20, "blue paint was carried below the bar"
    assert exported(page) == png

    page.keyboard.press("Control+z")
    until(page, lambda: stored(service, project) == before)
    page.keyboard.press("Control+Shift+z")
    until(page, lambda: stored(service, project) == document)
    page.reload()
    page.get_by_role("button", name="Key at frame 5").click()
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "4", timeout=SOON_MS)
    assert exported(page) == png, "the strokes give the same bytes in another visit"
    film = frames_of(result(service, render(page)))
    assert np.array_equal(film[4], decoded(png))
    watched.check()


LATE_FRAMES = """
const Real = window.VideoFrame, reads = new Map();
window.VideoFrame = function (source, ...options) {
  const frame = new Real(source, ...options);
  if (!(source instanceof HTMLVideoElement)) return frame;
  const at = source.currentTime, before = reads.get(source) ?? { at: -1, times: 0 };
  const times = before.at === at ? before.times + 1 : 1;
  reads.set(source, { at, times });
  if (times > 3) return frame;
  const { width, height } = frame.visibleRect;
  frame.close();
  const other = new OffscreenCanvas(width, height);
  other.getContext("2d").fillRect(0, 0, width, height);
  return new Real(other, { timestamp: 5e6 });
};"""
"""Simulates a browser that reports the end of a seek, but returns another frame for the first three reads."""


def test_a_frame_that_the_browser_has_late_is_awaited(fresh: Watched, service: str, video: str) -> None:
    page = fresh.page
    open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    prompt = exported(page)
    page.add_init_script(LATE_FRAMES)
    page.reload()
    start_painting(page)
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "4", timeout=SOON_MS)
    assert exported(page) == prompt


def test_fill_picker_eraser_and_import_change_the_key(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})

    def picture() -> NDArray[np.int64]:
        saved(page)
        document = stored(service, project)
        return decoded(asset(service, document, layer_of(document)["keys"][0]["image"])).astype(int)

    def colour_at(x: float, y: float) -> list[int]:
        found: list[int] = picture()[int(y * HEIGHT), int(x * WIDTH)].tolist()
        return found

    page.get_by_role("button", name="Original", exact=True).click()
    start_painting(page)
    page.keyboard.press("g")
    page.mouse.click(*on_stage(page, 0.9, 0.9))
    assert colour_at(0.05, 0.05) == [0x20, 0x40, 0xFF], "the field is one colour, around the disc"
    disc = colour_at(9 / 22, 0.5)
    assert disc != [0x20, 0x40, 0xFF]
    page.keyboard.press("i")
    page.mouse.click(*on_stage(page, 9 / 22, 0.5))
    page.keyboard.press("b")
    assert page.locator(".brush-settings input[type=color]").input_value() == "#" + bytes(disc).hex()
    draw(page, (0.7, 0.8), (0.95, 0.8))
    assert colour_at(0.85, 0.8) == disc
    page.keyboard.press("e")
    draw(page, (0.85, 0.7), (0.85, 0.95))
    erased = colour_at(0.85, 0.8)
    assert erased not in (disc, [0x20, 0x40, 0xFF]), "the video's frame is seen again"

    page.keyboard.press("End")
    for name, size in (("small", (WIDTH - 2, HEIGHT)), ("right", (WIDTH, HEIGHT))):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((size[1], size[0], 3), (30, 20, 200), np.uint8))
    page.get_by_label("Import a painted frame").set_input_files(tmp_path / "small.png")
    expect(page.get_by_text("has 94 × 64 pixels, the video has 96 × 64")).to_be_visible(timeout=SOON_MS)
    page.get_by_role("button", name="Leave it").click()
    page.get_by_label("Import a painted frame").set_input_files(tmp_path / "right.png")
    expect(page.get_by_role("button", name=f"Key at frame {FRAMES}")).to_be_visible(timeout=SOON_MS)
    saved(page)
    document = stored(service, project)
    imported = decoded(asset(service, document, layer_of(document)["keys"][1]["image"]))
    assert (imported == (200, 20, 30)).all()
