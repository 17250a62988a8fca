"""Clips of Impasto's own scenes over HTTP. A real farm without workers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.scenes import routes
from service.settings import Settings
from workers.farm import open_farm


@pytest.fixture
def client(home: Path) -> Iterator[TestClient]:
    settings = Settings(home=home, pool="none")
    farm = open_farm(settings)
    with TestClient(create_app(settings, farm), "http://127.0.0.1:8420", raise_server_exceptions=False) as opened:
        yield opened
    farm.stop()


def test_a_scene_becomes_an_asset(client: TestClient) -> None:
    made = client.post("/v1/scenes/harbour/assets").json()
    assert (made["filename"], made["kind"], made["info"]["frames"]) == ("harbour.mp4", "video", 30)
    assert (made["info"]["width"], made["info"]["height"]) == (480, 270)


def test_a_scene_becomes_the_same_asset_each_time(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "FRAMES", 4)
    made = client.post("/v1/scenes/harbour/assets").json()
    assert client.post("/v1/scenes/harbour/assets").json()["id"] == made["id"]
    assert len(client.get("/v1/assets").json()["items"]) == 1


def test_an_unknown_scene_is_refused(client: TestClient) -> None:
    assert client.post("/v1/scenes/castle/assets").status_code == 422
