"""Real HTTP with the real farm: upload, submit, events, download, webhook, preview, cancel."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import cv2
import httpx
import numpy as np
import pytest
from standardwebhooks import Webhook

from service.settings import Settings
from tests.service.live import running
from tests.service.test_webhooks import Receiver, serve
from workers.farm import open_farm


@pytest.fixture(scope="module")
def http(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    home = tmp_path_factory.mktemp("home")
    settings = Settings(home=home, pool="local", workers=1, webhook_private=True, webhook_poll_s=0.05)
    farm = open_farm(settings)
    farm.start()
    with running(settings, farm) as url, httpx.Client(base_url=url, timeout=60) as client:
        yield client
    farm.stop()


@pytest.fixture(scope="module")
def clip(http: httpx.Client, tiny_clip: Path) -> str:
    return str(http.post("/v1/assets", files={"file": ("tiny.mp4", tiny_clip.read_bytes())}).json()["id"])


def events(http: httpx.Client, job: str, last: int) -> list[dict[str, Any]]:
    with http.stream("GET", f"/v1/jobs/{job}/events", headers={"Last-Event-ID": str(last)}) as answer:
        return [json.loads(line[6:]) for line in answer.iter_lines() if line.startswith("data: ")]


def test_a_job_from_end_to_end(http: httpx.Client, clip: str) -> None:
    receiver = serve(Receiver())
    made = http.post("/v1/jobs", json={"method": "abstraction", "inputs": {"video": clip}, "webhook": receiver.url})
    assert made.status_code == 201, made.text
    links = made.json()["links"]
    received = events(http, made.json()["id"], 0)
    job = http.get(links["self"]).json()
    assert (job["state"], job["progress"], job["error"]) == ("succeeded", 1.0, None)
    assert [event["seq"] for event in received] == list(range(1, len(received) + 1))
    assert [e["data"]["state"] for e in received if e["type"] == "job.state"] == ["queued", "running", "succeeded"]
    assert events(http, job["id"], received[2]["seq"]) == received[3:]
    _check_result(http, links["result"])
    receiver.wait(1)
    headers, body = receiver.got[0]
    message = Webhook(http.get("/v1/webhooks/secret").json()["secret"]).verify(body, headers)
    assert message["type"] == "job.succeeded"


def _check_result(http: httpx.Client, where: str) -> None:
    whole = http.get(where)
    assert whole.headers["content-type"] == "video/mp4"
    with av.open(io.BytesIO(whole.content)) as video:
        assert sum(1 for _ in video.decode(video=0)) == 24
    part = http.get(where, headers={"Range": "bytes=100-199"})
    assert (part.status_code, part.content) == (206, whole.content[100:200])
    assert http.get(where, headers={"If-None-Match": whole.headers["etag"]}).status_code == 304
    files = http.get(where.replace("/result", "/files")).json()["items"]
    assert {"result", "poster", "sheet"} <= {row["name"] for row in files}
    for row in files:
        assert len(http.get(row["url"]).content) == row["size_bytes"]


def test_a_preview_has_the_requested_size(http: httpx.Client, clip: str) -> None:
    body = {"method": "abstraction", "inputs": {"video": clip}, "frame": 5, "max_side_px": 64}
    answer = http.post("/v1/previews", json=body)
    assert answer.status_code == 200, answer.text
    assert max(cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR).shape) == 64


def test_a_frame_of_the_source_is_served(http: httpx.Client, clip: str) -> None:
    first, last, beyond = (
        http.get(f"/v1/assets/{clip}/frame", params={"index": n, "max_side_px": 48}) for n in (0, 23, 900)
    )
    assert cv2.imdecode(np.frombuffer(first.content, np.uint8), cv2.IMREAD_COLOR).shape == (32, 48, 3)
    assert first.content != last.content == beyond.content
    text = http.post("/v1/assets", files={"file": ("a.json", b"{}")}).json()["id"]
    assert http.get(f"/v1/assets/{text}/frame").status_code == 422


def test_the_thumbnail_is_a_real_render(http: httpx.Client) -> None:
    answer = http.get(http.get("/v1/methods/abstraction").json()["thumbnail"])
    assert answer.headers["content-type"] == "image/jpeg"
    assert cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR).shape == (180, 320, 3)


def test_a_cancelled_job_can_be_deleted(http: httpx.Client, clip: str) -> None:
    job = http.post("/v1/jobs", json={"method": "abstraction", "inputs": {"video": clip}, "seed": 7}).json()["id"]
    assert http.post(f"/v1/jobs/{job}/cancel").status_code == 200
    assert [e["data"]["state"] for e in events(http, job, 0) if e["type"] == "job.state"][-1] == "cancelled"
    assert http.delete(f"/v1/jobs/{job}").status_code == 204
    assert http.get(f"/v1/jobs/{job}").status_code == 404


def test_metrics_report_the_state_of_a_real_farm(http: httpx.Client) -> None:
    lines = http.get("/metrics").text.splitlines()
    assert 'impasto_ready{part="pool"} 1.0' in lines
    assert 'impasto_jobs{state="running"} 0.0' in lines
