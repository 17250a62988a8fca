"""A film of several shots is painted: changed shots only, one file with sound, played with sound."""

from __future__ import annotations

import io
import re
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.pages import FPS, Watched, accessibility_faults, make_clip, until
from tests.e2e.studio import FILM_MS, SOON_MS, saved
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]

RATE = 48000


def with_tone(clip: Path, tone_hz: float) -> Path:
    """The clip with a tone."""
    out = clip.with_name(f"tone-{clip.name}")
    with av.open(str(clip)) as source, av.open(str(out), "w") as target:
        video = source.streams.video[0]
        pictures = target.add_stream_from_template(video)
        sound = target.add_stream("aac", rate=RATE, layout="mono")
        seconds = float(video.frames / Fraction(FPS))
        wave = (8000 * np.sin(2 * np.pi * tone_hz * np.arange(round(seconds * RATE)) / RATE)).astype(np.int16)
        frame = av.AudioFrame.from_ndarray(wave[None], format="s16", layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = RATE, 0, Fraction(1, RATE)
        for packet in source.demux(video):
            if packet.size:
                packet.stream = pictures
                target.mux(packet)
        target.mux(sound.encode(frame))
        target.mux(sound.encode(None))
    return out


def tone_at(film: bytes, start_s: float, stop_s: float) -> float:
    with av.open(io.BytesIO(film)) as source:
        samples = np.concatenate([frame.to_ndarray()[0] for frame in source.decode(audio=0)])
    piece = samples[round(start_s * RATE) : round(stop_s * RATE)]
    spectrum = np.abs(np.fft.rfft(piece * np.hanning(len(piece))))
    return float(np.fft.rfftfreq(len(piece), 1 / RATE)[spectrum.argmax()])


def heard(page: Page) -> list[tuple[bool, bool]]:
    """(paused, muted) of each video that the page has made."""
    found: list[tuple[bool, bool]] = [
        (paused, muted) for paused, muted in page.evaluate("window.videos.map((one) => [one.paused, one.muted])")
    ]
    return found


def test_a_film_of_two_clips_is_painted_changed_and_played_with_sound(
    watched: Watched, service: str, tmp_path: Path, axe: str
) -> None:
    page = watched.page
    page.goto(f"{service}/")
    clips = [make_clip(tmp_path / "one.mp4", frames=12), make_clip(tmp_path / "two.mp4", frames=24)]
    sounding = [with_tone(clip, tone) for clip, tone in zip(clips, (440, 880), strict=True)]
    page.get_by_label("Choose a video").set_input_files(sounding)
    shots = page.get_by_role("listbox", name="Shots").get_by_role("option")
    expect(shots).to_have_count(2, timeout=SOON_MS)
    saved(page)
    hint = page.locator(".submit-hint")
    expect(hint).to_contain_text("2 of 2 shots to paint", timeout=SOON_MS)
    page.get_by_role("button", name="Paint the film").click()
    whole = page.get_by_role("region", name="All shots")
    expect(whole).to_contain_text("Finished", timeout=FILM_MS)
    expect(hint).to_contain_text("All shots are painted")
    expect(page.locator(".shot-painted")).to_have_count(2)
    assert accessibility_faults(page, axe) == []
    page.emulate_media(color_scheme="light")
    with page.expect_download() as download:
        whole.get_by_role("button", name="Download the film").click()
    assert download.value.suggested_filename == "My film.mp4"
    film = Path(download.value.path()).read_bytes()
    with av.open(io.BytesIO(film)) as source:
        assert sum(1 for _ in source.decode(video=0)) == 36
    assert tone_at(film, 0.1, 0.9) == pytest.approx(440, abs=5)
    assert tone_at(film, 1.1, 2.9) == pytest.approx(880, abs=5)
    project = re.search(r"projects/([^?]+)", page.url)
    assert project is not None

    page.locator("summary", has_text="Film").last.scroll_into_view_if_needed()
    shots.nth(1).click()
    expect(shots.nth(1)).to_have_attribute("aria-selected", "true")
    page.get_by_role("group", name="Presets").get_by_role("button").nth(1).click()
    expect(hint).to_contain_text("1 of 2 shots to paint", timeout=SOON_MS)
    expect(page.locator(".shot-painted")).to_have_count(1)
    page.get_by_role("button", name="Paint the film").click()
    expect(page.locator(".shot-painted")).to_have_count(2, timeout=FILM_MS)
    items = HTTP.get(f"{service}/v1/projects/{project[1]}/jobs").json()["items"]
    assert sorted(one["shot"] for one in items) == ["s1", "s2", "s2"], "the first shot was not painted again"
    whole.get_by_role("button", name="Watch the film").click()
    video = page.get_by_label("The painted film")
    until(page, lambda: bool(video.evaluate("(one) => one.currentTime > 0.2 && one.duration > 2.9")))
    page.keyboard.press("Escape")
    watched.check()


def test_a_painted_shot_plays_with_sound_in_a_loop_and_in_silence(fresh: Watched, service: str, tmp_path: Path) -> None:
    page = fresh.page
    page.add_init_script(
        "window.videos = []; const make = document.createElement;"
        "document.createElement = function (name, ...more) {"
        "const made = make.call(document, name, ...more);"
        "if (name === 'video') window.videos.push(made); return made; }"
    )
    page.goto(f"{service}/")
    clips = [make_clip(tmp_path / f"{name}.mp4", frames=36) for name in ("one", "two")]
    page.get_by_label("Choose a video").set_input_files([with_tone(clip, 440) for clip in clips])
    shots = page.get_by_role("listbox", name="Shots").get_by_role("option")
    expect(shots).to_have_count(2, timeout=SOON_MS)
    saved(page)
    page.get_by_role("button", name="Paint the film").click()
    expect(page.locator(".shot-painted")).to_have_count(2, timeout=FILM_MS)
    page.get_by_role("group", name="View").get_by_role("button", name="Painted", exact=True).click()
    page.keyboard.press("o")
    page.keyboard.press("l")
    expect(page.locator(".stage-hint")).to_contain_text("Playing the film", timeout=SOON_MS)
    until(page, lambda: (False, False) in heard(page))
    assert heard(page).count((False, False)) == 1, "one sound, not two"
    frames = set()
    passes, before = 0, 0
    while passes < 2:
        at = int(page.locator(".strip").get_attribute("aria-valuenow") or 0)
        passes += at < before
        before = at
        frames.add(at)
        page.wait_for_timeout(20)
    assert {1, 36} & frames, "it plays from the first to the last frame, again and again"
    page.get_by_role("button", name="Sound off").click()
    until(page, lambda: (False, False) not in heard(page))
    assert (False, True) in heard(page), "it plays on"
    page.keyboard.press("k")
    until(page, lambda: all(paused for paused, _ in heard(page)))
    fresh.check()
