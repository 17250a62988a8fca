"""Paint layers of a key: blended, clipped, locked, masked, merged, ordered, moved; and whole keys that are moved and
copied. What is stored, and so the film, is what the stage shows."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from pipeline.compositing import Blend, lay_over
from tests.e2e.pages import HEIGHT, WIDTH, Watched, until
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
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]

QUICK = {"params": {"levels": 2, "iterations": 2}, "inputs": {}}


def keys_of(service: str, project: str) -> dict[int, dict[str, Any]]:
    """Stored keys by frame."""
    return {key["frame"]: key for key in layer_of(stored(service, project)).get("keys", [])}


def picture(service: str, project: str, frame: int) -> NDArray[np.int_]:
    document = stored(service, project)
    (name,) = [key["image"] for key in layer_of(document)["keys"] if key["frame"] == frame]
    return decoded(asset(service, document, name)).astype(int)


def png(pixels: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))[1].tobytes()


def random_picture(seed: int) -> NDArray[np.uint8]:
    pixels = np.random.default_rng(seed).integers(0, 256, (HEIGHT // 8, WIDTH // 8, 3)).astype(np.uint8)
    return pixels.repeat(8, 0).repeat(8, 1)


def with_key(service: str, frame: int = 4, **blend: Any) -> dict[str, Any]:
    """A part of keys: a random picture below another one that has `blend`; and the assets of the document."""
    low, top = random_picture(1), random_picture(2)
    whole = lay_over(low, top, blend.get("opacity", 1), blend.get("blend", "over"))
    assets = {}
    for name, pixels in (("low", low), ("top", top), ("whole", np.asarray(whole, np.uint8))):
        found = HTTP.post(f"{service}/v1/assets", files={"file": (f"{name}.png", png(pixels))}).json()
        assets[name] = {"id": found["id"]}
    layers = [{"id": "low", "name": "Low", "image": "low"}, {"id": "top", "name": "Top", "image": "top", **blend}]
    return {"keys": [{"frame": frame, "image": "whole", "paint": {"layers": layers}}], "assets": assets}


def open_key(page: Page, service: str, video: str, **blend: Any) -> str:
    """Open a project with such a key, the brush chosen; the project's id."""
    part = with_key(service, **blend)
    shot = {"id": "s1", "video": "clip",
            "layers": [{"id": "l1", "method": "analogy", "parts": {"keys": part["keys"]}, **QUICK}]}  # fmt: skip
    document = {"schema": 2, "name": "Disc", "assets": {"clip": {"id": video}, **part["assets"]}, "shots": [shot]}
    project = str(HTTP.post(f"{service}/v1/projects", json={"name": "Disc", "document": document}).json()["id"])
    page.goto(f"{service}/#/projects/{project}")
    expect(page.locator(".stage-canvas")).to_be_visible(timeout=SOON_MS)
    page.get_by_role("button", name="Brush", exact=True).click()
    expect(page.get_by_role("list", name="Layers of this key")).to_be_visible(timeout=SOON_MS)
    return project


def choose(page: Page, name: str) -> None:
    page.get_by_role("list", name="Layers of this key").get_by_role("button", name=name, exact=True).click()


def names(service: str, project: str) -> list[str]:
    return [layer["name"] for layer in keys_of(service, project)[4]["paint"]["layers"]]


