"""Health, metrics, previews, pages, headers, and what the OpenAPI document promises."""

from __future__ import annotations

import re
import threading
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families
from sqlalchemy import update

from pipeline.errors import ImpastoError, StorageError
from service.access.admission import Cost
from service.errors import TABLE
from tests.service.driven_farm import DrivenFarm
from workers.store import schema


def test_health_and_readiness_report_the_parts(client: TestClient, farm: DrivenFarm) -> None:
    assert client.get("/healthz").json() == {"status": "ok"}
    assert client.get("/readyz").json() == {"status": "ok", "parts": farm.parts}
    farm.parts = farm.parts | {"blobs": "The disk is full."}
    answer = client.get("/readyz")
    assert (answer.status_code, answer.json()["status"]) == (503, "unavailable")
    assert answer.json()["parts"]["blobs"] == "The disk is full."
    assert client.get("/healthz").status_code == 200


def test_the_consistency_check_reports_violations(client: TestClient, farm: DrivenFarm, job: str) -> None:
    assert client.get("/v1/ops/check").json() == {"violations": []}
    with farm.store.database.write() as connection:
        connection.execute(update(schema.jobs).values(finished_at=1.0))
    (found,) = client.get("/v1/ops/check").json()["violations"]
    assert (found["kind"], found["id"]) == ("wrong-times", job) and found["message"] and found["remedy"]


def test_metrics_have_base_units_and_bounded_labels(client: TestClient, farm: DrivenFarm, job: str) -> None:
    for number in range(30):
        client.get(f"/v1/jobs/job_{number}")
        client.get(f"/nowhere/{number}")
        client.request("PURGE", "/v1/jobs")
    answer = client.get("/metrics")
    families = {family.name: family for family in text_string_to_metric_families(answer.text)}
    requests = families["impasto_http_requests"]
    routes = {sample.labels["route"] for sample in requests.samples}
    assert {"/v1/jobs/{job_id}", "/v1/jobs", "/v1/assets"} <= routes
    assert not any(re.search(r"job_\d|/nowhere", route) for route in routes)
    assert "PURGE" not in {sample.labels["method"] for sample in requests.samples}
    counters = [family for family in families.values() if family.type == "counter" and family.samples]
    assert all(family.samples[0].name.endswith("_total") for family in counters)
    looked = [
        s.value for s in requests.samples if s.labels["route"] == "/v1/jobs/{job_id}" and s.name.endswith("total")
    ]
    assert looked == [30.0]


def test_metrics_describe_the_farm(client: TestClient, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch) -> None:
    snapshot = {"jobs": {"queued": 3}, "queue": {"ready_tasks": 7, "oldest_s": 1.5}, "failures": {"bad-media": 2}}
    totals = {
        "failures": {"bad-media": 5},
        "frames": {"toy": 120},
        "attempts": {"succeeded": 9},
        "busy_s": {"toy": 2.5},
    }
    monkeypatch.setattr(farm, "snapshot", lambda: snapshot | {"totals": totals})
    text = client.get("/metrics").text
    for line in (
        'impasto_jobs{state="queued"} 3.0',
        "impasto_queue_ready_tasks 7.0",
        "impasto_queue_oldest_seconds 1.5",
        'impasto_recent_attempt_failures{code="bad-media"} 2.0',
        'impasto_ready{part="blobs"} 1.0',
        'impasto_attempt_failures_total{code="bad-media"} 5.0',
        'impasto_attempts_total{outcome="succeeded"} 9.0',
        'impasto_frames_total{method="toy"} 120.0',
        'impasto_attempt_seconds_total{method="toy"} 2.5',
    ):
        assert line in text.splitlines()


def test_metrics_are_served_while_the_store_is_unavailable(
    client: TestClient, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away() -> dict[str, Any]:
        raise StorageError("The database is away.")

    monkeypatch.setattr(farm, "snapshot", away)
    farm.parts = {"store": "The database is away."}
    answer = client.get("/metrics")
    assert answer.status_code == 200
    assert 'impasto_ready{part="store"} 0.0' in answer.text


def test_a_preview_is_an_image(client: TestClient, body: dict[str, Any]) -> None:
    answer = client.post("/v1/previews", json=body | {"frame": 3, "max_side_px": 32})
    assert answer.headers["content-type"] == "image/png"
    assert cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR).shape == (18, 32, 3)


