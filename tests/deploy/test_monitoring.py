"""A real Prometheus with our configuration scrapes a real, busy service: every metric of the dashboards exists."""

from __future__ import annotations

import asyncio
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.conftest import tiny_frame
from tests.deploy.expressions import alerts, drawn, metrics_in, shipped
from tests.e2e.processes import Service
from tests.real.prometheus import Prometheus
from tests.service.live_client import jpeg, live
from tests.waiting import until

pytestmark = pytest.mark.real("prometheus")

ADMIN = "an admin key of about forty characters in all"
EMPTY = {
    "service timeseries: Errors by route A",  # no 5xx
    "farm timeseries: Failures by code A",  # no attempt failed
    "farm timeseries: Failures by code B",
    "stores timeseries: 503 and 507 A",
    "stores timeseries: Storage failures A",
}
"""Panels that have no data on a healthy system."""
LATE_S = 30.0
"""A scrape that takes longer than a second, as on a busy machine, leaves all series without data until the next."""


class Run:
    """A service and a Prometheus that watches it, after a job, a live session and some wrong requests."""

    def __init__(self, folder: Path, clip: Path) -> None:
        self.service = Service(folder / "home", "local", 1)
        self.prometheus: Any = None
        try:
            self._work(folder, clip)
        except BaseException:
            self.close()
            raise

    def _work(self, folder: Path, clip: Path) -> None:
        self.service.start()
        self.service.wait_ready()
        self.http = httpx.Client(base_url=self.service.url, headers={"Authorization": f"Bearer {ADMIN}"}, timeout=30)
        self._await_ready(folder)
        self.job = self._paint(clip)
        self._stream()
        self.http.get("/v1/jobs/job_none")
        self.http.get("/v1/jobs", headers={"Authorization": "Bearer wrong"})
        self._settle()

    def _await_ready(self, folder: Path) -> None:
        body = {"name": "prometheus", "scopes": ["read"]}
        key = self.http.post("/v1/keys", json=body).raise_for_status().json()["secret"]
        self.prometheus = Prometheus(folder, key, [self.service.url.removeprefix("http://")])
        self.prometheus.start()
        until(lambda: self.prometheus.query('up{job="impasto"} == 1'), 30)

    def _paint(self, clip: Path) -> str:
        asset = self.http.post("/v1/assets", files={"file": ("a.mp4", clip.read_bytes())}).json()["id"]
        job = self.http.post("/v1/jobs", json={"method": "abstraction", "inputs": {"video": asset}}).json()["id"]
        until(lambda: self.http.get(f"/v1/jobs/{job}").json()["state"] == "succeeded", 120)
        return str(job)

    def _stream(self) -> None:
        async def talk() -> None:
            key = {"additional_headers": {"Authorization": f"Bearer {ADMIN}"}}
            async with live(self.service.url, **key) as client:
                await client.send_message({"type": "hello", "width": 96, "height": 64, "method": "abstraction"})
                await client.message("ready", 60)
                for index in range(4):
                    await client.send(jpeg(tiny_frame(index)))
                    await client.answer(60)

        asyncio.run(talk())

    def _settle(self) -> None:
        """Wait until everything has been scraped and the rules evaluated, which takes several scrapes."""
        until(lambda: self.prometheus.query('increase(impasto_live_frames_total{outcome="painted"}[30s]) > 0'), 30)
        for _ in range(12):
            self.http.get("/v1/jobs").raise_for_status()
            time.sleep(0.3)

    def close(self) -> None:
        if self.prometheus is not None:
            self.prometheus.close()
        self.service.stop()

    def log(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.service.log.read_text().splitlines() if line.startswith("{")]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, tiny_clip: Path) -> Iterator[Run]:
    given = {"AUTH": "required", "ADMIN_KEY": ADMIN, "LOG_FORMAT": "json", "LOG_LEVEL": "info"}
    before = dict(os.environ)
    os.environ.update({f"IMPASTO_{name}": value for name, value in given.items()})
    try:
        found = Run(tmp_path_factory.mktemp("run"), tiny_clip)
    finally:
        os.environ.clear()
        os.environ.update(before)
    yield found
    found.close()


def test_every_queried_metric_is_exported(run: Run) -> None:
    exported = set(run.prometheus.ask("label/__name__/values")) | {"ALERTS"}
    exported |= _families(run.http.get("/metrics").text)
    unknown = {
        where: sorted(names - exported) for where, expr in shipped().items() if (names := metrics_in(expr)) - exported
    }
    assert not unknown


def _families(text: str) -> set[str]:
    """Names of the metrics that the service declares, also those without samples."""
    return {line.split()[2] for line in text.splitlines() if line.startswith("# TYPE ")}


def test_every_panel_has_data(run: Run) -> None:
    def without_data() -> set[str]:
        rows = {where: run.prometheus.query(expr) for where, expr in drawn().items()}
        return {where for where, found in rows.items() if not (_one_number(found) if " stat: " in where else found)}

    until(lambda: without_data() <= EMPTY, LATE_S)


def _one_number(rows: list[dict[str, Any]]) -> bool:
    return len(rows) == 1 and rows[0]["value"][1] != "NaN"


def test_every_rule_evaluates_and_no_alert_fires_on_a_healthy_system(run: Run) -> None:
    rules = [rule for group in run.prometheus.ask("rules")["groups"] for rule in group["rules"]]
    assert {rule["name"] for rule in rules} == {rule["alert"] for rule in alerts()}
    assert {rule["health"] for rule in rules} == {"ok"}
    assert [rule["name"] for rule in rules if rule["state"] == "firing"] == []


def test_metric_values_match_the_run(run: Run) -> None:
    def value(expr: str) -> float:
        (row,) = until(lambda: run.prometheus.query(expr), LATE_S)
        return float(row["value"][1])

    assert value('impasto_jobs{state="succeeded"}') == 1
    assert value('impasto_frames_total{method="abstraction"}') == 24
    assert value('impasto_live_frames_total{outcome="painted"}') == 4
    assert value("impasto_live_latency_seconds_count") == 4
    assert value('impasto_http_requests_total{route="/v1/jobs/{job_id}",status="404"}') == 1
    assert value('sum(impasto_http_requests_total{status="401"})') == 1


def test_logs_of_the_run_are_json_with_job_task_and_attempt(run: Run) -> None:
    rows = run.log()
    begun = [row for row in rows if row["message"] == "attempt begins"]
    ended = [row for row in rows if row["message"] == "attempt succeeded"]
    assert len(begun) == len(ended) >= 2
    for row in begun + ended:
        assert row["job"] == run.job and row["task"].startswith("tsk_") and row["attempt"].startswith("att_")
    assert {row["attempt"] for row in begun} == {row["attempt"] for row in ended}
    (accepted,) = [row for row in rows if row["message"] == "job accepted"]
    (asked,) = [
        row for row in rows if row.get("request") == accepted["request"] and row["logger"] == "service.middleware"
    ]
    assert accepted["job"] == run.job and asked["message"] == "POST /v1/jobs" and asked["status"] == 201
    assert ADMIN not in run.service.log.read_text()
