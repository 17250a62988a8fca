"""The live page in Chromium with a file as its camera, against a real service with a key and one session."""

from __future__ import annotations

import base64
import json
import re
import shutil
import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import cv2
import httpx
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page, Playwright, WebSocket, expect
from playwright.sync_api import TimeoutError as PlaywrightTimeout
from websockets.sync.client import connect

from pipeline.methods.multistyle import Multistyle
from pipeline.scenes import scene
from tests.e2e.pages import CHROMIUM_ARGS, KEY, Watched, accessibility_faults, open_page, serve, until
from tests.waiting import HTTP
from tests.waiting import until as wait_until

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(180)]

SIZE, FPS, FRAMES = (320, 240), 15, 30
SLOW_MS = 30_000
"""The first frame may wait for other processes of a busy machine."""
USE_THE_KEY = f"sessionStorage.setItem('impasto.key', '{KEY}')"
AUTHORIZED: dict[str, str] = {"Authorization": f"Bearer {KEY}"}


def make_camera(path: Path) -> Path:
    """Write two seconds of a face that turns and blinks, in the format of Chromium's fake camera."""
    picture = scene("portrait", SIZE, FRAMES, FPS)
    with av.open(str(path), "w", format="yuv4mpegpipe") as out:
        stream = out.add_stream("wrapped_avframe", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for index in range(FRAMES):
            frame = av.VideoFrame.from_ndarray(picture.image(index), format="rgb24")
            out.mux(stream.encode(frame.reformat(format="yuv420p")))
        out.mux(stream.encode(None))
    return path


@pytest.fixture(scope="module")
def browser(playwright: Playwright, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    camera = make_camera(tmp_path_factory.mktemp("camera") / "camera.y4m")
    fake = [
        "--use-fake-ui-for-media-stream",
        "--use-fake-device-for-media-stream",
        f"--use-file-for-fake-video-capture={camera}",
    ]
    chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM_ARGS + fake)
    yield chromium
    chromium.close()


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A service with a capacity of one live session, which requires a key."""
    home = tmp_path_factory.mktemp("live") / "home"
    yield from serve(home, AUTH="required", ADMIN_KEY=KEY, LIVE_SESSIONS="1")


class Talk:
    """Messages exchanged over the page's WebSockets, and numbers of frames sent and of pictures received."""

    def __init__(self, page: Page) -> None:
        self.sockets = self.frames = self.pictures = 0
        self.sent: list[dict[str, Any]] = []
        self.heard: list[dict[str, Any]] = []
        page.on("websocket", self._listen)

    def _listen(self, socket: WebSocket) -> None:
        self.sockets += 1
        socket.on("framesent", self._send)
        socket.on("framereceived", self._hear)

    def _send(self, data: str | bytes) -> None:
        if isinstance(data, str):
            self.sent.append(json.loads(data))
        else:
            self.frames += 1

    def _hear(self, data: str | bytes) -> None:
        if isinstance(data, str):
            self.heard.append(json.loads(data))
        else:
            self.pictures += 1

    def last(self, kind: str) -> dict[str, Any]:
        """The newest message of the service of that type; empty if there was none."""
        return next((message for message in reversed(self.heard) if message["type"] == kind), {})


@contextmanager
def visit(browser: Browser, address: str, script: str = "", **options: Any) -> Iterator[tuple[Watched, Talk]]:
    """The live page, before anything has been started."""
    watched = open_page(browser, **options)
    watched.page.add_init_script(USE_THE_KEY + ";" + script)
    talk = Talk(watched.page)
    watched.page.goto(f"{address}/live")
    try:
        yield watched, talk
    finally:
        watched.page.context.close()
        wait_for_free_worker(address)


def free_workers(service: str) -> int:
    return int(HTTP.get(f"{service}/v1/live", headers=AUTHORIZED).json()["free"])


def wait_for_free_worker(service: str) -> None:
    wait_until(lambda: free_workers(service), 15)


def start(page: Page) -> None:
    page.get_by_role("button", name="Use the camera").click()
    wait_live(page)


def wait_live(page: Page) -> None:
    pill = page.locator(".live-pill")
    until(page, lambda: pill.get_attribute("data-state") in ("live", "failed"))
    assert pill.get_attribute("data-state") == "live", page.locator(".live-stage, main").first.inner_text()


def choose_codec(page: Page, title: str) -> None:
    page.locator("summary", has_text="Connection").click()
    page.get_by_label("Codec", exact=True).get_by_role("radio", name=title, exact=True).check(force=True)


def picture(page: Page, side: str) -> NDArray[np.uint8]:
    """Pixels of the canvas "before" or "after": (height, width, 3)."""
    return pictures(page, side)[0]


def pictures(page: Page, *sides: str) -> list[NDArray[np.uint8]]:
    """Pixels of several canvases at one time."""
    urls = page.evaluate(
        """sides => sides.map(side => { const shown = document.querySelector(`.wipe-${side} canvas`);
        const copy = Object.assign(document.createElement('canvas'), { width: shown.width, height: shown.height });
        copy.getContext('2d', { willReadFrequently: true }).drawImage(shown, 0, 0);
        return copy.toDataURL('image/png'); })""",
        list(sides),
    )
    return [decoded(base64.b64decode(url.partition(",")[2])) for url in urls]


def decoded(png: bytes) -> NDArray[np.uint8]:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR_RGB)
    assert image is not None
    return np.asarray(image, np.uint8)


