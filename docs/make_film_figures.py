"""Takes the screenshots of docs/tutorials/film.md in Chromium: a film of six shots, each in another look, with sound.

python -m docs.make_film_figures CLIP

CLIP has five cuts, for example `video/bikes_scene_cuts.mp4` of the media folder. It gets a tone that rises every
second. It needs Playwright, Chromium and some minutes.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from playwright.sync_api import Page, expect, sync_playwright

from docs.make_studio_figures import HEIGHT, SLOW_MS, WIDTH, service
from docs.pictures import DOCS, save
from service import bundle

FOLDER = DOCS / "tutorials" / "film"
SHOTS = 6
RATE = 48000
SHOT_FRAMES = 24
"""The shots are trimmed to so many frames."""


def with_sound(clip: Path, out: Path) -> Path:
    """The clip with a tone that rises every second."""
    with av.open(str(clip)) as source, av.open(str(out), "w") as target:
        video = source.streams.video[0]
        pictures = target.add_stream_from_template(video)
        sound = target.add_stream("aac", rate=RATE, layout="mono")
        seconds = float((video.duration or 0) * (video.time_base or Fraction(1)))
        at = np.arange(round(seconds * RATE)) / RATE
        wave = (6000 * np.sin(2 * np.pi * (220 + 55 * np.floor(at)) * at)).astype(np.int16)
        frame = av.AudioFrame.from_ndarray(wave[None], format="s16", layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = RATE, 0, Fraction(1, RATE)
        for packet in source.demux(video):
            if packet.size:
                packet.stream = pictures
                target.mux(packet)
        target.mux(sound.encode(frame))
        target.mux(sound.encode(None))
    return out


def shoot(page: Page, name: str) -> None:
    """Save the page as docs/tutorials/film/NAME.jpg."""
    page.wait_for_timeout(1200)
    shot = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR_RGB)
    assert shot is not None
    save(np.asarray(shot, np.uint8), FOLDER / f"{name}.jpg")


def painted(page: Page) -> None:
    """Wait until the stage shows the frame as the film will have it."""
    page.mouse.move(5, 5)
    expect(page.locator(".stage-canvas")).to_have_attribute("data-result", "final", timeout=SLOW_MS)
    expect(page.locator(".save-status")).to_have_text("Saved", timeout=SLOW_MS)


def choose_method(page: Page, title: str) -> None:
    page.locator(".method-choice summary").click()
    page.get_by_role("radio", name=title).check(force=True)


def choose_preset(page: Page, number: int) -> None:
    page.get_by_role("group", name="Presets").get_by_role("button").nth(number).click()


def choose_painting(page: Page, title: str) -> None:
    page.locator(".style-library").evaluate("element => { element.open = true; }")
    page.get_by_role("group", name="Paintings of the library").get_by_role("button", name=title).click()
    expect(page.locator(".slot-name").first).to_be_visible(timeout=SLOW_MS)


def trim(page: Page) -> None:
    """Keep the first frames of the shown shot."""
    strip = page.get_by_role("slider", name="Frame", exact=True)
    strip.press("Home")
    first = int(strip.get_attribute("aria-valuenow") or 1)
    last = int(strip.get_attribute("aria-valuemax") or 1)
    for _ in range((SHOT_FRAMES - 1) // 10):
        strip.press("PageUp")
    for _ in range((SHOT_FRAMES - 1) % 10):
        strip.press("ArrowRight")
    if last - first + 1 > SHOT_FRAMES:
        page.keyboard.press("t")
        page.get_by_role("button", name="Out point here").click()
        page.get_by_role("button", name="Done").click()
    strip.press("Home")


STROKES = "Painting in many styles"
LOOKS: tuple[tuple[str, int, str], ...] = (
    ("", 0, ""),
    ("", 2, ""),
    (STROKES, 0, ""),
    (STROKES, 2, ""),
    (STROKES, 5, ""),
    ("Style by example", 0, "Swirling strokes"),
)
"""Method (empty: that of the first page), number of the preset, painting of the library."""


def choose_look(page: Page, method: str, preset: int, painting: str) -> None:
    if method:
        choose_method(page, method)
    if painting:
        choose_painting(page, painting)
    else:
        choose_preset(page, preset)


def film(page: Page, address: str, clip: Path) -> None:
    """Make a film of six shots, from the empty page on, and take the screenshots."""
    page.goto(address)
    page.get_by_label("Choose a video").set_input_files(clip)
    page.get_by_role("button", name="Draw on it").click(timeout=SLOW_MS)
    page.get_by_role("button", name=f"Make {SHOTS} shots at the cuts").wait_for(timeout=SLOW_MS)
    shoot(page, "cuts")
    page.get_by_role("button", name=f"Make {SHOTS} shots at the cuts").click()
    shots = page.get_by_role("listbox", name="Shots").get_by_role("option")
    expect(shots).to_have_count(SHOTS)
    before = ""
    for number, look in enumerate(LOOKS):
        shots.nth(number).click()
        expect(shots.nth(number)).to_have_attribute("aria-selected", "true")
        strip = page.get_by_role("slider", name="Frame", exact=True)
        if number:
            expect(strip).not_to_have_attribute("aria-valuemin", before)
        before = strip.get_attribute("aria-valuemin") or ""
        trim(page)
        choose_look(page, *look)
        painted(page)
        if number == 3:
            shoot(page, "shots")
    page.keyboard.press("t")
    shoot(page, "trim")
    page.keyboard.press("t")
    page.get_by_role("button", name="Paint the film").click()
    whole = page.get_by_role("region", name="All shots")
    expect(whole).to_contain_text("Finished", timeout=600_000)
    page.get_by_role("group", name="View").get_by_role("button", name="Painted", exact=True).click()
    shoot(page, "painted")
    whole.get_by_role("button", name="Watch the film").click()
    video = page.get_by_label("The painted film")
    expect(video).to_be_visible()
    video.evaluate("one => { one.pause(); one.currentTime = 2.5; }")
    shoot(page, "watch")
    page.get_by_role("dialog").get_by_role("button", name="Close").click()
    with page.expect_download() as download:
        whole.get_by_role("button", name="Download the film").click()
    download.value.save_as(clip.with_name("film.mp4"))


def sizes(page: Page, folder: Path) -> None:
    """The film at other sizes of the window, light and dark, to be looked at; not part of the documentation."""
    for width, height in ((1440, 900), (1024, 768), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
            page.wait_for_timeout(1200)
            page.screenshot(path=folder / f"{width}-{scheme}.png")


def main(clip: Path, look_at: Path | None = None) -> None:
    """Take all screenshots. `look_at`: a folder for those at other sizes, and for the film."""
    bundle.build()
    with tempfile.TemporaryDirectory() as folder, service() as address, sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        page = chromium.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light")
        page.set_default_timeout(SLOW_MS)
        sounding = with_sound(clip, Path(folder) / clip.with_suffix(".mp4").name)
        film(page, address, sounding)
        if look_at is not None:
            shutil.copy(sounding.with_name("film.mp4"), look_at)
            sizes(page, look_at)
        chromium.close()


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
