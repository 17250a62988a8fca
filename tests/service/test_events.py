"""/v1/jobs/{id}/events: order, resumption, lost history, heartbeats, the end."""

from __future__ import annotations

import json
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi.testclient import TestClient

from service.access.keys import Principal
from service.context.depends import Streams
from service.settings import Settings
from tests.service.conftest import open_client
from tests.service.driven_farm import DrivenFarm
from tests.service.live import running
from tests.waiting import SLOWER
from workers.contract.record import RunState

ServerEvent = dict[str, Any]


def listen(client: TestClient, job: str, last: int | None = None) -> list[ServerEvent]:
    """All events until the stream ends; comments have the type ":"."""
    headers = {} if last is None else {"Last-Event-ID": str(last)}
    answer = client.get(f"/v1/jobs/{job}/events", headers=headers)
    assert answer.headers["content-type"].startswith("text/event-stream")
    return [found for block in answer.text.split("\n\n") if (found := _event(block))]


def _event(block: str) -> ServerEvent | None:
    rows = dict(line.split(": ", 1) if not line.startswith(":") else (":", line) for line in block.split("\n") if line)
    if ":" in rows:
        return {"event": ":"}
    return rows | {"data": json.loads(rows["data"])} if "event" in rows else None


def test_the_event_stream_of_a_finished_job_sends_its_history_and_ends(
    client: TestClient, farm: DrivenFarm, job: str
) -> None:
    farm.tell(job, "job.progress", {"progress": 0.5})
    farm.finish(job)
    events = listen(client, job)
    assert [int(event["id"]) for event in events] == list(range(1, len(events) + 1))
    assert [event["event"] for event in events[:2]] == ["job.state", "job.progress"]
    assert events[-1]["data"]["data"]["state"] == "succeeded"
    assert events[1]["data"]["data"] == {"progress": 0.5}
    assert events[1]["data"]["seq"] == 2


def test_the_event_stream_resumes_after_the_last_event(client: TestClient, farm: DrivenFarm, job: str) -> None:
    farm.tell(job, "log", {})
    farm.finish(job)
    whole = [event["id"] for event in listen(client, job)]
    assert [event["id"] for event in listen(client, job, last=2)] == whole[2:]


def test_a_stream_without_further_events_is_204(client: TestClient, farm: DrivenFarm, job: str) -> None:
    farm.finish(job)
    newest = listen(client, job)[-1]["id"]
    answer = client.get(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": newest})
    assert (answer.status_code, answer.content) == (204, b"")


def test_new_events_are_sent_and_idle_streams_get_comments(client: TestClient, farm: DrivenFarm, job: str) -> None:
    def work() -> None:
        farm.move(job, RunState.RUNNING)
        farm.finish(job)

    threading.Timer(0.7, work).start()  # heartbeats are sent every 0.2 s
    events = listen(client, job)
    assert [event["data"]["data"]["state"] for event in events if event["event"] == "job.state"] == [
        "queued",
        "running",
        "succeeded",
    ]
    assert {"event": ":"} in events


def test_streams_that_wait_take_no_threads(settings: Settings, farm: DrivenFarm) -> None:
    """Sixty streams of a job that waits, and then ends."""
    with running(settings, farm) as url, httpx.Client(base_url=url, timeout=60) as http, ExitStack() as opened:
        clip = http.post("/v1/assets", files={"file": ("a.mp4", b"CLIP")}).json()["id"]
        job = http.post("/v1/jobs", json={"method": "toy", "inputs": {"video": clip}}).json()["id"]
        before = threading.active_count()
        asked = [opened.enter_context(http.stream("GET", f"/v1/jobs/{job}/events")) for _ in range(60)]
        lines = [answer.iter_lines() for answer in asked]
        assert all(next(each).startswith("retry") for each in lines)
        time.sleep(0.5)
        assert threading.active_count() - before < 25, "a few read histories"
        farm.finish(job)
        assert all(any('"succeeded"' in line for line in each) for each in lines)


def test_streams_of_one_owner_leave_some_to_others() -> None:
    streams, anna, ben = Streams(4), Principal("anna", frozenset()), Principal("ben", frozenset())
    with streams.one(anna), streams.one(anna):
        assert streams.full(anna) and not streams.full(ben)
        with streams.one(ben):
            assert streams.full(ben) and not streams.full(Principal("cleo", frozenset()))
    assert streams.count() == 0 and not streams.full(anna)


def test_lost_history_is_reported(settings: Settings, only_toy: None, home: Path) -> None:
    farm = DrivenFarm(home, events_kept=10)
    for client in open_client(settings, farm):
        clip = client.post("/v1/assets", files={"file": ("a.mp4", b"CLIP")}).json()["id"]
        job = client.post("/v1/jobs", json={"method": "toy", "inputs": {"video": clip}}).json()["id"]
        for _ in range(120):  # history is pruned every hundred events
            farm.tell(job, "log", {})
        farm.finish(job)
        events = listen(client, job, last=1)
        assert [event["event"] for event in events[:2]] == ["history-gone", "log"]
        assert events[0]["data"] == {"job_id": job, "after": 1, "goes_on_with": int(events[1]["id"])}
        assert events[-1]["data"]["data"]["state"] == "succeeded"


def test_deleting_a_job_ends_its_event_stream(client: TestClient, farm: DrivenFarm, job: str) -> None:
    def delete() -> None:
        farm.finish(job)
        farm.jobs.delete(job)

    threading.Timer(0.4, delete).start()
    assert listen(client, job)[0]["event"] == "job.state"


def test_closing_the_service_ends_event_streams(client: TestClient, job: str) -> None:
    closing = client.app.state.service.closing  # type: ignore[attr-defined]
    threading.Timer(0.4, closing.set).start()
    began = time.monotonic()
    listen(client, job)
    assert time.monotonic() - began < 3 * SLOWER


@pytest.mark.parametrize("last", ["x", "-1", "1.5"])
def test_a_non_numeric_last_event_id_is_refused(client: TestClient, job: str, last: str) -> None:
    answer = client.get(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": last})
    assert (answer.status_code, answer.json()["field"]) == (422, "last-event-id")


def test_surplus_streams_are_refused_with_retry_after(settings: Settings, farm: DrivenFarm) -> None:
    for client in open_client(settings, farm):
        clip = client.post("/v1/assets", files={"file": ("a.mp4", b"CLIP")}).json()["id"]
        job = client.post("/v1/jobs", json={"method": "toy", "inputs": {"video": clip}}).json()["id"]
        streams = client.app.state.service.streams  # type: ignore[attr-defined]
        streams._most = 0
        answer = client.get(f"/v1/jobs/{job}/events")
        assert (answer.status_code, answer.headers["retry-after"]) == (503, "5")
