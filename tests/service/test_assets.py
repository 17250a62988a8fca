"""/v1/assets."""

from __future__ import annotations

import hashlib
from typing import Any

from fastapi.testclient import TestClient

from service.settings import Settings
from tests.service.conftest import CLIP
from tests.service.fake_farm import FakeFarm


def test_an_upload_is_addressed_by_its_content(client: TestClient, settings: Settings) -> None:
    first = client.post("/v1/assets", files={"file": ("clip.mp4", CLIP)})
    again = client.post("/v1/assets", files={"file": ("copy.mp4", CLIP)})
    asset_id = f"ast_{hashlib.sha256(CLIP).hexdigest()}"
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.headers["location"] == f"/v1/assets/{asset_id}" == again.headers["location"]
    assert first.json() == again.json() == client.get(f"/v1/assets/{asset_id}").json()
    assert first.json()["filename"] == "clip.mp4"
    assert list(settings.uploads_dir.iterdir()) == []


def test_a_large_file_arrives_whole(client: TestClient) -> None:
    data = CLIP + bytes(range(256)) * 4096 + b"\r\n--"
    asset_id = client.post("/v1/assets", files={"file": ("clip.mp4", data)}).json()["id"]
    assert client.get(f"/v1/assets/{asset_id}/content").content == data


def test_names_keep_their_letters(client: TestClient) -> None:
    answer = client.post("/v1/assets", files={"file": ("Mälö 日本.mp4", CLIP)})
    assert answer.json()["filename"] == "Mälö 日本.mp4"


def test_listing(client: TestClient, asset: str) -> None:
    page = client.get("/v1/assets").json()
    assert ([row["id"] for row in page["items"]], page["cursor"]) == ([asset], None)


def test_an_asset_in_use_cannot_go(client: TestClient, farm: FakeFarm, asset: str, body: dict[str, Any]) -> None:
    job = client.post("/v1/jobs", json=body).json()["id"]
    assert client.delete(f"/v1/assets/{asset}").json()["code"] == "conflict"
    farm.finish(job)
    assert client.delete(f"/v1/assets/{asset}").status_code == 204
    assert client.get(f"/v1/assets/{asset}").status_code == 404