def test_surplus_previews_are_refused_with_retry_after(
    client: TestClient, farm: DrivenFarm, body: dict[str, Any]
) -> None:
    farm.preview_gate.clear()
    statuses: list[int] = []

    def ask() -> None:
        statuses.append(client.post("/v1/previews", json=body).status_code)

    work = [threading.Thread(target=ask) for _ in range(2)]
    for thread in work:
        thread.start()
    admission = client.app.state.service.admission  # type: ignore[attr-defined]
    while admission.held(Cost.PREVIEWS) < 2:
        threading.Event().wait(0.01)
    busy = client.post("/v1/previews", json=body)
    farm.preview_gate.set()
    for thread in work:
        thread.join()
    assert (busy.status_code, busy.json()["code"], busy.headers["retry-after"]) == (503, "busy", "1")
    assert statuses == [200, 200]
    assert client.post("/v1/previews", json=body).status_code == 200


@pytest.mark.parametrize("path", ["/", "/docs", "/docs/docs.js", "/docs/docs.css", "/v1/methods", "/v1/none", "/x"])
def test_every_answer_has_the_security_headers(client: TestClient, path: str) -> None:
    headers = client.get(path).headers
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert "default-src 'self'" in headers["content-security-policy"]
    assert "unsafe" not in headers["content-security-policy"]
    assert "access-control-allow-origin" not in headers


def test_pages_load_nothing_from_other_hosts(client: TestClient) -> None:
    for path in ("/", "/docs", "/docs/docs.js", "/docs/docs.css"):
        text = client.get(path).text
        assert not re.search(r"""(src|href)=["'](https?:)?//|import .*["']https?://|url\(["']?https?:""", text), path


def test_the_openapi_description_is_complete(client: TestClient) -> None:
    api = client.get("/openapi.json").json()
    assert api["openapi"].startswith("3.1")
    assert "Problem" in api["components"]["schemas"]
    names = [row["operationId"] for item in api["paths"].values() for row in item.values()]
    assert len(names) == len(set(names))
    assert all(row.get("description") for item in api["paths"].values() for row in item.values())


def test_every_error_code_has_a_status() -> None:
    def codes(kind: type[ImpastoError]) -> set[str]:
        return {kind.code}.union(*(codes(below) for below in kind.__subclasses__()))

    client_side = {"service-unreachable", "not-allowed", "job-failed", "interrupted"}
    client_side |= {"live-ended", "source-lost", "output-lost"}
    assert codes(ImpastoError) - client_side <= set(TABLE)


def _ahead(client: TestClient, job_id: str) -> int:
    return int(client.get(f"/v1/jobs/{job_id}/queue").json()["jobs_ahead"])


def test_an_operator_moves_a_job_to_the_front(client: TestClient, body: dict[str, Any]) -> None:
    _, _, last = (
        client.post("/v1/jobs", json=body | {"seed": seed, "priority": p}).json()["id"]
        for seed, p in ((1, 0), (2, 7), (3, 0))
    )
    assert _ahead(client, last) == 2
    moved = client.post(f"/v1/ops/jobs/{last}/priority", json={"priority": None}).json()
    assert moved["request"]["priority"] == 8 and _ahead(client, last) == 0
    assert client.post(f"/v1/ops/jobs/{last}/priority", json={"priority": -3}).json()["request"]["priority"] == -3
    assert _ahead(client, last) == 2
    assert client.post(f"/v1/ops/jobs/{last}/priority", json={"priority": 101}).status_code == 422
    client.post(f"/v1/jobs/{last}/cancel")
    assert client.post(f"/v1/ops/jobs/{last}/priority", json={}).status_code == 409


def test_an_action_on_several_jobs_tells_of_each(client: TestClient, body: dict[str, Any]) -> None:
    jobs = [client.post("/v1/jobs", json=body | {"seed": seed}).json()["id"] for seed in (1, 2)]
    client.post(f"/v1/jobs/{jobs[0]}/cancel")

    def act(action: str) -> list[str | None]:
        items = client.post("/v1/ops/jobs/actions", json={"action": action, "jobs": [*jobs, "job_none"]}).json()[
            "items"
        ]
        assert [item["job_id"] for item in items] == [*jobs, "job_none"]
        return [item["error"] and item["error"]["code"] for item in items]

    assert act("cancel") == ["conflict", None, "not-found"]
    assert act("retry") == [None, None, "not-found"]
    assert act("delete") == ["conflict", "conflict", "not-found"]
    assert act("cancel") == [None, None, "not-found"]
    assert act("delete") == [None, None, "not-found"]
    assert client.get("/v1/jobs").json()["items"] == []


def test_jobs_are_found_by_a_part_of_what_names_them(client: TestClient, body: dict[str, Any]) -> None:
    ids = {name: client.post("/v1/jobs", json=body | {"name": name}).json()["id"] for name in ("Swan 50%", "cat", "")}

    def found(text: str) -> set[str]:
        return {item["id"] for item in client.get("/v1/jobs", params={"search": text}).json()["items"]}

    assert found("swan") == found("50%") == {ids["Swan 50%"]}
    assert found(ids["cat"]) == {ids["cat"]} and found("%a%") == set()
    assert found(body["method"]) == set(ids.values())
