"""/v1/ops: restricted to admins, with clear problems, over the real fleet of an empty database."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.context.load_history import KEPT, LoadHistory
from service.settings import Settings
from tests.service.conftest import open_client
from tests.service.driven_farm import DrivenFarm
from workers.operator_views import LiveView, Slot, WorkerInfo
from workers.store import Store

ADMIN = {"Authorization": "Bearer top"}
READS = (
    "snapshot",
    "machine",
    "queue",
    "workers",
    "nodes",
    "failures",
    "live",
    "attempts/att_1/log",
    "jobs/job_1/timeline",
)
ACTS = ("queue/pause", "queue/resume", "workers/dsp_1@h/drain", "nodes/h/drain", "nodes/h/resume", "live/liv_1/end")


@pytest.fixture
def store(farm: DrivenFarm) -> Store:
    return farm.store


@pytest.fixture
def ops(farm: DrivenFarm, home: Path) -> Iterator[TestClient]:
    settings = Settings(home=home, auth="required", admin_key="top")
    yield from open_client(settings, farm, headers=ADMIN)


@pytest.fixture
def worker(store: Store) -> str:
    store.queue.renew("dsp_1@studio.files.local", 30)
    who = WorkerInfo("studio.files.local", "worker", "local", "1.0")
    store.workers.register("dsp_1@studio.files.local", who, [Slot("s0", "studio.files.local")])
    return "dsp_1@studio.files.local"


def test_only_admins_see_and_control_the_fleet(ops: TestClient, farm: DrivenFarm) -> None:
    _, secret = farm.keys.create("user", ["read", "submit"])
    for headers, status, code in (
        ({"Authorization": "Bearer none"}, 401, "unauthorized"),
        ({"Authorization": f"Bearer {secret}"}, 403, "forbidden"),
    ):
        for path in READS:
            answer = ops.get(f"/v1/ops/{path}", headers=headers)
            assert (answer.status_code, answer.json()["code"]) == (status, code), path
        for path in ACTS:
            answer = ops.post(f"/v1/ops/{path}", headers=headers)
            assert (answer.status_code, answer.json()["code"]) == (status, code), path
    assert ops.get("/v1/ops/queue").json() == {"paused": False, "drain": None}


def test_the_queue_is_paused_and_resumed(ops: TestClient) -> None:
    paused = ops.post("/v1/ops/queue/pause", json={"reason": "a leak"}).json()
    assert (paused["paused"], paused["drain"]["by"], paused["drain"]["reason"]) == (True, "admin", "a leak")
    assert ops.get("/v1/ops/queue").json() == paused == ops.post("/v1/ops/queue/pause").json()
    assert ops.post("/v1/ops/queue/resume").json() == {"paused": False, "drain": None}


def test_workers_and_machines_are_drained(ops: TestClient, worker: str) -> None:
    assert [(w["id"], w["state"]) for w in ops.get("/v1/ops/workers").json()["items"]] == [(worker, "live")]
    assert ops.post(f"/v1/ops/workers/{worker}/drain", json={"reason": "x"}).json()["name"] == worker
    assert ops.get("/v1/ops/workers").json()["items"][0]["state"] == "drained"
    assert ops.post(f"/v1/ops/workers/{worker}/resume").status_code == 204
    assert ops.post("/v1/ops/nodes/studio.files.local/drain").status_code == 200
    (node,) = ops.get("/v1/ops/nodes").json()["items"]
    assert (node["name"], node["state"], node["drain"]["by"]) == ("studio.files.local", "drained", "admin")
    assert ops.post("/v1/ops/nodes/studio.files.local/resume").status_code == 204
    assert ops.get("/v1/ops/workers").json()["items"][0]["state"] == "live"


@pytest.mark.parametrize(
    ("verb", "path", "body", "status", "code"),
    [
        ("POST", "workers/dsp_9@h/drain", None, 404, "not-found"),
        ("POST", "nodes/nobody/resume", None, 404, "not-found"),
        ("POST", "live/liv_9/end", None, 404, "not-found"),
        ("GET", "attempts/att_9/log", None, 404, "not-found"),
        ("GET", "jobs/job_9/timeline", None, 404, "not-found"),
        ("POST", "nodes/..%2Fetc/drain", None, 404, "not-found"),
        ("POST", "workers/a%20b/drain", None, 422, "bad-request"),
        ("GET", "failures?cursor=x", None, 422, "bad-parameter"),
        ("GET", "workers?limit=0", None, 422, "bad-request"),
        ("POST", "queue/pause", {"reason": "x" * 301}, 422, "bad-request"),
        ("POST", "queue/pause", {"why": "x"}, 422, "bad-request"),
    ],
)
def test_impossible_fleet_actions_return_a_problem_document(
    ops: TestClient, verb: str, path: str, body: Any, status: int, code: str
) -> None:
    answer = ops.request(verb, f"/v1/ops/{path}", json=body)
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.status_code == status, answer.text
    if status == 404 or code == "bad-parameter":
        assert answer.json()["code"] == code


def test_live_sessions_are_ended(ops: TestClient, store: Store) -> None:
    view = LiveView("liv_1", "", "key_1", "toy", 64, 36, store.workers.now(), True, {"fps": 24.0})
    store.workers.publish_live("p", [view])
    (session,) = ops.get("/v1/ops/live").json()["items"]
    assert (session["id"], session["figures"], session["ending"]) == ("liv_1", {"fps": 24.0}, False)
    assert ops.post("/v1/ops/live/liv_1/end").status_code == 202
    assert ops.get("/v1/ops/live").json()["items"][0]["ending"]
    assert store.workers.publish_live("p", [view]) == {"liv_1"}


def test_the_fleet_page_is_served_with_security_headers(ops: TestClient) -> None:
    answer = ops.get("/ops", headers={"Authorization": ""})
    assert answer.status_code == 200
    assert "unsafe" not in answer.headers["content-security-policy"]
    assert "<script>" not in answer.text and "style=" not in answer.text


def test_the_machine_has_its_load_and_disks(ops: TestClient) -> None:
    wait_until = time.monotonic() + 10
    while not (found := ops.get("/v1/ops/machine").json())["samples"]:
        assert time.monotonic() < wait_until
        time.sleep(0.05)
    assert found["cpus"] >= 1
    assert {disk["place"] for disk in found["disks"]} == {"home", "blobs", "scratch"}
    assert all(0 < disk["free_bytes"] <= disk["size_bytes"] for disk in found["disks"])
    sample = found["samples"][-1]
    assert 0 <= sample["cpu"] <= 1
    assert 0 < sample["memory_bytes"] < found["memory_bytes"]


def test_the_load_of_an_hour_is_kept() -> None:
    history = LoadHistory()
    for _ in range(KEPT + 5):
        history.sample()
    times = [sample.at for sample in history.samples]
    assert len(times) == KEPT
    assert times == sorted(times)
