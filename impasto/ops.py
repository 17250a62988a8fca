"""The client's part for operators: `Client.ops`."""

from __future__ import annotations

from collections.abc import Callable
from urllib.parse import quote

from workers.contract.request import Json


class Ops:
    """Calls of /v1/ops (docs/api.md). Places are "queue", a worker's id (`dsp_...`) or a machine's name.

    Args:
        ask: (verb, path, ...) -> the answer's JSON object.
        tell: the same for answers without a body.
    """

    def __init__(self, ask: Callable[..., Json], tell: Callable[..., object]) -> None:
        self._ask, self._tell = ask, tell

    def snapshot(self) -> Json:
        """Queue, tasks by state, failures by code, throughput."""
        return self._ask("GET", "/ops/snapshot")

    def check(self) -> list[Json]:
        """Violated invariants of the database: kind, id, message, remedy."""
        found: list[Json] = self._ask("GET", "/ops/check")["violations"]
        return found

    def check_blobs(self) -> list[Json]:
        """Assets whose stored bytes are missing or damaged. Reads all of them: minutes for a large store."""
        found: list[Json] = []
        cursor: str | None = None
        while True:
            page = self._ask("GET", "/ops/check/blobs", params={"cursor": cursor} if cursor else {})
            found += page["violations"]
            if (cursor := page["cursor"]) is None:
                return found

    def queue(self) -> Json:
        """Whether new tasks start."""
        return self._ask("GET", "/ops/queue")

    def workers(self) -> list[Json]:
        return self._all("/ops/workers")

    def nodes(self) -> list[Json]:
        return self._all("/ops/nodes")

    def live(self) -> list[Json]:
        """Live sessions of every process."""
        return self._all("/ops/live")

    def failures(self, job_id: str | None = None, limit: int = 50) -> list[Json]:
        """Attempts that failed, newest first."""
        items: list[Json] = self._ask("GET", "/ops/failures", params=_given(job_id=job_id, limit=limit))["items"]
        return items

    def timeline(self, job_id: str) -> list[Json]:
        """Every attempt of a job, the latest begun first."""
        return self._all(f"/ops/jobs/{quote(job_id, safe='')}/timeline", limit=2000)

    def log(self, attempt_id: str) -> Json:
        """An attempt with its log."""
        return self._ask("GET", f"/ops/attempts/{quote(attempt_id, safe='')}/log")

    def drain(self, place: str, reason: str = "") -> None:
        """Start no new attempts there; running ones finish. Raises NotFound."""
        verb = "pause" if place == "queue" else "drain"
        self._tell("POST", f"{_path(place)}/{verb}", json={"reason": reason})

    def resume(self, place: str) -> None:
        """Resume the place. Raises NotFound."""
        self._tell("POST", f"{_path(place)}/resume")

    def end_live(self, session_id: str) -> None:
        """End a live session within seconds. Raises NotFound."""
        self._tell("POST", f"/ops/live/{quote(session_id, safe='')}/end")

    def _all(self, path: str, **query: object) -> list[Json]:
        items, cursor = [], None
        while True:
            page = self._ask("GET", path, params=_given(cursor=cursor, **query))
            items += page["items"]
            if (cursor := page["cursor"]) is None:
                return items


def _path(place: str) -> str:
    if place == "queue":
        return "/ops/queue"
    return f"/ops/{'workers' if place.startswith('dsp_') else 'nodes'}/{quote(place, safe='')}"


def _given(**query: object) -> Json:
    return {name: value for name, value in query.items() if value is not None}
