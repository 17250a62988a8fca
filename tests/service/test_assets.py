"""/v1/assets."""

from __future__ import annotations

import hashlib
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient

from service.settings import Settings
from tests.service.conftest import CLIP
from tests.service.driven_farm import DrivenFarm


def test_an_upload_is_addressed_by_its_content(client: TestClient, settings: Settings) -> None:
    first = client.post("/v1/assets", files={"file": ("clip.mp4", CLIP)})
    again = client.post("/v1/assets", files={"file": ("copy.mp4", CLIP)})
    asset_id = f"ast_{hashlib.sha256(CLIP).hexdigest()}"
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.headers["location"] == f"/v1/assets/{asset_id}" == again.headers["location"]
    assert first.json() == again.json() == client.get(f"/v1/assets/{asset_id}").json()
    assert first.json()["filename"] == "clip.mp4"
    assert list(settings.uploads_dir.iterdir()) == []


def test_a_large_file_is_uploaded_completely(client: TestClient) -> None:
    data = CLIP + bytes(range(256)) * 4096 + b"\r\n--"
    asset_id = client.post("/v1/assets", files={"file": ("clip.mp4", data)}).json()["id"]
    assert client.get(f"/v1/assets/{asset_id}/content").content == data


def test_file_names_keep_unicode_letters(client: TestClient) -> None:
    answer = client.post("/v1/assets", files={"file": ("Mälö 日本.mp4", CLIP)})
    assert answer.json()["filename"] == "Mälö 日本.mp4"


def test_assets_are_listed(client: TestClient, asset: str) -> None:
    page = client.get("/v1/assets").json()
    assert ([row["id"] for row in page["items"]], page["cursor"]) == ([asset], None)


def test_an_asset_in_use_is_not_deleted(client: TestClient, farm: DrivenFarm, asset: str, body: dict[str, Any]) -> None:
    job = client.post("/v1/jobs", json=body).json()["id"]
    assert client.delete(f"/v1/assets/{asset}").json()["code"] == "conflict"
    farm.finish(job)
    assert client.delete(f"/v1/assets/{asset}").status_code == 204
    assert client.get(f"/v1/assets/{asset}").status_code == 404


def test_a_frame_of_an_asset_is_an_image(client: TestClient, asset: str) -> None:
    answer = client.get(f"/v1/assets/{asset}/frame?index=70&max_side_px=64")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/jpeg")
    assert abs(int(cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_GRAYSCALE)[0, 0]) - 70) < 3
    assert client.get("/v1/assets/ast_none/frame").json()["code"] == "not-found"
    wrong = client.get(f"/v1/assets/{asset}/frame?index=-1")
    assert (wrong.status_code, wrong.json()["field"]) == (422, "index")


def test_concurrent_frame_decoding_is_limited(
    client: TestClient, farm: DrivenFarm, asset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.assets.routes.FRAME_WAIT_S", 0.05)
    slots = client.app.state.service.frames  # type: ignore[attr-defined]
    while slots.acquire(blocking=False):
        pass
    busy = client.get(f"/v1/assets/{asset}/frame")
    assert (busy.status_code, busy.json()["code"], busy.headers["retry-after"]) == (503, "busy", "1")
    slots.release()
    assert client.get(f"/v1/assets/{asset}/frame").status_code == 200
