"""The style library over HTTP: Impasto's own exemplars, and the operator's folder. A real farm without workers."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient

from service import page_pictures
from service.app import create_app
from service.settings import Settings
from service.styles import exemplars
from workers.farm import open_farm


def png(value: int) -> bytes:
    return cv2.imencode(".png", np.full((60, 90, 3), value, np.uint8))[1].tobytes()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "paintings"
    made.mkdir()
    (made / "the_great-wave.png").write_bytes(png(180))
    (made / "the_great-wave.txt").write_text("Katsushika Hokusai, 1831. The Met, CC0\nmore\n")
    (made / "notes.txt").write_text("no painting")
    (made / "broken.jpg").write_bytes(b"no picture")
    return made


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder for exemplars, which are painted in 96x64 px."""
    monkeypatch.setattr(exemplars, "SIZE", (96, 64))
    monkeypatch.setattr(page_pictures, "cache_folder", lambda: tmp_path / "cache")
    page_pictures.folder.cache_clear()
    yield page_pictures.folder()
    page_pictures.folder.cache_clear()


@pytest.fixture
def client(home: Path, folder: Path, own: Path) -> Iterator[TestClient]:
    settings = Settings(home=home, pool="none", styles_dir=folder)
    farm = open_farm(settings)
    with TestClient(create_app(settings, farm), "http://127.0.0.1:8420", raise_server_exceptions=False) as opened:
        yield opened
    farm.stop()


def decoded(data: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image


def test_the_library_lists_own_exemplars_and_the_folder(client: TestClient) -> None:
    items = client.get("/v1/styles").json()["items"]
    own = [item for item in items if item["origin"] == "impasto"]
    assert [item["id"] for item in own] == list(exemplars.exemplars())
    assert all(item["paired"] for item in own)
    found = {item["title"]: item["credit"] for item in items if item["origin"] == "folder"}
    assert found == {"The great wave": "Katsushika Hokusai, 1831. The Met, CC0", "Broken": ""}


def test_an_exemplar_is_painted_once_and_becomes_assets_of_the_caller(client: TestClient, own: Path) -> None:
    assert not list(own.iterdir()), "nothing is painted before it is asked for"
    shown = decoded(client.get("/v1/styles/harbour-print/picture").content)
    assert shown.shape == (64, 96, 3)
    (file,) = own.iterdir()
    before = file.stat().st_mtime_ns
    made = client.post("/v1/styles/harbour-print/assets").json()
    assert file.stat().st_mtime_ns == before
    painting = decoded(client.get(f"/v1/assets/{made['painting']['id']}/content").content)
    source = decoded(client.get(f"/v1/assets/{made['source']['id']}/content").content)
    assert painting.shape == source.shape and np.abs(painting.astype(int) - source).mean() > 3
    assert client.post("/v1/styles/harbour-print/assets").json() == made


def test_exemplars_are_painted_once_for_all_services_and_deleted_when_unused(own: Path) -> None:
    def paint_again() -> bytes:
        raise AssertionError("it is there")

    first = page_pictures.painted("a.png", (1, (96, 64)), lambda: b"one")
    assert page_pictures.painted("a.png", (1, (96, 64)), paint_again) == first and first.read_bytes() == b"one"
    other = page_pictures.painted("a.png", (1, (48, 32)), lambda: b"other")
    assert other != first and sorted(own.iterdir()) == sorted([first, other])
    old = own.parent / "an-earlier-program"
    old.mkdir()
    os.utime(old, (0, 0))
    page_pictures.folder.cache_clear()
    assert page_pictures.folder() == own and list(own.parent.iterdir()) == [own]


def test_a_file_of_the_folder_keeps_its_bytes(client: TestClient, folder: Path) -> None:
    (wave,) = (item for item in client.get("/v1/styles").json()["items"] if item["title"] == "The great wave")
    made = client.post(f"/v1/styles/{wave['id']}/assets").json()
    assert made["source"] is None and made["painting"]["filename"] == "the_great-wave.png"
    content = client.get(f"/v1/assets/{made['painting']['id']}/content").content
    assert content == (folder / "the_great-wave.png").read_bytes()
    (folder / "the_great-wave.png").write_bytes(png(20))
    assert decoded(client.get(f"/v1/styles/{wave['id']}/picture").content).mean() < 30, "a changed file is read anew"


def test_a_broken_file_and_an_unknown_style_have_clear_errors(client: TestClient) -> None:
    (broken,) = (item for item in client.get("/v1/styles").json()["items"] if item["title"] == "Broken")
    answer = client.get(f"/v1/styles/{broken['id']}/picture")
    assert (answer.status_code, answer.json()["code"]) == (422, "unreadable-media")
    assert client.get("/v1/styles/nothing/picture").status_code == 404


def test_two_paintings_of_an_exemplar_are_equal() -> None:
    *_, one = exemplars.exemplars().values()
    assert np.array_equal(one.painting(), one.painting())
