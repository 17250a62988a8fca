"""Drawings of the studio reach the rendered film: frame ranges, layers, regions, corrected frames."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import expect

from tests.e2e.pages import FPS, FRAMES, HEIGHT, WIDTH, Watched, make_clip, make_three_things
from tests.e2e.studio import (
    SOON_MS,
    asset,
    choose_style,
    decoded,
    draw,
    frames_of,
    layer_of,
    on_stage,
    open_project,
    render,
    rendered_by_command,
    result,
    saved,
    start_painting,
    stored,
)
from tests.waiting import HTTP

DISC = (5 + 4) / (FRAMES + 10)
"""Horizontal centre of the disc in frame 4, in widths of the picture."""

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]


def test_a_two_second_range_is_rendered_first(watched: Watched, service: str, tmp_path: Path) -> None:
    page = watched.page
    long = make_clip(tmp_path / "long.mp4", frames=40)
    video = HTTP.post(f"{service}/v1/assets", files={"file": (long.name, long.read_bytes())}).json()["id"]
    open_project(page, service, video, "abstraction", frame=13)
    page.get_by_role("slider", name="Frame").press("ArrowRight")
    job = render(page, button="Paint 2 s first from frame 15")
    assert HTTP.get(f"{service}/v1/jobs/{job}").json()["request"]["frames"] == [14, 14 + 2 * FPS]
    assert len(frames_of(result(service, job))) == 2 * FPS
    page.get_by_role("link", name="Change settings").click()
    expect(page.locator(".submit-hint")).to_contain_text("about", timeout=SOON_MS)


def test_suggested_keyframes_are_shown_on_the_filmstrip(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    open_project(page, service, video, "analogy")
    page.get_by_role("button", name="Suggest keys").click()
    chips = page.get_by_role("group", name="Suggested keys").get_by_role("button")
    expect(chips.first).to_have_text("Frame 1", timeout=SOON_MS)
    expect(page.get_by_role("button", name="Suggested key at frame 1", exact=True)).to_be_visible()
    chips.first.click()
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "0", timeout=SOON_MS)


def test_a_small_preview_is_shown_at_full_size_on_demand(watched: Watched, service: str, tmp_path: Path) -> None:
    page = watched.page
    wide = make_clip(tmp_path / "wide.mp4", size=(1200, 640), frames=6)
    video = HTTP.post(f"{service}/v1/assets", files={"file": (wide.name, wide.read_bytes())}).json()["id"]
    open_project(page, service, video, "abstraction", frame=2)
    hint = page.locator(".stage-hint")
    expect(hint).to_have_text("Preview at 80 % of full size", timeout=SOON_MS)
    page.get_by_role("button", name="Show at full size").click()
    expect(hint).to_have_text("Preview at 100 % of full size", timeout=SOON_MS)
    expect(page.get_by_role("button", name="Show at full size")).to_be_hidden()
    page.get_by_role("button", name="Overlay").click()
    expect(page.get_by_role("button", name="Overlay")).to_have_attribute("aria-pressed", "true")


def test_the_loupe_shows_a_piece_at_full_size(watched: Watched, service: str, tmp_path: Path) -> None:
    page = watched.page
    wide = make_clip(tmp_path / "wide.mp4", size=(1200, 640), frames=6)
    video = HTTP.post(f"{service}/v1/assets", files={"file": (wide.name, wide.read_bytes())}).json()["id"]
    open_project(page, service, video, "abstraction", frame=2)
    expect(page.locator(".stage-hint")).to_have_text("Preview at 80 % of full size", timeout=SOON_MS)
    asked: list[dict[str, object]] = []
    page.on("request", lambda request: request.url.endswith("/paint") and asked.append(request.post_data_json))
    page.locator(".stage-canvas").press("z")
    expect(page.get_by_role("button", name="Loupe at full size")).to_have_attribute("aria-pressed", "true")
    box = page.locator(".stage-canvas").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(page.locator(".stage-canvas")).to_have_attribute("data-loupe", "440 210 320 220", timeout=SOON_MS)
    expect(page.locator(".stage-hint")).to_have_text("The loupe shows the film at 100 % of full size")
    assert asked[-1]["crop"] == [440, 210, 320, 220]


def test_a_film_of_layers_has_the_bytes_of_the_command(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, video, "abstraction")
    page.get_by_role("button", name="Add a layer").click()
    page.locator("summary", has_text="Painting").first.click()
    page.get_by_role("radio", name="Painting in many styles").check(force=True)
    page.get_by_role("button", name="Settings of the layer Painting in many styles").click()
    page.get_by_label("Opacity of the layer").fill("60")
    page.get_by_label("Blend").select_option("multiply")
    saved(page)
    first, second = stored(service, project)["shots"][0]["layers"]
    assert (first["method"], second["method"]) == ("abstraction", "multistyle")
    assert (second["opacity"], second["blend"]) == (0.6, "multiply")
    film = result(service, render(page))
    assert film == rendered_by_command(service, project, tmp_path)
    assert len(frames_of(film)) == FRAMES


def test_a_region_is_selected_split_merged_and_painted(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, video, "multistyle")
    page.get_by_role("button", name="Pick regions").click()
    expect(page.get_by_text("Pick one of the 2 objects")).to_be_visible(timeout=SOON_MS)

    def regions() -> dict[str, list[int]]:
        saved(page)
        found = layer_of(stored(service, project)).get("design", {}).get("regions", {})
        return {name: region.get("objects") or region["tubes"] for name, region in found.items()}

    disc, field = on_stage(page, DISC, 0.5), on_stage(page, 0.9, 0.9)
    page.mouse.click(*disc)
    (picked,) = regions()["region"]
    page.keyboard.down("Shift")
    page.mouse.click(*field)
    page.keyboard.up("Shift")
    both = regions()["region"]
    assert picked in both and len(both) == 2
    page.keyboard.down("Alt")
    page.mouse.click(*disc)
    page.keyboard.up("Alt")
    apart = regions()
    assert set(apart) == {"region", "region-2"} and apart["region"] != apart["region-2"]
    page.get_by_label("Merge with").select_option("region")
    assert regions() == {"region-2": sorted(apart["region"] + apart["region-2"])}
    page.keyboard.press("Control+z")
    assert regions() == apart

    choose_style(page, "Pointillism")
    page.keyboard.press("End")
    choose_style(page, "Watercolor")
    page.get_by_role("button", name="Everything else").click()
    page.get_by_role("group", name="Pattern").get_by_role("button", name="Circles").click()
    draw(page, (0.3, 0.5), (0.45, 0.5))
    saved(page)
    layer = layer_of(stored(service, project))
    assert [(key["region"], key["frame"]) for key in layer["design"]["keys"]] == [
        ("region-2", 4),
        ("region-2", FRAMES - 1),
    ]
    assert [key["region"] for key in layer["design"]["directions"]] == ["rest"]
    assert result(service, render(page)) == rendered_by_command(service, project, tmp_path)


def test_a_stroke_with_alt_takes_parts_out_of_a_region(watched: Watched, service: str, tmp_path: Path) -> None:
    page = watched.page
    path = make_three_things(tmp_path / "three.mp4")
    video = HTTP.post(f"{service}/v1/assets", files={"file": (path.name, path.read_bytes())}).json()["id"]
    project = open_project(page, service, video, "multistyle", frame=2)
    page.get_by_role("button", name="Pick regions").click()
    expect(page.get_by_text(re.compile(r"Pick one of the \d+ objects"))).to_be_visible(timeout=SOON_MS)
    disc, bar, field = (0.25, 0.5), (0.75, 0.5), (0.5, 0.1)

    def regions() -> dict[str, set[int]]:
        saved(page)
        found = layer_of(stored(service, project)).get("design", {}).get("regions", {})
        return {name: set(region.get("objects") or region["tubes"]) for name, region in found.items()}

    page.mouse.click(*on_stage(page, *disc))
    page.keyboard.down("Shift")
    for thing in (bar, field):
        page.mouse.click(*on_stage(page, *thing))
    page.keyboard.up("Shift")
    whole = regions()
    assert {name: len(parts) for name, parts in whole.items()} == {"region": 3}
    page.keyboard.down("Alt")
    draw(page, disc, (0.5, 0.5))
    page.keyboard.up("Alt")
    apart = regions()
    assert {name: len(parts) for name, parts in apart.items()} == {"region": 1, "region-2": 2}
    assert not apart["region"] & apart["region-2"], "the bar has stayed; the disc and the field have left"
    page.keyboard.press("Control+z")
    assert regions() == whole, "the stroke is one step"


def test_a_corrected_result_frame_becomes_a_second_keyframe(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    asked: list[dict[str, object]] = []
    page.on("request", lambda request: request.url.endswith("/propagate") and asked.append(request.post_data_json))
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    draw(page, (0.1, 0.2), (0.9, 0.2))
    saved(page)
    expect(page.get_by_role("group", name="Frames painted from this key").get_by_role("button")).to_have_count(
        7, timeout=90_000
    )
    assert {body["around"] for body in asked} == {3}, "what is prepared is what is used"
    page.get_by_role("button", name="Frame 7", exact=True).click()
    page.get_by_role("button", name="Correct this frame").click()
    expect(page.get_by_role("button", name="Key at frame 7")).to_be_visible(timeout=SOON_MS)
    expect(page.get_by_role("button", name="Painted frame", exact=True)).to_be_visible()
    draw(page, (0.2, 0.8), (0.8, 0.8))
    saved(page)
    document = stored(service, project)
    first, second = layer_of(document)["keys"]
    assert (first["frame"], second["frame"]) == (4, 6)
    pictures = [decoded(asset(service, document, key["image"])) for key in (first, second)]
    row, column = int(0.2 * HEIGHT), WIDTH // 2
    assert pictures[1][row, column, 2] > 180, "the first key's stroke is in the corrected frame"
    film = frames_of(result(service, render(page)))
    for key, picture in zip((first, second), pictures, strict=True):
        assert np.array_equal(film[key["frame"]], picture)


def test_scribbles_are_in_the_film_that_the_command_makes(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, video, "patches")
    page.get_by_role("button", name="Mark the foreground").click()
    draw(page, (DISC - 0.05, 0.45), (DISC + 0.05, 0.55))
    saved(page)
    page.get_by_role("button", name="Mark the background").click()
    draw(page, (0.9, 0.1), (0.9, 0.9))
    saved(page)
    assert [scribble["frame"] for scribble in layer_of(stored(service, project))["scribbles"]] == [4]
    job = render(page)
    assert "masks" in HTTP.get(f"{service}/v1/jobs/{job}").json()["request"]["inputs"]
    assert result(service, job) == rendered_by_command(service, project, tmp_path)


def test_a_layer_is_painted_alone_with_its_opacity(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    open_project(page, service, video, "abstraction", opacity=0.5)
    page.get_by_label("Layers of the film").select_option("l1")
    page.get_by_role("button", name="Paint the film").click()
    expect(page.get_by_role("alert").filter(has_text="has no opacity")).to_be_visible(timeout=SOON_MS)  # MP4
    frames = result(service, render(page))
    with zipfile.ZipFile(io.BytesIO(frames)) as archive:
        data = np.frombuffer(archive.read(sorted(archive.namelist())[0]), np.uint8)
    alone = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    assert alone.shape[2] == 4 and (alone[..., 3] == 128).all()