def moves(page: Page) -> None:
    """The painting changes from frame to frame."""
    before = picture(page, "after")
    until(page, lambda: bool((picture(page, "after") != before).any()))


def grain(image: NDArray[np.uint8]) -> float:
    """Mean difference of a pixel from its neighbours away from edges; small for flat paint."""
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(float)
    return float(np.median(np.abs(cv2.Laplacian(gray, cv2.CV_64F))))


def saturation(image: NDArray[np.uint8]) -> float:
    return float(cv2.cvtColor(image, cv2.COLOR_RGB2HSV)[..., 1].mean())


def number(page: Page, title: str) -> float:
    text = page.locator(".live-tile", has_text=title).locator(".live-number").inner_text()
    return float(text) if re.fullmatch(r"[\d.]+", text) else 0.0


@pytest.mark.parametrize(("codec", "title"), [("h264", "H.264"), ("vp8", "VP8"), ("jpeg", "JPEG")])
def test_the_camera_stream_is_shown_painted(browser: Browser, service: str, codec: str, title: str) -> None:
    with visit(browser, service) as (watched, talk):
        page = watched.page
        choose_codec(page, title)
        start(page)
        assert talk.last("ready")["send"]["codec"] == talk.last("ready")["receive"]["codec"] == codec
        before, after = pictures(page, "before", "after")
        assert before.shape == after.shape == (SIZE[1], SIZE[0], 3)
        assert grain(after) < 0.6 * grain(before)
        assert 2 < np.abs(before.astype(int) - after).mean() < 40, "another picture, but of the same thing"
        moves(page)
        until(page, lambda: number(page, "Rate") > 3)
        assert 0 < number(page, "Service") <= number(page, "Delay")
        watched.check()


def test_method_and_filter_change_during_a_stream(browser: Browser, service: str) -> None:
    with visit(browser, service) as (watched, talk):
        page = watched.page
        start(page)
        session = talk.last("ready")["session"]
        page.get_by_label("Method", exact=True).select_option(label=Multistyle.title)
        until(page, lambda: talk.last("ready")["method"] == "multistyle")
        assert talk.last("ready")["session"] == session
        moves(page)
        page.get_by_role("switch", name="Steady frames").click()
        until(page, lambda: talk.last("params").get("filter", {}).get("method") == "steady")
        until(page, lambda: "filter" in talk.last("stats").get("stages_ms", {}))
        expect(page.locator(".live-why")).to_contain_text("Painted at")
        page.get_by_label("Sharp", exact=True).check()
        until(page, lambda: talk.last("ready")["prefer"] == "sharp")
        watched.check()


def test_the_view_page_shows_the_painting_alone(browser: Browser, service: str) -> None:
    with visit(browser, service) as (watched, _talk):
        start(watched.page)
        with browser.new_page() as view:
            view.goto(f"{service}/live/view#key={KEY}")
            canvas = view.locator("canvas")
            expect(canvas).to_be_visible(timeout=SLOW_MS)
            colours = view.evaluate(
                """() => { const shown = document.querySelector("canvas"), context = shown.getContext("2d");
                return new Set(context.getImageData(0, 0, shown.width, shown.height).data).size; }"""
            )
            assert colours > 20
            assert canvas.bounding_box() == {"x": 0, "y": 0, **view.viewport_size}
            assert view.locator(":is(button, a, input, header):visible").count() == 0


