"""GET /v1/methods."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest
from fastapi.testclient import TestClient

from service import page_pictures
from service.methods import thumbnail as thumbnails


def test_a_method_description_contains_everything_for_a_form(client: TestClient) -> None:
    found = client.get("/v1/methods/toy").json()
    assert found["studio"] == {
        "sections": [], "tools": [], "painting": "", "painting_source": "", "cuts": "",
    }  # fmt: skip
    assert (found["parts"], found["previews"]) == ([], ["paint", "source", "styles", "cuts", "flicker", "matte"])
    assert found["params_schema"]["properties"]["sigma_px"] == {
        "default": 1.5,
        "maximum": 10,
        "minimum": 0,
        "symbol": "sigma",
        "title": "Sigma Px",
        "type": "number",
        "unit": "px",
    }
    assert found["defaults"] == {"sigma_px": 1.5, "mode": "soft", "lines": True}
    assert [spec["name"] for spec in found["inputs"]] == ["video"]
    assert found["steps"] == [{"name": "paint", "title": "Paint"}]
    assert found["examples"][0]["params"] == {"mode": "hard"}
    assert client.get("/v1/methods").json() == {"items": [found], "cursor": None}


def test_the_thumbnail_is_an_image_for_every_title(client: TestClient) -> None:
    answer = client.get("/v1/methods/toy/thumbnail")
    assert answer.headers["content-type"].startswith("image/svg+xml")
    assert ElementTree.fromstring(answer.content).tag.endswith("svg")


def test_the_thumbnail_of_a_built_in_method_is_rendered_once_on_a_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_pictures, "cache_folder", lambda: tmp_path)
    page_pictures.folder.cache_clear()
    thumbnails.thumbnail.cache_clear()
    first = thumbnails.thumbnail("abstraction")
    monkeypatch.setattr(thumbnails, "_rendered", lambda session: b"rendered again")
    thumbnails.thumbnail.cache_clear()  # another process
    assert thumbnails.thumbnail("abstraction") == first and first.media_type == "image/jpeg"
    assert [file.read_bytes() for file in page_pictures.folder().iterdir()] == [first.data]
    page_pictures.folder.cache_clear()
    thumbnails.thumbnail.cache_clear()


def test_a_thumbnail_that_cannot_be_written_is_a_drawing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(thumbnails, "painted", full)
    thumbnails.thumbnail.cache_clear()
    assert thumbnails.thumbnail("abstraction").media_type == "image/svg+xml"
    thumbnails.thumbnail.cache_clear()


def test_an_unknown_method_is_404_with_the_known_names(client: TestClient) -> None:
    answer = client.get("/v1/methods/oil")
    assert (answer.status_code, answer.json()["code"]) == (404, "not-found")
    assert "toy" in answer.json()["remedy"]
