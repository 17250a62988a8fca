"""/v1/jobs and /v1/tasks: shapes, idempotency, paging, control."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient

from tests.service.driven_farm import DrivenFarm
from workers.contract.record import Fault, RunState, TaskState


def test_a_job_document_has_the_fields_of_the_dataclass_and_links(
    client: TestClient, body: dict[str, Any], asset: str
) -> None:
    request = body | {"params": {"mode": "hard"}, "labels": {"shot": "12"}, "output": {"artefacts": ["svg"]}}
    answer = client.post("/v1/jobs", json=request)
    job = answer.json()
    assert answer.status_code == 201
    assert answer.headers["location"] == f"/v1/jobs/{job['id']}" == job["links"]["self"]
    assert job["request"] == {
        "method": "toy",
        "inputs": {"video": asset},
        "params": {"mode": "hard"},
        "seed": 0,
        "output": {
            "format": "mp4",
            "quality": 20,
            "artefacts": ["svg"],
            "report": False,
            "profile": "",
            "alpha": "auto",
            "colour": "",
            "passes": [],
            "passes_format": "",
        },
        "priority": 0,
        "name": "",
        "labels": {"shot": "12"},
        "webhook": "",
        "frames": None,
        "on_damage": "warn",
        "source": {
            "picture": None,
            "sound": None,
            "fields": "auto",
            "premultiplied": False,
            "colour": "",
            "colour_view": "",
        },
    }
    assert job["state"] == "queued"
    assert isinstance(job["created_at"], float)
    assert client.get(job["links"]["self"]).json() == job


def test_an_idempotency_key_creates_one_job(client: TestClient, body: dict[str, Any]) -> None:
    key = {"Idempotency-Key": "once"}
    first, again = (client.post("/v1/jobs", json=body, headers=key) for _ in range(2))
    other = client.post("/v1/jobs", json=body | {"seed": 1}, headers=key)
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.json() == again.json()
    assert (other.status_code, other.json()["code"]) == (422, "idempotency-mismatch")


def test_paging_visits_every_job_once_newest_first(client: TestClient, body: dict[str, Any]) -> None:
    made = [client.post("/v1/jobs", json=body).json()["id"] for _ in range(5)]
    listed, cursor = [], None
    for _ in range(3):
        page = client.get("/v1/jobs", params={"limit": 2} | ({"cursor": cursor} if cursor else {})).json()
        listed += [job["id"] for job in page["items"]]
        cursor = page["cursor"]
    assert listed == made[::-1]
    assert cursor is None


def test_jobs_are_filtered_by_label_and_state(client: TestClient, farm: DrivenFarm, body: dict[str, Any]) -> None:
    shot = client.post("/v1/jobs", json=body | {"labels": {"shot": "a:1"}}).json()["id"]
    farm.move(client.post("/v1/jobs", json=body).json()["id"], RunState.RUNNING)

    def ids(**query: str) -> list[str]:
        return [job["id"] for job in client.get("/v1/jobs", params=query).json()["items"]]

    assert ids(label="shot:a:1") == [shot] == ids(state="queued")
    assert ids(method="oil") == []
    assert len(ids(method="toy")) == 2


@pytest.mark.parametrize(
    ("state", "verb", "after"),
    [
        (RunState.RUNNING, "cancel", "cancelled"),
        (RunState.RUNNING, "pause", "paused"),
        (RunState.PAUSED, "resume", "running"),
        (RunState.FAILED, "retry", "queued"),
    ],
)
def test_control_actions_change_the_state_of_a_job(
    client: TestClient, farm: DrivenFarm, job: str, state: RunState, verb: str, after: str
) -> None:
    farm.move(job, state)
    answer = client.post(f"/v1/jobs/{job}/{verb}")
    assert (answer.status_code, answer.json()["state"]) == (200, after)


@pytest.mark.parametrize("verb", ["cancel", "resume", "retry"])
def test_control_actions_on_a_finished_job_are_409(client: TestClient, farm: DrivenFarm, job: str, verb: str) -> None:
    farm.finish(job)
    answer = client.post(f"/v1/jobs/{job}/{verb}")
    assert (answer.status_code, answer.json()["code"]) == (409, "conflict")


def test_a_failed_job_reports_why(client: TestClient, farm: DrivenFarm, job: str) -> None:
    farm.move(job, RunState.FAILED, Fault("unreadable-media", "Frame 7 is broken.", "Encode it again."))
    error = client.get(f"/v1/jobs/{job}").json()["error"]
    assert (error["code"], error["remedy"]) == ("unreadable-media", "Encode it again.")


def test_only_finished_jobs_can_be_deleted(client: TestClient, farm: DrivenFarm, job: str) -> None:
    assert client.delete(f"/v1/jobs/{job}").status_code == 409
    farm.finish(job)
    assert client.delete(f"/v1/jobs/{job}").status_code == 204
    assert client.get(f"/v1/jobs/{job}").status_code == 404


def test_tasks_of_a_job_are_listed_with_their_logs(client: TestClient, farm: DrivenFarm, job: str) -> None:
    task = farm.add_task(job, TaskState.FAILED)
    assert [row["id"] for row in client.get(f"/v1/jobs/{job}/tasks").json()["items"]] == [task.id]
    assert client.get(f"/v1/jobs/{job}/tasks", params={"state": "ready"}).json()["items"] == []
    assert client.get(f"/v1/tasks/{task.id}").json()["key"] == "run-0"
    assert client.get(f"/v1/tasks/{task.id}/log").json() == {
        "task_id": task.id,
        "log": "== attempt 1, failed, worker-0\nlog of run-0\n",
    }
    assert client.post(f"/v1/tasks/{task.id}/requeue").json()["state"] == "ready"