def test_every_setting_changes_during_a_stream(browser: Browser, service: str, tmp_path: Path) -> None:
    with visit(browser, service) as (watched, talk):
        page = watched.page
        start(page)
        plain = saturation(picture(page, "after"))
        page.locator("summary", has_text="Colour").last.click()
        page.get_by_label("Vividness").last.fill("2")
        until(page, lambda: talk.last("params").get("params", {}).get("vividness") == 2)
        until(page, lambda: saturation(picture(page, "after")) > 1.3 * plain)
        assert "vividness" in page.url
        page.get_by_role("button", name="Soft shapes, no lines").click()
        until(page, lambda: talk.last("params")["params"]["lines"] == "off")
        assert talk.last("params")["params"]["vividness"] == 1, "a preset takes the other changes back"

        cv2.imwrite(str(tmp_path / "green.png"), np.full((48, 64, 3), (40, 160, 30), np.uint8))
        page.locator(".slot input[type=file]").set_input_files(tmp_path / "green.png")
        until(page, lambda: talk.last("params")["inputs"].get("reference", "").startswith("ast_"))
        page.get_by_role("button", name="Remove Colour reference").click()
        until(page, lambda: talk.last("params")["inputs"] == {})
        assert talk.sockets == 1
        assert talk.last("error") == {}
        watched.check()


def test_a_hue_histogram_and_a_palette_are_edited_during_a_stream(browser: Browser, service: str, axe: str) -> None:
    with visit(browser, service) as (watched, talk):
        page = watched.page
        start(page)
        page.locator("summary", has_text="Colour").last.click()
        page.get_by_label("Hue neighbourhood").last.fill("180")
        page.locator("summary", has_text="Colour scheme").click()
        histogram = page.get_by_role("slider", name="Hues of the painting")
        expect(page.get_by_role("button", name="From the video")).to_be_enabled()
        histogram.focus()
        for _ in range(9):  # yellow green
            page.keyboard.press("ArrowRight")
        for _ in range(6):
            page.keyboard.press("ArrowUp")
        until(page, lambda: talk.last("params").get("inputs", {}).get("histogram", "").startswith("ast_"))
        stored = HTTP.get(
            f"{service}/v1/assets/{talk.last('params')['inputs']['histogram']}/content", headers=AUTHORIZED
        )
        assert stored.json()["hue"][9] > 0
        page.get_by_label("Saturation", exact=True).last.fill("0.9")
        plain = saturation(picture(page, "after"))
        until(page, lambda: saturation(picture(page, "after")) > 1.2 * plain)
        assert accessibility_faults(page, axe) == []
        page.get_by_role("button", name="Remove the scheme").click()
        until(page, lambda: talk.last("params")["inputs"] == {})
        for number, colour in enumerate(("#102030", "#f0e0d0"), 1):
            page.get_by_role("button", name="Add a colour").click()
            page.get_by_label(f"Palette: colour {number}", exact=True).fill(colour)
        until(page, lambda: talk.last("params")["params"]["palette"] == ["#102030", "#f0e0d0"])
        bright = (0xF0, 0xE0, 0xD0)
        until(page, lambda: float((np.abs(picture(page, "after").astype(int) - bright).max(-1) < 12).mean()) > 0.1)
        assert talk.last("error") == {}
        watched.check()


def test_views_and_the_divider_can_be_switched(browser: Browser, service: str) -> None:
    with visit(browser, service) as (watched, _):
        page = watched.page
        start(page)
        handle = page.get_by_role("slider", name="Compare original and painted")
        handle.focus()
        page.keyboard.press("ArrowRight")
        expect(handle).to_have_attribute("aria-valuenow", "52")
        page.get_by_role("button", name="Side by side").click()
        left, right = (page.locator(f".wipe-{side}").bounding_box() for side in ("before", "after"))
        assert left is not None and right is not None
        assert left["x"] + left["width"] <= right["x"] + 1
        page.get_by_role("button", name="Painted", exact=True).click()
        expect(handle).to_be_hidden()
        watched.check()


