"""Clusters of the method patches in the studio: displayed, corrected, merged, and solved again for an interval only."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from service import bundle
from tests.e2e.pages import Watched, make_clip, until
from tests.e2e.studio import (
    FILM_MS,
    SOON_MS,
    Document,
    asset,
    draw,
    finished,
    layer_of,
    on_stage,
    open_project,
    render,
    rendered_by_command,
    result,
    saved,
    stored,
)
from tests.waiting import HTTP

FRAMES = 30
FIRST = 10
"""First frame that the studio shows: at a third of the video."""

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(400)]


@pytest.fixture(scope="module")
def video(service: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    path = make_clip(tmp_path_factory.mktemp("clusters") / "disc.mp4", frames=FRAMES)
    yield str(HTTP.post(f"{service}/v1/assets", files={"file": (path.name, path.read_bytes())}).json()["id"])


def labels(png: bytes) -> NDArray[np.uint16]:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None and image.dtype == np.uint16
    return np.asarray(image)


def back_to(page: Page, service: str, project: str) -> None:
    page.goto(f"{service}/#/projects/{project}")
    until(page, lambda: page.locator(".stage-canvas").get_attribute("data-frame") == str(FIRST))


def taken_over(service: str, job: str) -> tuple[set[str], set[str]]:
    """Number of tasks whose results were reused, and of tasks that ran."""
    items = HTTP.get(f"{service}/v1/jobs/{job}/tasks", params={"limit": 200}).json()["items"]
    names: dict[bool, set[str]] = {task["reused"]: set() for task in items}
    for task in items:
        names[task["reused"]].add(f"{task['step']}/{task['key']}")
    return names.get(True, set()), names.get(False, set())


def test_a_corrected_clustering_is_solved_again_for_its_interval_only(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, video, "patches", frame=FIRST)
    expect(page.get_by_text("Find them now, or paint the film")).to_be_visible()
    first = render(page)
    assert taken_over(service, first)[0] == set()

    back_to(page, service, project)
    page.get_by_label("Show the clusters").check()
    chips = page.get_by_role("group", name="Paint with the label")
    expect(chips.get_by_role("button", name="Background")).to_be_visible(timeout=SOON_MS)
    expect(page.get_by_role("img", name="Uncertainty of the clusters")).to_be_visible()
    page.evaluate((bundle.WEB / "node_modules/axe-core/axe.min.js").read_text())
    found = page.evaluate("async () => (await axe.run()).violations")
    assert [violation["id"] for violation in found] == []
    chips.get_by_role("button", name="New object").click()
    page.get_by_label("Brush size").fill("12")
    draw(page, (0.1, 0.2), (0.3, 0.2))
    saved(page)
    document = stored(service, project)
    (entry,) = layer_of(document)["labels"]
    assert (entry["frame"], entry["solve"]) == (FIRST, [FIRST - 6, FIRST + 7])
    drawn = labels(asset(service, document, entry["image"]))
    new = int(drawn[int(0.2 * drawn.shape[0]), int(0.2 * drawn.shape[1])])
    assert new > 1 and (drawn == new).sum() > 100

    page.get_by_label("from", exact=True).fill("9")
    page.get_by_label("to", exact=True).fill("12")
    page.get_by_label("to", exact=True).press("Tab")
    saved(page)
    assert layer_of(stored(service, project))["labels"][0]["solve"] == [8, 12]
    page.get_by_role("button", name="Solve 4 frames again").click()
    second = finished(page)
    reused, ran = taken_over(service, second)
    clustering = {f"cluster/{kind}-{start:07d}" for kind in ("flow", "run", "faces") for start in (0, 12, 24)}
    assert {"scan/video", *clustering} <= reused
    assert {name for name in ran if name.startswith("correct/")} == {
        "correct/front-0000008-0000000", "correct/back-0000008-0000000", "correct/run-0000000"
    }  # fmt: skip
    expect(page.locator(".step", has_text="Cluster by motion")).to_contain_text("9 of 9 tasks reused")
    assert result(service, second) == rendered_by_command(service, project, tmp_path)


def test_scribbles_and_corrections_are_made_before_any_film(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "patches", frame=FIRST)
    page.get_by_role("button", name="Mark the foreground").click()
    page.wait_for_timeout(300)
    disc = 5 / 40 + FIRST / 40
    draw(page, (disc - 0.05, 0.5), (disc + 0.05, 0.5))
    page.get_by_role("button", name="Mark the background").click()
    draw(page, (0.8, 0.1), (0.8, 0.9))
    saved(page)
    spread = page.get_by_role("group", name="Foreground of the next frames").get_by_role("button")
    expect(spread).to_have_text([str(FIRST + 1 + step) for step in range(7)], timeout=FILM_MS)
    spread.nth(2).click()
    until(page, lambda: page.locator(".stage-canvas").get_attribute("data-frame") == str(FIRST + 2))
    expect(spread.first).to_have_text(str(FIRST + 3))

    page.get_by_role("button", name="Find the clusters").click()
    chips = page.get_by_role("group", name="Paint with the label")
    expect(chips.get_by_role("button", name="Background")).to_be_visible(timeout=FILM_MS)
    expect(page.get_by_text("found with the present settings")).to_be_visible(timeout=FILM_MS)
    expect(page.get_by_role("img", name="Uncertainty of the clusters")).to_be_visible()
    chips.get_by_role("button", name="New object").click()
    page.get_by_label("Brush size").fill("12")
    draw(page, (0.1, 0.2), (0.3, 0.2))
    saved(page)
    until(page, lambda: "labels" in layer_of(stored(service, project)))
    document = stored(service, project)
    (entry,) = layer_of(document)["labels"]
    drawn = labels(asset(service, document, entry["image"]))
    new = int(drawn[int(0.2 * drawn.shape[0]), int(0.2 * drawn.shape[1])])
    assert entry["frame"] == FIRST + 2 and new > 1
    job = HTTP.post(f"{service}/v1/projects/{project}/jobs", json={}).json()["items"][0]["job"]
    assert {"masks", "labels", "label_intervals"} <= job["request"]["inputs"].keys()
    HTTP.post(f"{service}/v1/jobs/{job['id']}/cancel")


def test_a_correction_has_the_size_of_a_video_that_is_clustered_at_a_smaller_one(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    path = make_clip(tmp_path / "large.mp4", size=(480, 320), frames=6)
    large = HTTP.post(f"{service}/v1/assets", files={"file": (path.name, path.read_bytes())}).json()["id"]
    project = open_project(page, service, large, "patches", frame=2)
    page.get_by_role("button", name="Find the clusters").click()
    chips = page.get_by_role("group", name="Paint with the label")
    chips.get_by_role("button", name="New object").click(timeout=FILM_MS)
    draw(page, (0.1, 0.2), (0.3, 0.2))
    saved(page)
    until(page, lambda: "labels" in layer_of(stored(service, project)))
    document = stored(service, project)
    drawn = labels(asset(service, document, layer_of(document)["labels"][0]["image"]))
    assert drawn.shape == (320, 480) and drawn[64, 96] == drawn.max() > drawn[250, 96]
    assert HTTP.get(f"{service}/v1/projects/{project}/check").json()["errors"] == []


def test_labels_are_merged_and_corrections_undone(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "patches", frame=FIRST)
    render(page)
    back_to(page, service, project)
    page.get_by_label("Show the clusters").check()
    chips = page.get_by_role("group", name="Paint with the label")
    chips.get_by_role("button", name="New object").click()
    draw(page, (0.6, 0.8), (0.7, 0.8))
    saved(page)

    def stored_labels() -> set[int]:
        document: Document = stored(service, project)
        (entry,) = layer_of(document)["labels"]
        return {int(value) for value in np.unique(labels(asset(service, document, entry["image"])))}

    apart = stored_labels()
    page.get_by_label("Merge Object").select_option("1")
    until(page, lambda: stored_labels() == apart - {max(apart)})
    page.locator(".stage-canvas").press("Control+z")
    until(page, lambda: stored_labels() == apart)
    page.keyboard.down("Alt")
    page.mouse.click(*on_stage(page, 0.65, 0.8))
    page.keyboard.up("Alt")
    expect(chips.get_by_role("button", name=f"Object {max(apart)}")).to_have_attribute("aria-pressed", "true")
    page.get_by_role("button", name="Remove the correction").click()
    saved(page)
    assert layer_of(stored(service, project))["labels"] == []
