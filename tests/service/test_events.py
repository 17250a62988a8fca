"""/v1/jobs/{id}/events: order, resumption, lost history, heartbeats, the end."""

from __future__ import annotations

import json
import threading
import time
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.settings import Settings
from tests.service.conftest import open_client
from tests.service.fake_farm import FakeFarm
from workers.model import RunState

Told = dict[str, Any]


def listen(client: TestClient, job: str, last: int | None = None) -> list[Told]:
    """Every event until the stream ends; comments are events of type ":"."""
    headers = {} if last is None else {"Last-Event-ID": str(last)}
    answer = client.get(f"/v1/jobs/{job}/events", headers=headers)
    assert answer.headers["content-type"].startswith("text/event-stream")
    return [found for block in answer.text.split("\n\n") if (found := _event(block))]


def _event(block: str) -> Told | None:
    rows = dict(line.split(": ", 1) if not line.startswith(":") else (":", line) for line in block.split("\n") if line)
    if ":" in rows:
        return {"event": ":"}
    return rows | {"data": json.loads(rows["data"])} if "event" in rows else None


def test_a_finished_job_tells_its_history_and_ends(client: TestClient, farm: FakeFarm, job: str) -> None:
    farm.tell(job, "job.progress", {"progress": 0.5})
    farm.finish(job)
    told = listen(client, job)
    assert [(event["id"], event["event"]) for event in told] == [
        ("1", "job.state"),
        ("2", "job.progress"),
        ("3", "job.state"),
    ]
    assert told[1]["data"]["data"] == {"progress": 0.5}
    assert told[1]["data"]["seq"] == 2


def test_it_resumes_after_the_last_event(client: TestClient, farm: FakeFarm, job: str) -> None:
    farm.tell(job, "log", {})
    farm.finish(job)
    assert [event["id"] for event in listen(client, job, last=2)] == ["3"]


def test_nothing_more_to_come_is_204(client: TestClient, farm: FakeFarm, job: str) -> None:
    farm.finish(job)
    answer = client.get(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": "2"})
    assert (answer.status_code, answer.content) == (204, b"")


def test_what_happens_meanwhile_is_told_and_silence_is_filled(client: TestClient, farm: FakeFarm, job: str) -> None:
    def work() -> None:
        time.sleep(0.7)
        farm.move(job, RunState.RUNNING)
        farm.finish(job)

    worker = threading.Thread(target=work)
    worker.start()
    told = listen(client, job)
    worker.join()
    assert [event["data"]["data"]["state"] for event in told if event["event"] != ":"] == [
        "queued",
        "running",
        "succeeded",
    ]
    assert {"event": ":"} in told


def test_lost_history_is_said(settings: Settings, only_toy: None) -> None:
    farm = FakeFarm(events_kept=2)
    for client in open_client(settings, farm):
        clip = client.post("/v1/assets", files={"file": ("a.mp4", b"CLIP")}).json()["id"]
        job = client.post("/v1/jobs", json={"method": "toy", "inputs": {"video": clip}}).json()["id"]
        for _ in range(4):
            farm.tell(job, "log", {})
        farm.finish(job)
        told = listen(client, job, last=1)
        assert [event["event"] for event in told] == ["history-gone", "log", "job.state"]
        assert told[0]["data"] == {"job_id": job, "after": 1, "goes_on_with": 5}


def test_deleting_a_job_ends_its_stream(client: TestClient, farm: FakeFarm, job: str) -> None:
    threading.Timer(0.4, lambda: farm.all_jobs.pop(job)).start()
    assert listen(client, job)[0]["event"] == "job.state"


def test_closing_ends_streams(client: TestClient, job: str) -> None:
    closing = client.app.state.service.closing  # type: ignore[attr-defined]
    threading.Timer(0.4, closing.set).start()
    began = time.monotonic()
    listen(client, job)
    assert time.monotonic() - began < 3


@pytest.mark.parametrize("last", ["x", "-1", "1.5"])
def test_a_last_event_that_is_no_number(client: TestClient, job: str, last: str) -> None:
    answer = client.get(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": last})
    assert (answer.status_code, answer.json()["field"]) == (422, "last-event-id")


def test_more_streams_than_may_are_told_to_come_back(settings: Settings, farm: FakeFarm) -> None:
    for client in open_client(settings, farm):
        clip = client.post("/v1/assets", files={"file": ("a.mp4", b"CLIP")}).json()["id"]
        job = client.post("/v1/jobs", json={"method": "toy", "inputs": {"video": clip}}).json()["id"]
        streams = client.app.state.service.streams  # type: ignore[attr-defined]
        streams._most = 0
        answer = client.get(f"/v1/jobs/{job}/events")
        assert (answer.status_code, answer.headers["retry-after"]) == (503, "5")