def test_a_recording_is_a_playable_film_and_stop_releases_the_camera(browser: Browser, service: str) -> None:
    with visit(browser, service) as (watched, talk):
        page = watched.page
        start(page)
        page.get_by_role("button", name="Record").click()
        before = talk.pictures
        expect(page.locator(".live-record")).to_contain_text(re.compile("Stop · 0:0[1-9]"))
        until(page, lambda: talk.pictures > before + 12)
        with page.expect_download() as download:
            page.locator(".live-record").click()
        assert re.fullmatch(r"impasto-[\d.-]+\.(webm|mp4)", download.value.suggested_filename)
        with av.open(str(download.value.path())) as film:
            frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        assert len(frames) > 5
        assert frames[0].shape == (SIZE[1], SIZE[0], 3)
        assert len({frame.tobytes() for frame in frames}) > 5

        page.get_by_role("button", name="Stop", exact=True).click()
        expect(page.locator("video.live-source")).to_have_count(0)
        expect(page.locator(".submit-hint")).to_contain_text("frames were painted")
        assert talk.last("bye")["stats"]["painted"] > 5
        wait_for_free_worker(service)
        watched.check()


NOTE_DELAYS = """
  window.delays = [];
  const change = AudioParam.prototype.setTargetAtTime;
  AudioParam.prototype.setTargetAtTime = function (value, ...more) {
    window.delays.push(value);
    return change.call(this, value, ...more);
  };
"""


def test_a_recording_has_the_sound_of_the_microphone_by_the_delay_of_the_picture(
    browser: Browser, service: str
) -> None:
    with visit(browser, service) as (watched, talk):
        page = watched.page
        page.add_init_script(NOTE_DELAYS)
        page.reload()
        page.get_by_role("button", name="Sound of the microphone").click()
        start(page)
        until(page, lambda: len(page.evaluate("window.delays")) > 0)
        shown = page.locator(".live-tiles div", has_text="Delay")
        until(page, lambda: bool(re.search(r"\d", shown.inner_text())))
        assert 0 < page.evaluate("window.delays.at(-1)") < 3
        page.get_by_role("button", name="Record").click()
        before = talk.pictures
        until(page, lambda: talk.pictures > before + 12)
        with page.expect_download() as download:
            page.locator(".live-record").click()
        with av.open(str(download.value.path())) as film:
            samples = np.concatenate([frame.to_ndarray().ravel() for frame in film.decode(audio=0)])
        assert np.abs(samples.astype(float)).max() > 0.01 * (1 if samples.dtype.kind == "f" else 32768), "it is heard"
        with av.open(str(download.value.path())) as film:
            assert sum(1 for _ in film.decode(video=0)) > 5
        page.get_by_role("button", name="Stop", exact=True).click()
        wait_for_free_worker(service)
        watched.check()


MOST_DELAY_S = 10
"""The longest delay of a painted picture, and so of its sound, that a busy machine may cause."""
NOTE_SOUNDS = """
  window.sounds = [];
  const start = AudioBufferSourceNode.prototype.start;
  AudioBufferSourceNode.prototype.start = function (when) {
    const loudest = this.buffer.getChannelData(0).reduce((most, one) => Math.max(most, Math.abs(one)), 0);
    window.sounds.push({ when, ahead: when - this.context.currentTime, length: this.buffer.duration, loudest });
    return start.call(this, when);
  };
"""


