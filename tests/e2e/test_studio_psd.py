"""Painted keys as PSD files: layers, groups, masks, blend modes and clipping go out and come in with the same pixels.

psd-tools, which reads and composites PSD files by itself, is the judge.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page, expect
from psd_tools import PSDImage
from psd_tools.api.layers import Group, PixelLayer
from psd_tools.constants import BlendMode

from tests.e2e.pages import HEIGHT, SLOW_MS, WIDTH, Watched, until
from tests.e2e.studio import SOON_MS, asset, decoded, draw, layer_of, open_project, saved, start_painting, stored

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

IMPORT = "Import a painted frame"


def flat_psd(path: Path, width: int, height: int, colour: tuple[int, int, int]) -> Path:
    """A PSD without layers: header, three empty sections, uncompressed planes."""
    header = b"8BPS" + struct.pack(">H6xHIIHH", 1, 3, height, width, 8, 3)
    planes = b"".join(bytes([value]) * (width * height) for value in colour)
    path.write_bytes(header + struct.pack(">III", 0, 0, 0) + struct.pack(">H", 0) + planes)
    return path


def composited(path: Path) -> NDArray[np.int_]:
    """The picture that psd-tools makes of the layers, (HEIGHT, WIDTH, 3)."""
    picture = PSDImage.open(path).composite(force=True)
    assert picture is not None
    return np.asarray(picture.convert("RGB")).astype(int)


def key_at(service: str, project: str, frame: int) -> NDArray[np.int_]:
    """The finished picture of a stored key."""
    document = stored(service, project)
    (name,) = [key["image"] for key in layer_of(document)["keys"] if key["frame"] == frame]
    return decoded(asset(service, document, name)).astype(int)


def exported(page: Page, folder: Path) -> Path:
    with page.expect_download() as download:
        page.get_by_role("button", name="Export PSD").click()
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path


def painted_psd(path: Path) -> Path:
    """Layers of random paint with every blend mode, a clipped one, one with a mask, a group with a mode of its own and
    one that passes through."""
    draw = np.random.default_rng(5)
    psd = PSDImage.new("RGBA", (WIDTH, HEIGHT))

    def add(name: str, parent: Group | PSDImage, opacity: int = 255, **alpha: int) -> PixelLayer:
        pixels = draw.integers(0, 256, (HEIGHT // 8, WIDTH // 8, 4)).astype(np.uint8).repeat(8, 0).repeat(8, 1)
        pixels[..., 3] = alpha.get("alpha", 255)
        return PixelLayer.frompil(Image.fromarray(pixels, "RGBA"), parent, name, opacity=opacity)

    add("ground", psd)
    for mode in (BlendMode.MULTIPLY, BlendMode.SOFT_LIGHT, BlendMode.COLOR_DODGE, BlendMode.HUE, BlendMode.EXCLUSION):
        add(mode.name, psd, 140).blend_mode = mode
    group = Group.new(psd, "apart")
    add("low", group, alpha=128)
    add("burn", group, 200).blend_mode = BlendMode.COLOR_BURN
    group.blend_mode, group.opacity = BlendMode.OVERLAY, 180
    through = Group.new(psd, "through")
    add("screen", through, 100).blend_mode = BlendMode.SCREEN
    through.blend_mode = BlendMode.PASS_THROUGH
    base = add("base", psd, 220)
    clipped = add("clipped", psd, 200)
    clipped.clipping, clipped.blend_mode = True, BlendMode.DIFFERENCE
    mask = np.tile(np.linspace(0, 255, WIDTH).astype(np.uint8), (HEIGHT, 1))
    base.create_mask(Image.fromarray(mask, "L"))
    psd.save(path)
    return path


def test_a_psd_is_composited_as_its_own_program_does(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    path = painted_psd(tmp_path / "painted.psd")
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    page.get_by_label(IMPORT).set_input_files(path)
    expect(page.get_by_role("button", name="Key at frame 5")).to_be_visible(timeout=SOON_MS)
    saved(page)
    found = key_at(service, project, 4)
    difference = np.abs(found - composited(path))
    assert difference.max() <= 4 and difference.mean() < 0.7, (difference.max(), difference.mean())
    document = stored(service, project)
    layers = {layer["name"]: layer for layer in layer_of(document)["keys"][0]["paint"]["layers"]}
    assert [layers[name]["blend"] for name in ("MULTIPLY", "apart", "through")] == [
        "multiply",
        "overlay",
        "pass-through",
    ]
    assert layers["clipped"]["clip"] and layers["low"]["parent"] == layers["apart"]["id"] and layers["base"]["mask"]

    again = exported(page, tmp_path)
    difference = np.abs(found - composited(again))
    assert difference.max() <= 4 and difference.mean() < 0.7, (difference.max(), difference.mean())
    names = [layer.name for layer in PSDImage.open(again).descendants()]
    assert [name for name in names if name != "Paint"] == [layer.name for layer in PSDImage.open(path).descendants()]
    page.keyboard.press("Home")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "0", timeout=SOON_MS)
    page.get_by_label(IMPORT).set_input_files(again)
    expect(page.get_by_role("button", name="Key at frame 1")).to_be_visible(timeout=SOON_MS)
    saved(page)
    assert np.abs(key_at(service, project, 0) - found).max() <= 1, "its own file"


def test_a_key_exported_with_layers_is_imported_with_the_same_pixels(
    fresh: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = fresh.page
    loaded: list[str] = []
    page.on("request", lambda request: loaded.append(request.url))
    project = open_project(page, service, video, "analogy", params={"levels": 2, "iterations": 2}, inputs={})
    expect(page.locator(".stage-canvas")).to_have_attribute("data-result", "final", timeout=SLOW_MS)
    start_painting(page)
    draw(page, (0.2, 0.3), (0.8, 0.3))
    page.get_by_role("slider", name="Opacity of Paint", exact=True).fill("60")
    saved(page)
    before = len([url for url in loaded if url.endswith(".js")])
    path = exported(page, tmp_path)
    assert len([url for url in loaded if url.endswith(".js")]) > before, "the PSD code is loaded when asked for"
    data = path.read_bytes()
    assert path.name == "Disc-frame-00004.psd"
    assert data[:4] == b"8BPS" and struct.unpack(">II", data[14:22]) == (HEIGHT, WIDTH)

    page.keyboard.press("Home")
    expect(page.locator(".stage-canvas")).to_have_attribute("data-frame", "0", timeout=SOON_MS)
    page.get_by_label(IMPORT).set_input_files(path)
    expect(page.get_by_role("button", name="Key at frame 1")).to_be_visible(timeout=SOON_MS)
    saved(page)
    document = stored(service, project)
    imported, painted = layer_of(document)["keys"]
    names = [layer["name"] for layer in imported["paint"]["layers"]]
    assert names == ["Painted frame", "Paint", "Paint"]
    assert imported["paint"]["layers"][1]["opacity"] == pytest.approx(0.6, abs=0.003)
    pictures = [decoded(asset(service, document, key["image"])).astype(int) for key in (painted, imported)]
    assert np.abs(pictures[0] - pictures[1]).max() <= 1
    assert np.abs(pictures[0] - composited(path)).max() <= 1


def test_a_flat_psd_is_one_layer_and_another_size_is_scaled(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    page.get_by_label(IMPORT).set_input_files(flat_psd(tmp_path / "small.psd", 32, 32, (200, 40, 90)))
    expect(page.get_by_text("has 32 × 32 pixels, the video has 96 × 64")).to_be_visible(timeout=SOON_MS)
    page.locator("dialog").get_by_role("button", name="Fit", exact=True).click()
    expect(page.get_by_role("button", name="Key at frame 5")).to_be_visible(timeout=SOON_MS)
    saved(page)
    fitted = key_at(service, project, 4)
    assert (fitted[:, 16:80] == (200, 40, 90)).all() and not fitted[:, :16].any() and not fitted[:, 80:].any()
    page.get_by_label(IMPORT).set_input_files(flat_psd(tmp_path / "flat.psd", WIDTH, HEIGHT, (200, 40, 90)))
    until(page, lambda: bool((key_at(service, project, 4) == (200, 40, 90)).all()))
    (tmp_path / "broken.psd").write_bytes(b"8BPS no")
    page.get_by_label(IMPORT).set_input_files(tmp_path / "broken.psd")
    expect(page.get_by_text("“broken.psd” cannot be read")).to_be_visible(timeout=SOON_MS)
