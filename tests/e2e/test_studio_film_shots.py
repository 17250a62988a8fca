"""A film of several shots: clips dropped at once, a clip cut at its cuts; each has its own method, place and range."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.e2e.pages import Watched, accessibility_faults, make_clip, make_two_shots, until
from tests.e2e.studio import SOON_MS, draw, open_project, saved, start_painting, stored
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

CUT = 20


def two_shots(service: str, folder: Path) -> str:
    data = make_two_shots(folder / "two.mp4", 2 * CUT).read_bytes()
    return str(HTTP.post(f"{service}/v1/assets", files={"file": ("two.mp4", data)}).json()["id"])


def cards(page: Page) -> Locator:
    return page.get_by_role("listbox", name="Shots").get_by_role("option")


def shows_shot(page: Page, number: int, frame: int) -> None:
    """Wait until the stage shows this frame of the shot with this number, from 1."""
    expect(cards(page).nth(number - 1)).to_have_attribute("aria-selected", "true")
    until(page, lambda: page.locator(".stage-canvas").get_attribute("data-frame") == str(frame))


def ranges(service: str, project: str) -> list[object]:
    return [shot.get("range") for shot in stored(service, project)["shots"]]


def test_a_clip_is_cut_at_its_cuts_and_each_shot_has_a_method_of_its_own(
    watched: Watched, service: str, tmp_path: Path, axe: str
) -> None:
    page = watched.page
    project = open_project(page, service, two_shots(service, tmp_path), "abstraction", frame=13)
    page.get_by_role("button", name="Make 2 shots at the cuts").click(timeout=SOON_MS)
    expect(cards(page)).to_have_count(2)
    strip = page.get_by_role("slider", name="Frame", exact=True)
    expect(strip).to_have_attribute("aria-valuetext", "Frame 14, 14 of 20 of the shot")
    page.keyboard.press("End")
    shows_shot(page, 1, CUT - 1)
    page.keyboard.press(".")
    shows_shot(page, 2, CUT + CUT // 3)
    expect(strip).to_have_attribute("aria-valuemin", str(CUT + 1))
    page.locator(".method-choice summary").click()
    page.get_by_role("radio", name="Painting in many styles").click(force=True)
    saved(page)
    assert ranges(service, project) == [[0, CUT], [CUT, 2 * CUT]]
    methods = [shot["layers"][0]["method"] for shot in stored(service, project)["shots"]]
    assert methods == ["abstraction", "multistyle"]
    assert accessibility_faults(page, axe) == []
    cards(page).nth(0).click()
    shows_shot(page, 1, CUT // 3)
    page.keyboard.press("Control+z")  # the method of the other shot: it is shown
    expect(cards(page).nth(1)).to_have_attribute("aria-selected", "true")
    page.keyboard.press("Control+z")
    expect(cards(page)).to_have_count(0)
    saved(page)
    assert ranges(service, project) == [None]
    watched.check()


def test_shots_are_reordered_by_keys_and_by_dragging_copied_cut_and_removed(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, two_shots(service, tmp_path), "abstraction", frame=13)
    page.get_by_role("button", name="Cut the shot at this frame").click()
    expect(cards(page)).to_have_count(2)
    page.get_by_role("button", name="Duplicate the shot").click()
    expect(cards(page)).to_have_count(3)
    saved(page)
    assert ranges(service, project) == [[0, 13], [0, 13], [13, 40]]
    page.get_by_role("listbox", name="Shots").press("Shift+ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    saved(page)
    assert [shot["id"] for shot in stored(service, project)["shots"]] == ["s3", "s2", "s1"]
    box, target = cards(page).nth(2).bounding_box(), cards(page).nth(0).bounding_box()
    assert box is not None and target is not None
    page.mouse.move(box["x"] + 40, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(target["x"] + 10, box["y"] + 20, steps=8)
    page.mouse.up()
    saved(page)
    assert [shot["id"] for shot in stored(service, project)["shots"]] == ["s1", "s3", "s2"]
    page.get_by_label("Name of the shot").fill("The bar")
    page.get_by_role("button", name="Remove the shot").click()
    expect(cards(page)).to_have_count(2)
    expect(cards(page).nth(0)).to_have_attribute("aria-selected", "true")
    page.keyboard.press("Control+z")
    expect(cards(page).nth(0)).to_have_text(re.compile(r"1\. The bar"))
    page.reload()
    expect(cards(page)).to_have_count(3)
    watched.check()


def test_a_shot_is_trimmed_on_the_filmstrip_which_then_shows_its_frames_only(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, two_shots(service, tmp_path), "abstraction", frame=13)
    page.keyboard.press("t")
    track = page.locator(".trim-track").bounding_box()
    assert track is not None
    handle = page.get_by_role("slider", name="In point").bounding_box()
    assert handle is not None
    page.mouse.move(handle["x"] + 12, handle["y"] + 10)
    page.mouse.down()
    page.mouse.move(track["x"] + track["width"] * 8.5 / 40, handle["y"] + 10, steps=6)
    page.mouse.up()
    page.get_by_role("slider", name="Out point").press("ArrowLeft")
    page.keyboard.press("PageDown")
    page.get_by_role("button", name="Done").click()
    strip = page.get_by_role("slider", name="Frame", exact=True)
    expect(strip).to_have_attribute("aria-valuemin", "9")
    expect(strip).to_have_attribute("aria-valuemax", "29")
    page.keyboard.press("Home")
    page.keyboard.press("ArrowLeft")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "8", timeout=SOON_MS)
    saved(page)
    assert ranges(service, project) == [[8, 29]]
    for _ in range(2):
        page.keyboard.press("Control+z")
    saved(page)
    assert ranges(service, project) == [None]
    watched.check()


def test_clips_that_are_dropped_at_once_are_the_shots_of_a_film(watched: Watched, service: str, tmp_path: Path) -> None:
    page = watched.page
    page.goto(f"{service}/")
    clips = [make_clip(tmp_path / "one.mp4"), make_clip(tmp_path / "two.mp4", frames=24)]
    page.get_by_label("Choose a video").set_input_files(clips)
    expect(cards(page)).to_have_count(2, timeout=SOON_MS)
    expect(cards(page).nth(1)).to_have_text(re.compile(r"2\. two"))
    shows_shot(page, 1, 4)
    third = make_clip(tmp_path / "three.mp4", size=(128, 64), frames=6)
    page.get_by_label("Add clips").set_input_files(third)
    expect(cards(page).nth(1)).to_have_text(re.compile(r"2\. three"), timeout=SOON_MS)
    cards(page).nth(1).click()
    shows_shot(page, 2, 2)
    expect(page.get_by_role("slider", name="Frame", exact=True)).to_have_attribute("aria-valuemax", "6")
    watched.check()


def test_strokes_on_a_shot_are_uploaded_before_another_is_shown_and_are_there_again(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, two_shots(service, tmp_path), "analogy", frame=13)
    page.get_by_role("button", name="Cut the shot at this frame").click()
    start_painting(page)
    shows_shot(page, 1, 12)
    draw(page, (0.3, 0.5), (0.6, 0.5))
    page.keyboard.press("v")
    cards(page).nth(1).click()
    shows_shot(page, 2, 13 + 27 // 3)
    saved(page)
    keys = [shot["layers"][0].get("parts", {}).get("keys", []) for shot in stored(service, project)["shots"]]
    assert [[key["frame"] for key in each] for each in keys] == [[12], []]
    cards(page).nth(0).click()
    expect(page.get_by_role("button", name="Key at frame 13")).to_be_visible(timeout=SOON_MS)
    watched.check()


def test_the_stage_keeps_the_former_picture_until_the_other_shot_has_one(
    watched: Watched, service: str, tmp_path: Path
) -> None:
    page = watched.page
    video = two_shots(service, tmp_path)
    layers = [{"id": "l", "method": "abstraction"}]
    shots = [
        {"id": f"s{i}", "video": "clip", "range": span, "layers": layers} for i, span in enumerate([[0, 9], [14, 20]])
    ]
    document = {"schema": 2, "name": "Two", "assets": {"clip": {"id": video}}, "shots": shots}
    project = HTTP.post(f"{service}/v1/projects", json={"name": "Two", "document": document}).json()["id"]
    page.goto(f"{service}/#/projects/{project}")
    shows_shot(page, 1, 3)
    page.get_by_role("button", name="Original").click()
    page.evaluate(NOTE_STAGE)
    for number in (2, 1):
        cards(page).nth(number - 1).click()
        shows_shot(page, number, 3 if number == 1 else 16)
    seen = page.evaluate("window.stages")
    assert any(waiting for waiting, _ in seen), "the former picture is shown meanwhile"
    assert all(painted for _, painted in seen), "never an empty stage"
    expect(page.locator(".stage-canvas")).to_have_attribute("data-waiting", "false")
    watched.check()


NOTE_STAGE = """() => {
  window.stages = [];
  const point = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const look = () => {
    const canvas = document.querySelector(".stage-canvas");
    const { waiting } = canvas?.dataset ?? {};
    if (waiting !== undefined) {
      point.clearRect(0, 0, 1, 1);
      point.drawImage(canvas, canvas.width / 2, canvas.height / 2, 1, 1, 0, 0, 1, 1);
      const { data } = point.getImageData(0, 0, 1, 1);
      window.stages.push([waiting === "true", data[3] > 0]);
    }
  };
  const always = () => { look(); requestAnimationFrame(always); };
  always();
  // A busy machine may draw no frame while the stage waits.
  new MutationObserver(look).observe(document.body, { subtree: true, attributeFilter: ["data-waiting"] });
}"""
