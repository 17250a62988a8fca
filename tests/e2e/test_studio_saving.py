"""Drawings are not lost without a network, when the page closes during a stroke, or when the server is killed."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from service import bundle
from tests.e2e.pages import HEIGHT, ROOT, WIDTH, Watched, until, wait_ready
from tests.e2e.studio import (
    SOON_MS,
    asset,
    decoded,
    draw,
    layer_of,
    on_stage,
    open_project,
    saved,
    start_painting,
    stored,
)
from tests.ports import free_port
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]


def expect_stroke(page: Page, service: str, project: str) -> None:
    """The stored key of frame 4 has a blue stroke across its middle."""
    saved(page)
    until(page, lambda: bool(layer_of(stored(service, project)).get("keys")))
    document = stored(service, project)
    (key,) = layer_of(document)["keys"]
    assert key["frame"] == 4
    picture = decoded(asset(service, document, key["image"]))
    assert picture[int(0.3 * HEIGHT), WIDTH // 2, 2] > 220
    assert abs(int(picture[2, 2, 1]) - 140) < 12, "beside it is the video's frame"


def test_an_offline_stroke_is_saved_after_reconnecting(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy")
    start_painting(page)
    page.context.set_offline(True)
    draw(page, (0.2, 0.3), (0.8, 0.3))
    expect(page.get_by_role("alert").filter(has_text="kept in this browser")).to_be_visible(timeout=SOON_MS)
    assert "keys" not in layer_of(stored(service, project))
    page.context.set_offline(False)
    expect_stroke(page, service, project)


def test_a_minute_without_network_loses_no_change(fresh: Watched, service: str, video: str) -> None:
    """Draw strokes, rename and undo without network. The page's clock is set forward by a minute instead of waiting."""
    page = fresh.page
    page.clock.install()
    project = open_project(page, service, video, "analogy")
    start_painting(page)
    page.context.set_offline(True)
    lost: list[str] = []
    page.on("requestfailed", lambda request: lost.append(request.url))
    draw(page, (0.2, 0.3), (0.8, 0.3))
    name = page.get_by_label("Name of the project")
    name.fill("Disc without network")
    name.press("Tab")
    draw(page, (0.2, 0.6), (0.8, 0.6))
    page.get_by_role("button", name="Undo", exact=True).click()
    alert = page.get_by_role("alert").filter(has_text="kept in this browser")
    expect(alert).to_be_visible(timeout=SOON_MS)
    page.clock.run_for(60_000)
    expect(alert).to_be_visible()
    assert len(lost) < 120, "it asks again every few seconds, not all the time"
    assert stored(service, project)["name"] == "Disc"
    page.context.set_offline(False)
    page.clock.run_for(5_000)
    expect_stroke(page, service, project)
    document = stored(service, project)
    assert document["name"] == "Disc without network"
    (key,) = layer_of(document)["keys"]
    picture = decoded(asset(service, document, key["image"]))
    assert picture[int(0.6 * HEIGHT), int(0.65 * WIDTH), 2] < 200, "the second stroke was undone"


def test_an_unsaved_stroke_survives_a_page_crash(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy")
    start_painting(page)
    page.context.route("**/v1/assets", lambda route: route.abort())
    draw(page, (0.2, 0.3), (0.8, 0.3))
    expect(page.get_by_role("alert").filter(has_text="kept in this browser")).to_be_visible(timeout=SOON_MS)
    page.goto("about:blank")
    page.context.unroute("**/v1/assets")
    page.goto(f"{service}/#/projects/{project}")
    expect(page.get_by_role("button", name="Key at frame 5")).to_be_visible(timeout=SOON_MS)
    expect_stroke(page, service, project)


def test_unsaved_changes_of_a_page_of_an_earlier_schema_are_kept(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy")
    png = cv2.imencode(".png", np.full((HEIGHT, WIDTH, 3), 200, np.uint8))[1].tobytes()
    key = HTTP.post(f"{service}/v1/assets", files={"file": ("key.png", png)}).json()["id"]
    layer = {"id": "l1", "method": "analogy", "keys": [{"frame": 2, "image": "key"}]}
    former = {"schema": 1, "name": "Disc", "assets": {"clip": {"id": video}, "key": {"id": key}},
              "shots": [{"id": "s1", "video": "clip", "layers": [layer]}]}  # fmt: skip
    unsaved = {"version": 1, "document": former, "pictures": {}}
    page.goto(service)
    page.evaluate("([name, value]) => localStorage.setItem(name, JSON.stringify(value))",
                  [f"impasto.project:{project}", unsaved])  # fmt: skip
    page.goto(f"{service}/#/projects/{project}")
    expect(page.get_by_role("button", name="Paint frame 5")).to_be_visible(timeout=SOON_MS)
    saved(page)
    assert layer_of(stored(service, project))["keys"] == [{"frame": 2, "image": "key"}]
    page.get_by_role("button", name="Previous key").click()
    until(page, lambda: page.locator(".stage-canvas").get_attribute("data-frame") == "2")


def test_an_unfinished_stroke_survives_a_reload(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy")
    start_painting(page)
    page.mouse.move(*on_stage(page, 0.2, 0.3))
    page.mouse.down()
    page.mouse.move(*on_stage(page, 0.8, 0.3), steps=8)
    page.reload()
    expect(page.get_by_role("button", name="Key at frame 5")).to_be_visible(timeout=SOON_MS)
    expect_stroke(page, service, project)


class Server:
    """A service that can be killed and started again at the same address."""

    def __init__(self, home: Path) -> None:
        self._home, self._port = home, free_port()
        self.address = f"http://127.0.0.1:{self._port}"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        log = self._home.with_suffix(".log")
        words = ["serve", "--port", str(self._port), "--home", str(self._home), "--workers", "1"]
        with log.open("ab") as sink:
            command = [sys.executable, "-m", "impasto", *words]
            self._process = subprocess.Popen(command, cwd=ROOT, stdout=sink, stderr=sink, env=dict(os.environ))
        wait_ready(self.address, self._process, log)

    def kill(self) -> None:
        assert self._process is not None
        self._process.kill()
        self._process.wait(20)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    bundle.build()
    made = Server(tmp_path / "home")
    made.start()
    yield made
    made.kill()


def test_a_killed_server_loses_no_strokes(watched: Watched, server: Server, clip: Path) -> None:
    page = watched.page
    answer = HTTP.post(f"{server.address}/v1/assets", files={"file": (clip.name, clip.read_bytes())})
    project = open_project(page, server.address, str(answer.json()["id"]), "analogy")
    start_painting(page)
    page.mouse.move(*on_stage(page, 0.2, 0.3))
    page.mouse.down()
    page.mouse.move(*on_stage(page, 0.5, 0.3), steps=6)
    server.kill()
    page.mouse.move(*on_stage(page, 0.8, 0.3), steps=6)
    page.mouse.up()
    expect(page.get_by_role("alert").filter(has_text="does not answer")).to_be_visible(timeout=SOON_MS)
    server.start()
    expect_stroke(page, server.address, project)
