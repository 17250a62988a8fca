"""Admission of requests: no route and no owner takes all threads; work for a client that has left does not begin."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import httpx
import pytest

from service.access.admission import Cost, classes, cost_of
from service.app import ROUTERS
from service.settings import Settings
from tests.service.driven_farm import DrivenFarm
from tests.service.live import running
from tests.waiting import SLOWER, until
from workers.errors import NotFound


class _Slow:
    """Looking up a job takes until `go` is set."""

    def __init__(self) -> None:
        self.go, self.begun = threading.Event(), 0

    def get(self, _job_id: str) -> None:
        self.begun += 1
        assert self.go.wait(60)
        raise NotFound("Job not found.", field="job")


@pytest.fixture
def slow(farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch) -> Iterator[_Slow]:
    made = _Slow()
    monkeypatch.setattr(farm.jobs, "get", made.get)
    yield made
    made.go.set()


@contextmanager
def _flood(url: str, path: str, key: str, count: int) -> Iterator[list[socket.socket]]:
    """Connections that have sent a request and do not read the answer."""
    host, port = url.removeprefix("http://").split(":")
    opened = [socket.create_connection((host, int(port))) for _ in range(count)]
    for each in opened:
        each.sendall(f"GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nAuthorization: Bearer {key}\r\n\r\n".encode())
    try:
        yield opened
    finally:
        for each in opened:
            each.close()


def _seconds(http: httpx.Client, path: str) -> float:
    began = time.monotonic()
    assert http.get(path).status_code == 200
    return time.monotonic() - began


@pytest.mark.parametrize("path", ["/v1/jobs/job_x/queue", "/v1/jobs/job_x", "/v1/jobs/job_x/artefacts/maps"])
def test_requests_of_one_key_never_delay_another_owner(
    settings: Settings, farm: DrivenFarm, slow: _Slow, path: str
) -> None:
    """200 requests of anna that take forever, whatever their route: ben's list and the health answer at once."""
    keys = [farm.keys.create(name, ["read"])[1] for name in ("anna", "ben")]
    closed = settings.model_copy(update={"auth": "required"})
    with running(closed, farm) as url, _flood(url, path, keys[0], 200):
        until(lambda: slow.begun >= 2)
        with httpx.Client(base_url=url, timeout=20, headers={"Authorization": f"Bearer {keys[1]}"}) as http:
            taken = [_seconds(http, each) for each in ("/v1/jobs", "/healthz", "/readyz", "/v1/assets") * 5]
        assert max(taken) < SLOWER, taken
        assert slow.begun <= classes(closed)[Cost.QUERY].by_owner
        slow.go.set()


def test_work_for_a_client_that_left_does_not_begin(settings: Settings, farm: DrivenFarm, slow: _Slow) -> None:
    key = farm.keys.create("anna", ["read"])[1]
    closed = settings.model_copy(update={"auth": "required"})
    with running(closed, farm) as url:
        with _flood(url, "/v1/jobs/job_x", key, 60):
            until(lambda: slow.begun == classes(closed)[Cost.QUERY].by_owner)
            time.sleep(0.3)  # the others wait
        time.sleep(0.6)  # they are noticed
        slow.go.set()
        time.sleep(0.3)
        assert slow.begun == classes(closed)[Cost.QUERY].by_owner


def test_the_only_user_of_a_service_without_keys_may_use_all_slots(
    settings: Settings, farm: DrivenFarm, slow: _Slow
) -> None:
    most = classes(settings)[Cost.QUERY].at_once
    with running(settings, farm) as url, ThreadPoolExecutor(most) as threads:
        asked = [threads.submit(httpx.get, f"{url}/v1/jobs/job_x", timeout=60) for _ in range(most)]
        until(lambda: slow.begun == most)
        slow.go.set()
        assert {future.result().status_code for future in asked} == {404}


def test_every_synchronous_route_has_a_class() -> None:
    routes = [route for router in ROUTERS for route in router.routes if hasattr(route, "endpoint")]
    assert len(routes) > 90
    found = {route.path: cost_of(route.endpoint) for route in routes}  # type: ignore[attr-defined]
    assert found["/v1/jobs/{job_id}/queue"] is Cost.QUERY and found["/readyz"] is Cost.HEALTH
    assert {path for path, cost in found.items() if cost is Cost.FRAMES} == {
        "/v1/jobs/{job_id}/frames/{index}", "/v1/assets/{asset_id}/frame", "/v1/styles/{style_id}/picture",
    }  # fmt: skip
