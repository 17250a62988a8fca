"""Sends requests to a service over a filled store, and counts their queries and steps.

The effort of a request is the number of queries, and with SQLite the number of steps of its virtual machine, which
depend on the rows that are visited and not on the computer.
"""

from __future__ import annotations

import sqlite3
import statistics
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi.testclient import TestClient
from sqlalchemy import event

from service.app import create_app
from service.settings import Settings
from tests.costs.budgets import Ask
from tests.costs.filling import ASSET, Owners, Size, fill, job_id, project_id
from workers.contract.owners import OwnerKind, Role
from workers.farm import Farm
from workers.settings import FarmSettings

STEPS_AT_ONCE = 100
REPEATS = 3


@dataclass(frozen=True)
class Cost:
    """Cost of one request."""

    status: int
    queries: int
    """Statements of the first request."""
    steps: int
    """Steps of SQLite's virtual machine in the first request; 0 with another database."""
    seconds: float
    """Median time of a request in the same process."""


class Meter:
    """Counts statements and steps of a store."""

    def __init__(self, engine: Any) -> None:
        self.queries = self.steps = 0
        event.listen(engine, "before_cursor_execute", self._query)
        event.listen(engine, "checkout", self._checkout)

    def _query(self, *_: object) -> None:
        self.queries += 1

    def _checkout(self, connection: object, *_: object) -> None:
        if isinstance(connection, sqlite3.Connection):
            connection.set_progress_handler(self._step, STEPS_AT_ONCE)

    def _step(self) -> int:
        self.steps += STEPS_AT_ONCE
        return 0


class Measured:
    """A service over a store of some size.

    Args:
        home: an empty folder.
        database_url: empty: SQLite in the folder.
    """

    def __init__(self, home: Path, size: Size, database_url: str = "") -> None:
        self._size = size
        self.farm = Farm(FarmSettings(home=home, database_url=database_url, pool="none", reserve_bytes=0), None)
        scopes = {"anna": ["read", "submit"], "cleo": ["read", "submit"], "root": ["admin"]}
        made = {name: self.farm.keys.create(name, wanted) for name, wanted in scopes.items()}
        self._secrets = {name: secret for name, (_, secret) in made.items()}
        fill(self.farm.store, self.farm.blobs, Owners(made["anna"][0].owner, made["cleo"][0].owner), size)
        settings = Settings(home=home, auth="required", requests_per_minute=10**6, quota_active_jobs=10**6)
        self._client = TestClient(create_app(settings, self.farm), raise_server_exceptions=False)
        for secret in self._secrets.values():
            self.farm.keys.verify(secret)  # the first use of a key in an hour is written
        self._group = self.farm.owners.add("group", OwnerKind.GROUP).id
        self.farm.owners.put_member(self._group, made["anna"][0].owner, Role.OWNER)
        self._meter = Meter(self.farm.store.database.engine)
        self._token = self._share()

    def _share(self) -> str:
        if not self._size.projects:
            return "none"
        answer = self._send("POST", f"/v1/projects/{project_id(0)}/share", "anna", {"comments": True})
        return str(answer.json().get("token") or str(answer.json().get("url", "none")).rpartition("/")[2])

    def cost(self, ask: Ask, repeats: int = REPEATS) -> Cost:
        """Send the request several times; each time about another job if it changes one."""
        meter = self._meter
        meter.queries = meter.steps = 0
        taken = []
        for number in range(repeats):
            began = time.perf_counter()
            answer = self._ask(ask, number)
            taken.append(time.perf_counter() - began)
            if number == 0:
                status, queries, steps = answer.status_code, meter.queries, meter.steps
        return Cost(status, queries, steps, statistics.median(taken))

    def _ask(self, ask: Ask, number: int) -> Any:
        verb, _, path = ask.request.partition(" ")
        values = self._values(number)
        body = None if ask.body is None else _filled(ask.body, values)
        return self._send(verb, path.format(**values), ask.who, body, ask.headers)

    def _send(self, verb: str, path: str, who: str, body: Any, headers: dict[str, str] | None = None) -> Any:
        given = {"Authorization": f"Bearer {self._secrets[who]}", **(headers or {})}
        return self._client.request(verb, path, json=body, headers=given)

    def _values(self, number: int) -> dict[str, str]:
        """Values of placeholders for the request of this number: `first` and `second` are jobs that wait, `old` and
        `several` such as have ended, others each time."""
        jobs = self._size.jobs
        some = min(20, (int(0.6 * jobs) - 13) // REPEATS)
        several = (job_id(13 + some * number + i) for i in range(some))
        return {
            "job": job_id(0), "waiting": job_id(jobs - 13), "first": job_id(jobs - 2 - 2 * number),
            "second": job_id(jobs - 8 - 2 * number), "old": job_id(10 + number), "several": ",".join(several),
            "task": f"tsk_{0:026d}", "attempt": f"att_{0:026d}", "asset": ASSET, "project": project_id(0),
            "token": self._token, "group": self._group,
        }  # fmt: skip

    def close(self) -> None:
        self._client.close()
        self.farm.store.close()


@contextmanager
def measured(home: Path, size: Size, database_url: str = "") -> Iterator[Measured]:
    made = Measured(home, size, database_url)
    try:
        yield made
    finally:
        made.close()


def _filled(body: Any, values: dict[str, str]) -> Any:
    """The body with its placeholders filled in; a text "{several}" becomes a list."""
    if isinstance(body, str):
        return values["several"].split(",") if body == "{several}" else body.format(**values)
    if isinstance(body, dict):
        return {name: _filled(value, values) for name, value in body.items()}
    return [_filled(value, values) for value in body] if isinstance(body, list) else body
