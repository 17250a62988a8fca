"""Painted keys as PSD files: export with layers, and import with the same pixels."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.e2e.pages import HEIGHT, WIDTH, Watched
from tests.e2e.studio import SOON_MS, asset, decoded, draw, layer_of, open_project, saved, start_painting, stored

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

IMPORT = "Import a painted frame"


def flat_psd(path: Path, width: int, height: int, colour: tuple[int, int, int]) -> Path:
    """A PSD without layers: header, three empty sections, uncompressed planes."""
    header = b"8BPS" + struct.pack(">H6xHIIHH", 1, 3, height, width, 8, 3)
    planes = b"".join(bytes([value]) * (width * height) for value in colour)
    path.write_bytes(header + struct.pack(">III", 0, 0, 0) + struct.pack(">H", 0) + planes)
    return path


def test_a_key_exported_with_layers_is_imported_with_the_same_pixels(
    fresh: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = fresh.page
    loaded: list[str] = []
    page.on("request", lambda request: loaded.append(request.url))
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    start_painting(page)
    draw(page, (0.2, 0.3), (0.8, 0.3))
    page.get_by_role("slider", name="Opacity of Paint").fill("60")
    saved(page)
    before = len([url for url in loaded if url.endswith(".js")])
    with page.expect_download() as download:
        page.get_by_role("button", name="Export PSD").click()
    assert len([url for url in loaded if url.endswith(".js")]) > before, "the PSD code is loaded when asked for"
    path = tmp_path / download.value.suggested_filename
    download.value.save_as(path)
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
    assert names == ["Video frame", "Paint", "Paint"]
    assert imported["paint"]["layers"][1]["opacity"] == pytest.approx(0.6, abs=0.003)
    pictures = [decoded(asset(service, document, key["image"])).astype(int) for key in (painted, imported)]
    assert np.abs(pictures[0] - pictures[1]).max() <= 1


def test_a_flat_psd_is_one_layer_and_another_size_is_refused(
    watched: Watched, service: str, video: str, tmp_path: Path
) -> None:
    page = watched.page
    project = open_project(page, service, video, "analogy", params={}, inputs={})
    page.get_by_label(IMPORT).set_input_files(flat_psd(tmp_path / "small.psd", 48, 32, (200, 40, 90)))
    expect(page.get_by_text("has 48 × 32 pixels, the video has 96 × 64")).to_be_visible(timeout=SOON_MS)
    page.get_by_label(IMPORT).set_input_files(flat_psd(tmp_path / "flat.psd", WIDTH, HEIGHT, (200, 40, 90)))
    expect(page.get_by_role("button", name="Key at frame 5")).to_be_visible(timeout=SOON_MS)
    saved(page)
    document = stored(service, project)
    (key,) = layer_of(document)["keys"]
    assert (decoded(asset(service, document, key["image"])) == (200, 40, 90)).all()
    (tmp_path / "broken.psd").write_bytes(b"8BPS no")
    page.get_by_label(IMPORT).set_input_files(tmp_path / "broken.psd")
    expect(page.get_by_text("“broken.psd” cannot be read")).to_be_visible(timeout=SOON_MS)
