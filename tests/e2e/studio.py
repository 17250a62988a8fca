"""Helpers for tests of the studio: open a project, draw on the stage with real pointer events, read what is stored."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from impasto.cli.app import run
from tests.e2e.pages import HEIGHT, WIDTH, until
from tests.waiting import HTTP

SOON_MS = 30_000
FILM_MS = 120_000
Document = dict[str, Any]


def open_project(page: Page, service: str, video: str, method: str, frame: int = 4, **layer: Any) -> str:
    """Open a new project of one layer in the studio at `frame`; the project's id."""
    shot = {"id": "s1", "video": "clip", "layers": [{"id": "l1", "method": method, **layer}]}
    document = {"schema": 2, "name": "Disc", "assets": {"clip": {"id": video}}, "shots": [shot]}
    project = str(HTTP.post(f"{service}/v1/projects", json={"name": "Disc", "document": document}).json()["id"])
    page.goto(f"{service}/#/projects/{project}")
    expect(page.locator(".stage-canvas")).to_be_visible(timeout=SOON_MS)
    until(page, lambda: page.locator(".stage-canvas").get_attribute("data-frame") == str(frame))
    return project


def stored(service: str, project: str) -> Document:
    document: Document = HTTP.get(f"{service}/v1/projects/{project}").json()["document"]
    return document


def layer_of(document: Document) -> dict[str, Any]:
    """The first layer, with its parts as members."""
    layer: dict[str, Any] = document["shots"][0]["layers"][0]
    return layer | layer.get("parts", {})


def saved(page: Page) -> None:
    """Wait until everything is uploaded and stored."""
    expect(page.locator(".save-status")).to_have_text("Saved", timeout=SOON_MS)


def on_stage(page: Page, x: float, y: float) -> tuple[float, float]:
    """Screen position of a point of the picture, (x, y) as fractions of its size. The view has a margin of 12 px."""
    box = page.locator(".stage-canvas").bounding_box()
    assert box is not None
    scale = min((box["width"] - 24) / WIDTH, (box["height"] - 24) / HEIGHT)
    left = box["x"] + (box["width"] - scale * WIDTH) / 2
    top = box["y"] + (box["height"] - scale * HEIGHT) / 2
    return left + x * scale * WIDTH, top + y * scale * HEIGHT


def draw(page: Page, *points: tuple[float, float]) -> None:
    """Drag the mouse through points of the picture."""
    first, *rest = (on_stage(page, *point) for point in points)
    page.mouse.move(*first)
    page.mouse.down()
    for point in rest:
        page.mouse.move(*point, steps=6)
    page.mouse.up()


def draw_with_pen(page: Page, points: list[tuple[float, float, float]]) -> None:
    """Draw a pen stroke: x, y as fractions of the picture, pressure 0..1."""
    session = page.context.new_cdp_session(page)
    for index, (x, y, force) in enumerate(points):
        left, top = on_stage(page, x, y)
        kind = "mousePressed" if index == 0 else "mouseMoved"
        event = {"type": kind, "x": left, "y": top, "button": "left", "buttons": 1, "pointerType": "pen"}
        session.send("Input.dispatchMouseEvent", event | {"force": force})
    session.send("Input.dispatchMouseEvent", event | {"type": "mouseReleased", "force": 0})


def asset(service: str, document: Document, name: str) -> bytes:
    return HTTP.get(f"{service}/v1/assets/{document['assets'][name]['id']}/content").content


def decoded(png: bytes) -> NDArray[np.uint8]:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR_RGB)
    assert image is not None
    return np.asarray(image, np.uint8)


def start_painting(page: Page) -> None:
    page.get_by_role("button", name="Brush", exact=True).click()
    page.get_by_label("Brush size").fill("20")
    page.locator(".brush-settings input[type=color]").fill("#2040ff")


def choose_style(page: Page, title: str) -> None:
    page.get_by_role("group", name="Styles").get_by_role("button", name=title).click()


def render(page: Page, format_: str = "PNG frames", button: str = "Paint the film") -> str:
    """Submit the project for a film in this format, wait until it is finished; the job's id."""
    choose_format(page, format_)
    page.get_by_role("button", name=button).click()
    return finished(page)


def choose_format(page: Page, format_: str = "PNG frames") -> None:
    """Choose the film's format in the section Film, which is opened."""
    choice = page.get_by_label("Format", exact=True)
    if not choice.is_visible():
        page.locator("summary", has_text="Film").click()
    choice.select_option(label=format_)


def finished(page: Page) -> str:
    """Go from the studio to the page of the film that was just submitted and wait for its end; the job's id."""
    page.get_by_role("link", name="Page of the film").click()
    page.wait_for_url("**/#/jobs/*", timeout=SOON_MS)
    expect(page.get_by_role("button", name=re.compile("^Download"))).to_be_visible(timeout=FILM_MS)
    return page.url.rpartition("/")[2]


def result(service: str, job: str) -> bytes:
    return HTTP.get(f"{service}/v1/jobs/{job}/result").content


def frames_of(film: bytes) -> list[NDArray[np.uint8]]:
    """The frames of a film in PNG frames."""
    with zipfile.ZipFile(io.BytesIO(film)) as archive:
        return [decoded(archive.read(name)) for name in sorted(archive.namelist())]


def rendered_by_command(service: str, project: str, folder: Path) -> bytes:
    """The film that `impasto render` makes of the exported project."""
    archive, film = folder / "project.zip", folder / "film.zip"
    archive.write_bytes(HTTP.get(f"{service}/v1/projects/{project}/export").content)
    words = ["render", str(archive), "-o", str(film), "--home", str(folder / "home"), "--quiet"]
    assert run(words) == 0  # in this process, which has the methods and kernels of the films before
    return film.read_bytes()
