"""/v1/assets."""

from __future__ import annotations

import hashlib
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient

from service.access.admission import READINGS
from service.assets.adopt import adopt
from service.settings import Settings
from tests.service.conftest import CLIP
from tests.service.driven_farm import DrivenFarm
from tests.service.live import running
from tests.waiting import HTTP, until
from workers.contract.record import Asset


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


def frame_of_a_clip(url: str) -> str:
    """The address of a frame of an asset that is uploaded now."""
    asset = HTTP.post(f"{url}/v1/assets", files={"file": ("clip.mp4", CLIP)}).json()["id"]
    return f"{url}/v1/assets/{asset}/frame"


class SlowFrames:
    """Frames of assets that are decoded only once `go` is set."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.begun: list[int] = []

    def frame(self, *_: object) -> bytes:
        self.begun.append(1)
        assert self.go.wait(60)
        return b"a frame"


def test_a_frame_waits_for_others_and_is_refused_after_some_seconds(
    settings: Settings, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.access.admission.FRAME_WAIT_S", 0.05)
    slow = SlowFrames()
    monkeypatch.setattr(farm.assets, "frame", slow.frame)
    with running(settings.model_copy(update={"frame_slots": 1}), farm) as url, ThreadPoolExecutor(1) as threads:
        frame = frame_of_a_clip(url)
        first = threads.submit(HTTP.get, frame)
        until(lambda: len(slow.begun) == 1)
        busy = HTTP.get(frame)
        assert (busy.status_code, busy.json()["code"], busy.headers["Retry-After"]) == (503, "busy", "1")
        slow.go.set()
        assert first.result().content == b"a frame"
        assert HTTP.get(frame).content == b"a frame"


def test_frames_that_wait_block_no_other_request(
    settings: Settings, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.access.admission.FRAME_WAIT_S", 60)
    slow = SlowFrames()
    monkeypatch.setattr(farm.assets, "frame", slow.frame)
    with running(settings, farm) as url, ThreadPoolExecutor(50) as threads:
        frame = frame_of_a_clip(url)
        asked = [threads.submit(HTTP.get, frame) for _ in range(50)]
        until(lambda: len(slow.begun) == settings.frame_slots)
        time.sleep(0.5)  # the others have arrived, too
        assert HTTP.get(f"{url}/v1/assets", timeout=20).is_success
        assert len(slow.begun) == settings.frame_slots
        slow.go.set()
        assert {future.result().status_code for future in asked} == {200}


def test_uploads_that_are_read_block_no_other_request(
    settings: Settings, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch
) -> None:
    go, reading = threading.Event(), []

    def read_slowly(*given: Any) -> tuple[Asset, bool]:
        reading.append(1)
        assert go.wait(60)
        return adopt(*given)

    monkeypatch.setattr("service.assets.routes.adopt", read_slowly)
    with running(settings, farm) as url, ThreadPoolExecutor(50) as threads:
        files = {"file": ("clip.mp4", CLIP)}
        sent = [threads.submit(HTTP.post, f"{url}/v1/assets", files=files) for _ in range(50)]
        until(lambda: len(reading) >= READINGS)
        time.sleep(0.5)  # the others have arrived, too
        assert HTTP.get(f"{url}/v1/assets", timeout=20).json()["items"] == []
        assert len(reading) == READINGS
        go.set()
        assert {future.result().status_code for future in sent} == {200, 201}
