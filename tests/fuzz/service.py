"""A service in this process with objects of every kind, so that requests with existing ids do more than return 404."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from service.app import create_app
from service.settings import Settings
from tests.fuzz.asgi import Application, Header, Reply
from tests.fuzz.samples import samples
from workers.contract.request import JobRequest
from workers.farm import open_farm

JSON: Header = ("content-type", "application/json")
Known = dict[str, list[str]]
"""Kind of id -> ids that exist."""


@asynccontextmanager
async def application(folder: Path, **changes: Any) -> AsyncIterator[tuple[Application, Known]]:
    """The application and the ids in it."""
    options = Settings(**{
        "home": folder / "home", "pool": "none", "requests_per_minute": 10**6, "max_json_bytes": 1 << 16,
        "max_project_bytes": 1 << 18, "heartbeat_s": 0.05, "live_sessions": 2, "live_hello_s": 1.0,
        "live_resume_s": 0.0, "reserve_bytes": 0, **changes,
    })  # fmt: skip
    farm = open_farm(options)
    app = Application(create_app(options, farm))
    try:
        yield app, await _known(app, farm, folder)
    finally:
        farm.stop()


def document(asset_id: str) -> dict[str, Any]:
    """A project's document with a shot of two layers."""
    layers = [{"id": "l1", "method": "abstraction", "params": {"lines": "off"}}, {"id": "l2", "method": "multistyle"}]
    shot = {"id": "s1", "video": "clip", "layers": layers}
    return {"schema": 1, "name": "Swan", "assets": {"clip": {"id": asset_id}}, "shots": [shot]}


async def _known(app: Application, farm: Any, folder: Path) -> Known:
    assets = []
    for kind in ("mp4", "png"):
        (path := folder / f"clip.{kind}").write_bytes(samples()[kind][0])
        assets.append(farm.assets.add(path, path.name).id)
    jobs = [farm.jobs.submit(JobRequest("abstraction", {"video": assets[0]})).id for _ in range(3)]
    farm.jobs.cancel(jobs[1])
    farm.jobs.pause(jobs[2])
    project = _json(await app.request("POST", "/v1/projects", (JSON,), _bytes({"document": document(assets[0])})))
    share = _json(await app.request("POST", f"/v1/projects/{project['id']}/share", (JSON,), b"{}"))
    key = _json(await app.request("POST", "/v1/keys", (JSON,), _bytes({"name": "ci", "scopes": ["read"]})))
    tus = (("tus-resumable", "1.0.0"), ("upload-length", "9"))
    upload = (await app.request("POST", "/v1/uploads", tus)).headers["location"].rpartition("/")[2]
    return {
        "asset_id": assets, "job_id": jobs, "project_id": [project["id"]], "token": [share["token"]],
        "key_id": [key["key"]["id"]], "upload_id": [upload], "name": ["abstraction", "multistyle", "result", "poster"],
        "version": ["1"], "input_name": ["video", "reference"], "task_id": ["tsk_" + "a" * 26], "node": ["host"],
        "worker_id": ["dsp_1"], "session_id": ["liv_1"], "attempt_id": ["att_1"], "entry": ["0.svg"],
    }  # fmt: skip


def _json(reply: Reply) -> Any:
    return json.loads(reply.body)


def _bytes(value: object) -> bytes:
    return json.dumps(value).encode()