def test_viewers_hear_the_sound_with_the_picture(browser: Browser, service: str) -> None:
    with visit(browser, service) as (watched, _talk):
        page = watched.page
        page.get_by_role("button", name="Viewers hear the sound").click()
        expect(page.get_by_role("button", name="Sound of the microphone")).to_have_attribute("aria-pressed", "true")
        start(page)
        with browser.new_page() as view:
            view.add_init_script(NOTE_SOUNDS)
            view.goto(f"{service}/live/view#key={KEY}")
            listen = view.get_by_role("button", name="Hear the sound")

            def heard() -> bool:
                """Chromium may let a page play without a gesture: the button is hidden then, perhaps just now."""
                if listen.is_visible():
                    with suppress(PlaywrightTimeout):
                        listen.click(timeout=1000)
                return bool(view.evaluate("window.sounds.length > 120"))

            until(view, heard)
            expect(listen).to_be_hidden()
            sounds = view.evaluate("window.sounds")
            assert max(one["loudest"] for one in sounds) > 0.01, "the fake microphone beeps once a second"
            assert [one["ahead"] for one in sounds if not 0 <= one["ahead"] < MOST_DELAY_S] == []
            follow = [
                abs(after["when"] - before["when"] - before["length"]) < 1e-3 for before, after in pairwise(sounds)
            ]
            assert sum(follow) > 0.9 * len(follow), "packets follow each other without gaps"
            page.get_by_role("button", name="Viewers hear the sound").click()
            view.wait_for_timeout(500)
            known = len(view.evaluate("window.sounds"))
            view.wait_for_timeout(500)
            assert len(view.evaluate("window.sounds")) == known

        with browser.new_page() as silent:
            sent: list[str] = []
            silent.on("websocket", lambda socket: sent.append(socket.url))
            silent.goto(f"{service}/live/view?silent#key={KEY}")
            until(silent, lambda: bool(sent))
            assert "sound" not in sent[0]
        page.get_by_role("button", name="Stop", exact=True).click()
        wait_for_free_worker(service)
        watched.check()


def test_a_phone_shows_the_picture_first_and_has_large_buttons(browser: Browser, service: str) -> None:
    phone = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True}
    with visit(browser, service, **phone) as (watched, _):
        page = watched.page
        start(page)
        page.evaluate("document.querySelectorAll('details').forEach(each => each.open = true)")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        frame, panel = (page.locator(name).bounding_box() for name in (".live-frame", ".live .panel"))
        assert frame is not None and panel is not None
        assert frame["y"] + frame["height"] < panel["y"]
        assert small_targets(page) == []
        page.get_by_role("button", name="Compare").click()
        expect(page.get_by_role("slider", name="Compare original and painted")).to_be_visible()
        watched.check()


def small_targets(page: Page) -> list[str]:
    """Controls smaller than 44 px, which are hard to touch."""
    found: list[str] = page.evaluate(
        """() => [...document.querySelectorAll('.live :is(button, select, summary, .segment, .drop, input)')]
        .filter(each => each.checkVisibility() && !each.closest('.segment, .drop, .live-frame, .field-inline'))
        .concat([...document.querySelectorAll('.live :is(.segment, .drop)')].filter(each => each.checkVisibility()))
        .filter(each => each.getBoundingClientRect().height < 43.5)
        .map(each => each.outerHTML.slice(0, 90))"""
    )
    return found


def test_a_visitor_beyond_the_capacity_waits_for_a_place(browser: Browser, service: str) -> None:
    with visit(browser, service) as (earlier, _), visit(browser, service) as (watched, talk):
        first = earlier.page
        start(first)
        page = watched.page
        page.get_by_role("button", name="Use the camera").click()
        expect(page.get_by_role("status").filter(has_text="All sessions are in use")).to_be_visible()
        expect(page.locator(".stage-status")).to_contain_text(re.compile(r"again in \d s"))
        assert talk.sockets == 0
        first.get_by_role("button", name="Stop", exact=True).click()
        wait_live(page)