def test_the_canvas_blends_as_the_compositor_of_the_service(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_key(page, service, video)
    choose(page, "Top")
    low, top = random_picture(1), random_picture(2)
    for blend in [one for one in get_args(Blend) if one not in ("over", "add")]:
        page.get_by_label("Blend of Top").select_option(blend)
        expected = lay_over(low, top, 1.0, blend).astype(int)
        until(page, lambda: keys_of(service, project)[4]["paint"]["layers"][1].get("blend") == blend)  # noqa: B023
        found = picture(service, project, 4)
        assert np.abs(found - expected).max() <= 2, blend
    page.get_by_role("slider", name="Opacity of Top").fill("70")
    expected = lay_over(low, top, 0.7, "luminosity").astype(int)
    until(page, lambda: keys_of(service, project)[4]["paint"]["layers"][1]["opacity"] == 0.7)
    assert np.abs(picture(service, project, 4) - expected).max() <= 4, "opacity has 8 bits on the canvas"
    page.reload()
    expect(page.get_by_label("Blend of Top")).to_have_value("luminosity", timeout=SOON_MS)


def test_layers_are_renamed_ordered_grouped_merged_removed_and_all_is_undone(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    project = open_key(page, service, video, blend="multiply")
    rows = page.get_by_role("list", name="Layers of this key")
    rows.get_by_role("button", name="Top", exact=True).press("F2")
    page.get_by_label("Name of Top").fill("Shade")
    page.get_by_label("Name of Top").press("Enter")
    page.get_by_role("button", name="Layer", exact=True).click()
    until(page, lambda: names(service, project) == ["Low", "Shade", "Paint 2"])
    rows.get_by_role("button", name="Shade", exact=True).press("Alt+ArrowUp")
    until(page, lambda: names(service, project) == ["Low", "Paint 2", "Shade"])
    items = rows.get_by_role("listitem")
    items.filter(has_text="Shade").drag_to(items.filter(has_text="Low"), target_position={"x": 60, "y": 40})
    until(page, lambda: names(service, project) == ["Shade", "Low", "Paint 2"])
    page.keyboard.press("Control+z")
    until(page, lambda: names(service, project) == ["Low", "Paint 2", "Shade"])
    choose(page, "Shade")
    before = picture(service, project, 4)
    page.get_by_role("button", name="Group", exact=True).click()
    until(page, lambda: names(service, project) == ["Low", "Paint 2", "Shade", "Group"])
    choose(page, "Shade")
    page.get_by_role("button", name="Remove the layer").click()
    until(page, lambda: names(service, project) == ["Low", "Paint 2", "Group"])
    for _ in range(2):
        page.keyboard.press("Control+z")
    until(page, lambda: names(service, project) == ["Low", "Paint 2", "Shade"])
    choose(page, "Shade")
    page.get_by_role("button", name="Merge down").click()
    until(page, lambda: names(service, project) == ["Low", "Paint 2"])
    for _ in range(3):
        page.keyboard.press("Control+z")
    until(page, lambda: names(service, project) == ["Low", "Shade"])
    saved(page)
    assert np.abs(picture(service, project, 4) - before).max() <= 1


def test_merging_an_opaque_layer_with_a_blended_one_keeps_the_picture(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    project = open_key(page, service, video, blend="overlay", opacity=0.6)
    expected = lay_over(random_picture(1), random_picture(2), 0.6, "overlay").astype(int)
    choose(page, "Top")
    page.get_by_role("button", name="Merge down").click()
    until(page, lambda: names(service, project) == ["Low"])
    saved(page)
    assert np.abs(picture(service, project, 4) - expected).max() <= 2


def test_strokes_keep_to_a_locked_layer_and_to_the_layer_below_a_clipped_one(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    project = open_key(page, service, video)
    page.get_by_role("button", name="Layer", exact=True).click()
    start_painting(page)
    draw(page, (0.2, 0.5), (0.4, 0.5))
    saved(page)
    first = picture(service, project, 4)
    plain = random_picture(2).astype(int)
    painted = (first != plain).any(-1)
    assert painted.any() and not painted.all()
    page.get_by_label("Lock transparency").check()
    page.locator(".brush-settings input[type=color]").fill("#ffffff")
    draw(page, (0.05, 0.5), (0.95, 0.5))
    until(page, lambda: not np.array_equal(picture(service, project, 4), first))
    second = picture(service, project, 4)
    assert np.array_equal(second[~painted], plain[~painted]), "nothing beside the stroke"
    assert (second[HEIGHT // 2, int(0.3 * WIDTH)] == 255).all()
    page.get_by_role("button", name="Layer", exact=True).click()
    page.get_by_label("Clip to the layer below").check()
    page.locator(".brush-settings input[type=color]").fill("#00ff00")
    draw(page, (0.05, 0.5), (0.95, 0.5))
    until(page, lambda: not np.array_equal(picture(service, project, 4), second))
    third = picture(service, project, 4)
    assert np.array_equal(third[~painted], plain[~painted])
    assert (third[HEIGHT // 2, int(0.3 * WIDTH)] == (0, 255, 0)).all()


def stage(page: Page) -> NDArray[np.int_]:
    """The picture on the stage, scaled to the size of the video. The pointer is beside it."""
    page.mouse.move(*on_stage(page, -0.05, -0.05))
    shown = decoded(page.locator(".stage-canvas").screenshot())
    box = page.locator(".stage-canvas").bounding_box()
    assert box is not None
    (left, top), (right, bottom) = on_stage(page, 0, 0), on_stage(page, 1, 1)
    rows = (top - box["y"] + (np.arange(HEIGHT) + 0.5) * (bottom - top) / HEIGHT).astype(int)
    columns = (left - box["x"] + (np.arange(WIDTH) + 0.5) * (right - left) / WIDTH).astype(int)
    return shown[np.ix_(rows, columns)].astype(int)


def test_stamps_on_blended_locked_and_grouped_layers_are_the_same_on_the_stage_in_the_film_and_later(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    project = open_key(page, service, video, blend="multiply", opacity=0.8)
    choose(page, "Top")
    page.get_by_role("button", name="Group", exact=True).click()
    until(page, lambda: names(service, project) == ["Low", "Top", "Group"])
    choose(page, "Group")
    page.get_by_label("Blend of Group").select_option("screen")
    choose(page, "Top")
    page.get_by_role("button", name="Layer", exact=True).click()
    until(page, lambda: names(service, project) == ["Low", "Top", "Paint 2", "Group"])
    start_painting(page)
    page.get_by_role("button", name="Brush:").click()
    page.get_by_role("list", name="Brushes").get_by_role("button", name="Watercolour", exact=True).click()
    page.get_by_role("button", name="Close the drawing panel").click()
    page.get_by_label("Brush size").fill("24")
    draw(page, (0.2, 0.3), (0.5, 0.6), (0.8, 0.5))
    page.get_by_label("Lock transparency").check()
    page.locator(".brush-settings input[type=color]").fill("#e0d020")
    draw(page, (0.1, 0.7), (0.5, 0.4), (0.9, 0.7))
    saved(page)
    before, on_screen = picture(service, project, 4), stage(page)
    page.keyboard.press("Control+z")
    until(page, lambda: not np.array_equal(picture(service, project, 4), before))
    saved(page)
    once = picture(service, project, 4)
    assert (once != before).any(-1).mean() > 0.02, "the second stroke is seen within the first one"
    assert np.abs(stage(page) - once).mean() < 3
    page.keyboard.press("Control+Shift+z")
    until(page, lambda: not np.array_equal(picture(service, project, 4), once))
    saved(page)
    assert np.array_equal(picture(service, project, 4), before)
    assert np.abs(on_screen - before).mean() < 3
    assert np.array_equal(stage(page), on_screen)
    page.reload()
    page.get_by_role("button", name="Key at frame 5").click()
    page.get_by_role("button", name="Brush", exact=True).click()
    expect(page.get_by_role("list", name="Layers of this key")).to_be_visible(timeout=SOON_MS)
    until(page, lambda: np.array_equal(stage(page), on_screen))
    with page.expect_download() as download:
        page.get_by_role("button", name="Export PNG").click()
    assert np.array_equal(decoded(download.value.path().read_bytes()), before)


def test_a_selection_is_moved_by_whole_pixels_scaled_erased_and_undone(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    project = open_key(page, service, video)
    choose(page, "Top")
    low, top = random_picture(1).astype(int), random_picture(2).astype(int)
    page.get_by_role("button", name="Select a rectangle").click()
    draw(page, (8 / WIDTH, 8 / HEIGHT), (24 / WIDTH, 24 / HEIGHT))
    page.get_by_role("button", name="Move, scale, turn").click()
    page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    expected = top.copy()
    expected[8:24, 8:24] = low[8:24, 8:24]
    expected[8:24, 28:44] = top[8:24, 8:24]
    until(page, lambda: np.array_equal(picture(service, project, 4), expected))
    draw(page, (36 / WIDTH, 16 / HEIGHT), (46 / WIDTH, 16 / HEIGHT))
    expected[8:24, 28:44] = top[8:24, 28:44]
    expected[8:24, 38:54] = top[8:24, 8:24]
    until(page, lambda: np.array_equal(picture(service, project, 4), expected))
    page.keyboard.press("Delete")
    expected[8:24, 38:54] = top[8:24, 38:54]
    until(page, lambda: np.array_equal(picture(service, project, 4), expected))
    for _ in range(4):
        page.keyboard.press("Control+z")
    until(page, lambda: np.array_equal(picture(service, project, 4), top))
    draw(page, (1, 1), (0.5, 0.5))
    until(page, lambda: not np.array_equal(picture(service, project, 4), top))
    saved(page)
    half = picture(service, project, 4)
    assert np.array_equal(half[HEIGHT // 2 + 1 :], low[HEIGHT // 2 + 1 :]), "the corner was dragged to the middle"
    small = cv2.resize(random_picture(2), (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA).astype(int)
    assert np.abs(half[: HEIGHT // 2, : WIDTH // 2] - small).mean() < 6


def test_a_mask_of_the_key_and_its_reach_are_stored(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_key(page, service, video)
    page.get_by_role("button", name="Mask of the key").click()
    page.get_by_label("Brush size").fill("20")
    draw(page, (0.1, 0.5), (0.9, 0.5))
    until(page, lambda: "mask" in keys_of(service, project)[4])
    saved(page)
    document = stored(service, project)
    mask = decoded(asset(service, document, layer_of(document)["keys"][0]["mask"]))
    assert (mask[HEIGHT // 2, WIDTH // 2] == 0).all() and (mask[2] == 255).all()
    assert np.array_equal(picture(service, project, 4), random_picture(2)), "the mask is not part of the picture"
    page.get_by_label("Frames after it").fill("3")
    page.get_by_label("Frames after it").press("Enter")
    page.get_by_role("group", name="Reach of this key").get_by_role("slider").fill("0.3")
    until(page, lambda: keys_of(service, project)[4].get("weight") == 2)
    assert keys_of(service, project)[4]["after"] == 3
    draw(page, (0.1, 0.2), (0.9, 0.2))
    until(
        page,
        lambda: keys_of(service, project)[4]["mask"] != "x" and page.locator(".save-status").inner_text() == "Saved",
    )
    assert (keys_of(service, project)[4]["after"], keys_of(service, project)[4]["weight"]) == (3, 2)


def test_keys_are_dragged_copied_pasted_and_exported_together(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_key(page, service, video, blend="multiply")
    before = picture(service, project, 4)
    mark = page.get_by_role("button", name="Key at frame 5")
    box, strip = mark.bounding_box(), page.locator(".strip").bounding_box()
    assert box is not None and strip is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(strip["x"] + strip["width"] * 8.5 / 12, box["y"] + box["height"] / 2, steps=5)
    page.mouse.up()
    until(page, lambda: list(keys_of(service, project)) == [8])
    saved(page)
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "8", timeout=SOON_MS)
    assert (
        np.abs(picture(service, project, 8) - lay_over(random_picture(1), random_picture(2), 1, "multiply")).max() <= 2
    )
    page.get_by_role("button", name="Copy this key").click()
    paste = page.get_by_role("button", name="Paste the copied key")
    expect(paste).to_be_visible(timeout=SOON_MS)
    page.keyboard.press("Home")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "0", timeout=SOON_MS)
    paste.click()
    until(page, lambda: list(keys_of(service, project)) == [0, 8])
    saved(page)
    assert np.array_equal(picture(service, project, 0), picture(service, project, 8))
    assert keys_of(service, project)[0]["paint"]["layers"][1]["blend"] == "multiply"
    with page.expect_download() as download:
        page.get_by_role("button", name="All keys as PNG").click()
    download.value.save_as(tmp_path / "keys.zip")
    with zipfile.ZipFile(io.BytesIO((tmp_path / "keys.zip").read_bytes())) as archive:
        assert archive.namelist() == ["0000000.png", "0000008.png"]
        assert np.array_equal(decoded(archive.read("0000000.png")), picture(service, project, 0))
    page.keyboard.press("Control+z")
    until(page, lambda: list(keys_of(service, project)) == [8])
    page.keyboard.press("Control+z")
    until(page, lambda: list(keys_of(service, project)) == [4])
    assert before.shape == picture(service, project, 4).shape


GIVE = """([kind, bytes]) => {
  const data = new DataTransfer();
  data.items.add(new File([new Uint8Array(bytes)], "given.png", { type: "image/png" }));
  const event = kind === "drop"
    ? new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true })
    : new ClipboardEvent("paste", { clipboardData: data, bubbles: true, cancelable: true });
  document.body.dispatchEvent(event);
}"""


@pytest.mark.parametrize("kind", ["drop", "paste"])
def test_a_picture_that_is_dropped_or_pasted_on_the_page_is_a_key(
    watched: Watched, service: str, video: str, kind: str
) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", **QUICK)
    page.evaluate(GIVE, [kind, list(png(random_picture(3)))])
    until(page, lambda: list(keys_of(service, project)) == [4])
    saved(page)
    assert np.array_equal(picture(service, project, 4), random_picture(3))
    page.keyboard.press("Home")
    small = np.full((HEIGHT // 2, WIDTH // 4, 3), (10, 200, 30), np.uint8)
    page.evaluate(GIVE, [kind, list(png(small))])
    expect(page.get_by_text("has 24 × 32 pixels, the video has 96 × 64")).to_be_visible(timeout=SOON_MS)
    page.locator("dialog").get_by_role("button", name="Fill", exact=True).click()
    until(page, lambda: list(keys_of(service, project)) == [0, 4])
    saved(page)
    assert (picture(service, project, 0) == (10, 200, 30)).all()
