"""Two services over one PostgreSQL and one S3 share their state and give the bytes of one service."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.settings import Settings
from service.webhooks.secrets import WebhookSecrets
from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.service.live import running
from tests.service.test_real_farm import events
from tests.waiting import until
from tests.workers.real_farm import real_settings
from workers.farm import open_farm

Open = Callable[..., httpx.Client]
SECRET = "a secret that all of them share, of some length"


@pytest.fixture
def opened() -> Iterator[Open]:
    """Starts services; stops them at the end."""
    with ExitStack() as stack:

        def open_one(**given: Any) -> httpx.Client:
            settings = Settings(**given)
            farm = open_farm(settings)
            stack.callback(farm.stop)
            farm.start()
            url = stack.enter_context(running(settings, farm))
            return stack.enter_context(httpx.Client(base_url=url, timeout=60))

        yield open_one


@pytest.fixture
def shared(postgres: Postgres, s3: Swift, tmp_path: Path) -> dict[str, Any]:
    """Common settings of services that share one database and one bucket."""
    given = real_settings(postgres, s3, tmp_path / "home").model_dump(exclude={"home", "pool", "workers", "lease_s"})
    return {**given, "webhook_secret": SECRET, "s3_direct": True}


def test_one_service_accepts_a_job_and_another_renders_it(
    opened: Open, shared: dict[str, Any], tmp_path: Path, tiny_clip: Path
) -> None:
    asked = opened(home=tmp_path / "asked", pool="none", **shared)
    working = opened(home=tmp_path / "working", **shared)
    alone = opened(home=tmp_path / "alone")
    results = []
    for submit, follow, fetch in ((asked, asked, working), (alone, alone, alone)):
        clip = submit.post("/v1/assets", files={"file": ("tiny.mp4", tiny_clip.read_bytes())}).json()["id"]
        made = submit.post("/v1/jobs", json={"method": "abstraction", "inputs": {"video": clip}})
        assert made.status_code == 201, made.text
        job = made.json()["id"]
        received = events(follow, job, 0)
        assert [e["data"]["state"] for e in received if e["type"] == "job.state"] == ["queued", "running", "succeeded"]
        assert [event["seq"] for event in received] == list(range(1, len(received) + 1))
        results.append(fetch.get(f"/v1/jobs/{job}/result").content)
        if fetch is working:
            _check_download(fetch, f"/v1/jobs/{job}/result", results[0])
    assert results[0] == results[1], "the stores change no byte"
    secrets = {service.get("/v1/webhooks/secret").json()["secret"] for service in (asked, working)}
    assert secrets == {WebhookSecrets(tmp_path, SECRET).of("")}
    ready = {"status": "ok", "parts": {"store": "ok", "blobs": "ok"}}
    until(lambda: asked.get("/readyz").json() == ready, 10)  # S3 may need seconds for an answer on a busy machine


def _check_download(http: httpx.Client, where: str, expected: bytes) -> None:
    """A download is redirected to S3; requests of the page are not."""
    sent_on = http.get(where, params={"download": "true"})
    assert sent_on.status_code == 307
    straight = httpx.get(sent_on.headers["location"])
    assert straight.content == expected
    assert straight.headers["content-type"] == "video/mp4"
    part = http.get(where, headers={"Range": "bytes=100-199"})
    assert (part.status_code, part.content) == (206, expected[100:200])


def test_a_deleted_job_leaves_no_blobs(
    opened: Open, shared: dict[str, Any], tmp_path: Path, s3: Swift, tiny_clip: Path
) -> None:
    service = opened(home=tmp_path / "one", **shared)
    clip = service.post("/v1/assets", files={"file": ("tiny.mp4", tiny_clip.read_bytes())}).json()["id"]
    job = service.post("/v1/jobs", json={"method": "abstraction", "inputs": {"video": clip}}).json()["id"]
    events(service, job, 0)
    assert service.delete(f"/v1/jobs/{job}").status_code == 204
    assert service.delete(f"/v1/assets/{clip}").status_code == 204
    prefix = shared["blob_url"].partition(f"{s3.shared_bucket}/")[2]
    left = s3.client().list_objects_v2(Bucket=s3.shared_bucket, Prefix=f"{prefix}/").get("Contents", [])
    assert [found["Key"] for found in left] == []