class Cable:
    """A TCP relay to the service that can be cut."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._ends: list[socket.socket] = []
        self._door = socket.create_server(("127.0.0.1", 0))
        self.address = f"http://127.0.0.1:{self._door.getsockname()[1]}"
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._door.accept()
                far = socket.create_connection(("127.0.0.1", self._port))
                self._ends += [near, far]
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    @staticmethod
    def _pass(source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError), closing(source), closing(sink):
            while data := source.recv(65536):
                sink.sendall(data)

    def cut(self) -> None:
        """Cut every existing connection; new ones are accepted."""
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        self._ends.clear()

    def close(self) -> None:
        self.cut()
        self._door.close()


def test_a_lost_connection_is_resumed(browser: Browser, service: str) -> None:
    with closing(Cable(httpx.URL(service).port or 0)) as cable, visit(browser, cable.address) as (watched, talk):
        page = watched.page
        start(page)
        session = talk.last("ready")["session"]
        cable.cut()
        until(page, lambda: talk.last("ready").get("resumed", False), 10)
        assert talk.last("ready")["session"] == session
        wait_live(page)
        moves(page)


def test_a_session_taken_over_by_another_page_is_reported(browser: Browser, service: str) -> None:
    with visit(browser, service) as (watched, talk):
        page = watched.page
        start(page)
        address = f"{service.replace('http', 'ws')}/v1/live?session={talk.last('ready')['session']}"
        with connect(address, additional_headers=AUTHORIZED):
            expect(page.get_by_role("alert")).to_contain_text("It goes on elsewhere")
        expect(page.locator("video.live-source")).to_have_count(0)


BREAK = "VideoEncoder.prototype.encode = () => { throw new DOMException('No more.', 'EncodingError') }"


def test_the_page_falls_back_to_jpeg_when_the_video_encoder_fails(browser: Browser, service: str) -> None:
    with visit(browser, service, BREAK) as (watched, talk):
        start(watched.page)
        chosen = [message["send"]["codec"] for message in talk.heard if message["type"] == "ready"]
        assert chosen[-1] == "jpeg" != chosen[0]
        assert talk.last("ready")["resumed"]
        watched.check()


def frames_sent(page: Page, talk: Talk, wait_ms: float) -> int:
    """Number of frames that the page sends in that time."""
    before = talk.frames
    page.wait_for_timeout(wait_ms)
    return talk.frames - before


SET_HIDDEN = "hidden => { Object.defineProperty(document, 'hidden', { get: () => hidden, configurable: true });"
TELL = "document.dispatchEvent(new Event('visibilitychange')); }"


def test_a_hidden_page_sends_no_frames(browser: Browser, service: str) -> None:
    with visit(browser, service) as (watched, talk):
        page = watched.page
        start(page)
        page.evaluate(SET_HIDDEN + TELL, True)
        expect(page.get_by_role("status").filter(has_text="Paused")).to_be_visible()
        until(page, lambda: frames_sent(page, talk, 400) == 0, 3)  # those under way may still arrive
        before = talk.frames
        page.evaluate(SET_HIDDEN + TELL, False)
        wait_live(page)
        until(page, lambda: talk.frames > before)
        watched.check()


REFUSE = """
navigator.mediaDevices.getUserMedia = () => Promise.reject(new DOMException('No.', 'NotAllowedError'))"""


def test_a_video_file_replaces_a_missing_camera(browser: Browser, service: str, tmp_path: Path) -> None:
    with visit(browser, service, REFUSE) as (watched, talk):
        page = watched.page
        page.get_by_role("button", name="Use the camera").click()
        problem = page.get_by_role("alert")
        expect(problem).to_contain_text("The camera was not allowed")
        expect(problem.locator(".remedy")).to_contain_text("Allow it")
        with page.expect_file_chooser() as chooser:
            problem.get_by_role("button", name="Play a video").click()
        chooser.value.set_files(make_film(tmp_path / "film.webm"))
        wait_live(page)
        assert (talk.sent[0]["width"], talk.sent[0]["height"]) == SIZE
        expect(page.locator(".film-title p")).to_contain_text("film.webm")
        watched.check()


def make_film(path: Path) -> Path:
    film = scene("harbour", SIZE, FRAMES, FPS)
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libvpx", rate=FPS, options={"deadline": "realtime", "cpu-used": "8"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for index in range(FRAMES):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(film.image(index), format="rgb24")))
        out.mux(stream.encode(None))
    return path


INSECURE = """
Object.defineProperty(window, 'isSecureContext', { value: false });
Object.defineProperty(navigator, 'mediaDevices', { value: undefined })"""


def test_an_insecure_address_is_explained(browser: Browser, service: str) -> None:
    with visit(browser, service, INSECURE) as (watched, _):
        page = watched.page
        expect(page.locator(".live-card")).to_contain_text("Browsers give cameras to secure pages only")
        expect(page.locator(".live-card").get_by_role("button")).to_have_text(["Play a video"])
        page.locator(".segment", has_text="Camera").click()
        page.get_by_role("button", name="Start the camera").click()
        expect(page.get_by_role("alert").locator(".remedy")).to_contain_text("HTTPS")
        watched.check()
