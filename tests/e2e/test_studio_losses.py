"""At most one second of drawing is lost when the page ends without warning, whether the server lives or was killed.

The page's clock stands still and is set forward by 50 ms after every movement of the pen, so that the bound does not
depend on the speed of the machine.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
from playwright.sync_api import Browser, Page, expect

from service import bundle
from tests.e2e.pages import HEIGHT, WIDTH, open_page, until
from tests.e2e.studio import SOON_MS, asset, decoded, layer_of, on_stage, open_project, saved, start_painting, stored
from tests.e2e.test_studio_saving import Server
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

STEP_MS, BOUND_MS = 50, 1000
LEFT, RIGHT, HEIGHT_SHARE = 0.1, 0.9, 0.3


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    bundle.build()
    made = Server(tmp_path_factory.mktemp("losses") / "home")
    made.start()
    yield made
    made.kill()


@pytest.mark.parametrize(("seed", "killed"), [(1, False), (2, False), (3, True), (4, True)])
def test_at_most_a_second_of_drawing_is_lost(
    browser: Browser, server: Server, clip: Path, seed: int, killed: bool
) -> None:
    rng = random.Random(seed)
    page = open_page(browser).page
    page.clock.install()
    answer = HTTP.post(f"{server.address}/v1/assets", files={"file": (clip.name, clip.read_bytes())})
    project = open_project(page, server.address, str(answer.json()["id"]), "analogy")
    start_painting(page)
    page.clock.pause_at(page.evaluate("Date.now() + 1000"))
    moves = rng.randrange(30, 70)
    lifted = {rng.randrange(1, moves) for _ in range(rng.randrange(3))}
    kill_at = rng.randrange(moves) if killed else -1
    for move in range(moves):
        if move == kill_at:
            server.kill()
        page.mouse.move(*on_stage(page, share(move, moves), HEIGHT_SHARE))
        if move == 0 or move in lifted:
            page.mouse.down()
        if move + 1 in lifted:
            page.mouse.up()
        page.clock.run_for(STEP_MS)
    crash(page)
    page.close()
    if killed:
        server.start()
    again = page.context.new_page()
    again.clock.resume()  # a clock belongs to all pages of a context
    again.goto(f"{server.address}/#/projects/{project}")
    expect(again.get_by_role("button", name="Key at frame 5")).to_be_visible(timeout=SOON_MS)
    saved(again)
    until(again, lambda: bool(layer_of(stored(server.address, project)).get("keys")))
    reached = farthest(server.address, project)
    page.context.close()
    must_be_there = share(moves - 1 - BOUND_MS // STEP_MS, moves)
    assert reached >= must_be_there - 1 / WIDTH, f"{moves} moves, lifted before {sorted(lifted)}, killed at {kill_at}"


def share(move: int, moves: int) -> float:
    """Horizontal pen position at a movement, as a fraction of the width."""
    return LEFT + (RIGHT - LEFT) * move / (moves - 1)


def crash(page: Page) -> None:
    """Kill the renderer processes of this test's pages, so that no event announces the end of the page."""
    children = psutil.Process().children(recursive=True)
    renderers = [child for child in children if "--type=renderer" in " ".join(child.cmdline())]
    with page.expect_event("crash", timeout=SOON_MS):
        for renderer in renderers:
            renderer.kill()


def farthest(address: str, project: str) -> float:
    """Right end of the blue strokes in the stored key, as a fraction of the width."""
    document = stored(address, project)
    (key,) = layer_of(document)["keys"]
    row = decoded(asset(address, document, key["image"]))[int(HEIGHT_SHARE * HEIGHT)].astype(int)
    blue = np.flatnonzero((row[:, 2] > 200) & (row[:, 0] < 80))
    return float(blue.max() + 1) / WIDTH if len(blue) else 0.0
