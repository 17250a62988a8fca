"""Frames of finished films become painted keys, with their exact pixels: from the film's page and in the studio."""

from __future__ import annotations

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.e2e.pages import Watched, until
from tests.e2e.studio import (
    SOON_MS,
    asset,
    decoded,
    draw,
    frames_of,
    layer_of,
    open_project,
    render,
    result,
    saved,
    start_painting,
    stored,
)
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]


def test_a_frame_of_a_finished_film_becomes_a_key(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    draw(page, (0.1, 0.2), (0.9, 0.2))
    saved(page)
    job = render(page)
    film = frames_of(result(service, job))
    page.get_by_label("Frame to correct").fill("8")
    page.get_by_role("button", name="Correct this frame").click()
    expect(page.get_by_role("button", name="Key at frame 8")).to_be_visible(timeout=SOON_MS)
    assert "film=" not in page.url, "a reload does not take the frame again"
    saved(page)
    document = stored(service, project)
    (taken,) = (key for key in layer_of(document)["keys"] if key["frame"] == 7)
    np.testing.assert_array_equal(decoded(asset(service, document, taken["image"])), film[7])

    until(page, lambda: page.locator(".stage-canvas").get_attribute("data-frame") == "7")
    page.locator(".brush-settings input[type=color]").fill("#10c040")
    draw(page, (0.2, 0.8), (0.8, 0.8))
    saved(page)
    page.get_by_role("slider", name="Frame", exact=True).press("ArrowRight")
    page.get_by_role("button", name="Correct the film's frame").click()
    expect(page.get_by_role("button", name="Key at frame 9")).to_be_visible(timeout=SOON_MS)
    saved(page)
    document = stored(service, project)
    keys = {key["frame"]: decoded(asset(service, document, key["image"])) for key in layer_of(document)["keys"]}
    assert sorted(keys) == [4, 7, 8]
    assert not np.array_equal(keys[7], film[7]) and np.array_equal(keys[8], film[8])
    corrected = frames_of(result(service, render(page)))
    for frame, key in keys.items():
        np.testing.assert_array_equal(corrected[frame], key)


def test_frames_of_a_compressed_film_are_decoded(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    draw(page, (0.1, 0.2), (0.9, 0.2))
    saved(page)
    job = render(page, format_="MP4")
    expect(page.get_by_text("taken from the compressed film")).to_be_visible()
    frame = decoded(HTTP.get(f"{service}/v1/jobs/{job}/frames/4").content)
    document = stored(service, project)
    key = decoded(asset(service, document, layer_of(document)["keys"][0]["image"]))
    assert 0 < np.abs(frame.astype(int) - key).mean() < 12, "the key, as the codec has it"
    beyond = HTTP.get(f"{service}/v1/jobs/{job}/frames/400")
    assert (beyond.status_code, beyond.json()["field"]) == (404, "index")
