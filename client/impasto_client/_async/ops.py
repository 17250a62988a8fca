"""The client's part for operators: `Client.ops`."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from impasto_client._async.http import AsyncConnection, given
from impasto_client.models import Job

Json = dict[str, Any]


class AsyncOps:
    """Calls of /v1/ops (docs/api.md). Places are "queue", a worker's id (`dsp_...`) or a machine's name."""

    def __init__(self, connection: AsyncConnection) -> None:
        self._at = connection

    async def snapshot(self) -> Json:
        """Queue, tasks by state, failures by code, throughput."""
        found: Json = await self._at.json("GET", "/ops/snapshot")
        return found

    async def check(self) -> list[Json]:
        """Violated invariants of the database: kind, id, message, remedy."""
        found: list[Json] = (await self._at.json("GET", "/ops/check"))["violations"]
        return found

    async def check_blobs(self) -> list[Json]:
        """Assets whose stored bytes are missing or damaged. Reads all of them: minutes for a large store."""
        found: list[Json] = []
        cursor: str | None = None
        while True:
            page = await self._at.json("GET", "/ops/check/blobs", params=given(cursor=cursor))
            found += page["violations"]
            if (cursor := page["cursor"]) is None:
                return found

    async def queue(self) -> Json:
        """Whether new tasks start."""
        found: Json = await self._at.json("GET", "/ops/queue")
        return found

    async def workers(self) -> list[Json]:
        return await self._all("/ops/workers")

    async def nodes(self) -> list[Json]:
        return await self._all("/ops/nodes")

    async def live(self) -> list[Json]:
        """Live sessions of every process."""
        return await self._all("/ops/live")

    async def failures(self, job_id: str | None = None, limit: int = 50) -> list[Json]:
        """Attempts that failed, newest first."""
        return await self._at.items("/ops/failures", job_id=job_id, limit=limit)

    async def timeline(self, job_id: str) -> list[Json]:
        """Every attempt of a job, the latest begun first."""
        return await self._all(f"/ops/jobs/{quote(job_id, safe='')}/timeline", limit=2000)

    async def log(self, attempt_id: str) -> Json:
        """An attempt with its log."""
        found: Json = await self._at.json("GET", f"/ops/attempts/{quote(attempt_id, safe='')}/log")
        return found

    async def prioritise(self, job_id: str, priority: int | None) -> Job:
        """Set the priority of a job, -100 to 100; None: one above all other unfinished jobs."""
        path = f"/ops/jobs/{quote(job_id, safe='')}/priority"
        job: Job = await self._at.json("POST", path, json={"priority": priority})
        return job

    async def drain(self, place: str, reason: str = "") -> None:
        """Start no new attempts there; running ones finish. Raises NotFound."""
        verb = "pause" if place == "queue" else "drain"
        await self._at.send("POST", f"{_path(place)}/{verb}", json={"reason": reason})

    async def resume(self, place: str) -> None:
        """Resume the place. Raises NotFound."""
        await self._at.send("POST", f"{_path(place)}/resume")

    async def end_live(self, session_id: str) -> None:
        """End a live session within seconds. Raises NotFound."""
        await self._at.send("POST", f"/ops/live/{quote(session_id, safe='')}/end")

    async def _all(self, path: str, **query: Any) -> list[Json]:
        return [item async for item in self._at.every(path, **query)]


def _path(place: str) -> str:
    if place == "queue":
        return "/ops/queue"
    return f"/ops/{'workers' if place.startswith('dsp_') else 'nodes'}/{quote(place, safe='')}"
