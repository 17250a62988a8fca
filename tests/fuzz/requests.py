"""Random requests of every route, most with existing ids; bodies, queries, headers, ids and methods are changed."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.methods.base import seeded
from tests.fuzz.asgi import Application, Header, Reply
from tests.fuzz.ledger import Run
from tests.fuzz.mutate import mutated
from tests.fuzz.service import JSON, Known, application, document
from tests.fuzz.values import HOSTILE, Random, changed_json, changed_text, pick

STEP = 5000
"""Number of requests in a step, which has its own service."""
_DEAR = ("/frame", "/v1/previews", "/previews/", "/estimate", "/export", "/thumbnail")
"""Parts of the paths of routes that decode or paint, which are slow and requested less often."""
_DEAR_ONE_IN = 40
_QUERIES = {
    "limit": "5", "cursor": "WzFd", "state": "failed", "method": "abstraction", "label": "shot:1", "index": "2",
    "max_side_px": "64", "download": "true", "after": "0", "version": "1", "owner": "anna", "from": "0", "to": "2",
}  # fmt: skip
_HEADERS: tuple[Header, ...] = (
    ("range", "bytes=0-9"), ("if-none-match", '"a"'), ("if-match", '"1"'), ("if-range", '"a"'), ("last-event-id", "3"),
    ("idempotency-key", "once"), ("content-type", "application/json"), ("authorization", "Bearer imp_none"),
    ("accept", "text/event-stream"), ("origin", "http://127.0.0.1"), ("content-length", "3"), ("cookie", "a=b"),
    ("content-type", "application/merge-patch+json"), ("tus-resumable", "1.0.0"), ("upload-offset", "0"),
    ("upload-length", "9"), ("content-type", "multipart/form-data; boundary=x"), ("x-request-id", "a"),
)  # fmt: skip


class Operation(NamedTuple):
    """A route and method."""

    method: str
    path: str


async def operations(app: Application) -> list[Operation]:
    """All routes that the application declares."""
    paths = json.loads((await app.request("GET", "/openapi.json")).body)["paths"]
    return [Operation(method.upper(), path) for path in sorted(paths) for method in sorted(paths[path])]


def bodies(known: Known) -> dict[str, Any]:
    """Part of a path -> a body that is accepted there; the longest matching part is used."""
    asset, project = known["asset_id"][0], document(known["asset_id"][0])
    query = {"shot": "s1", "max_side_px": 32, "document": project}
    return {
        "/v1/jobs": {
            "method": "abstraction", "inputs": {"video": asset}, "params": {"lines": "off"}, "seed": 3,
            "frames": [0, 2],
            "output": {"format": "mp4", "quality": 20, "artefacts": ["svg"]}, "labels": {"shot": "1"}, "name": "a",
            "webhook": "https://example.org/", "priority": 1, "on_damage": "fail",
        },
        "/v1/projects": {"name": "Swan", "document": project},
        "/v1/projects/{project_id}": [{"op": "replace", "path": "/name", "value": "Duck"}],
        "/v1/projects/{project_id}/jobs": {"shots": ["s1"], "range": [0, 2], "priority": 1},
        "/v1/projects/{project_id}/share": {"days": 3},
        "/v1/projects/{project_id}/versions/{version}/label": {"label": "first"},
        "/previews/": query | {"frame": 0, "key": 1, "cards": [{"id": "c", "set": {"params": {}}}]},
        "/v1/previews": {"method": "abstraction", "inputs": {"video": asset}, "frame": 0, "max_side_px": 32},
        "/v1/estimates": {"document": project, "shots": ["s1"]},
        "/v1/keys": {"name": "ci", "scopes": ["read"], "quotas": {"active_jobs": 2}},
        "/v1/ops": {"reason": "upgrade"},
    }  # fmt: skip


def fuzz(run: Run, folder: Path, goes_on: Callable[[], bool]) -> None:
    """Run steps until the time is up. A started step is finished, so that a seed gives the same requests again."""
    while goes_on():
        asyncio.run(step(run, folder / f"requests-{run.first + run.steps}", run.first + run.steps))
        run.steps += 1


async def step(run: Run, folder: Path, number: int, requests: int = STEP) -> None:
    """One step: its requests depend on the seed and the number alone."""
    folder.mkdir()
    random = seeded(run.seed, 17, number)
    async with application(folder) as (app, known):
        routes, samples = await operations(app), bodies(known)
        for index in range(requests):
            operation = _chosen(routes, random)
            method, target, headers, body = _request(operation, known, samples, random)
            began = time.monotonic()
            reply = await app.request(method, target, headers, body)
            run.count(f"{reply.status // 100}xx", time.monotonic() - began)
            if wrong := verdict(reply):
                run.findings[f"requests:{run.seed}:{number}:{index}"] = (
                    f"{method} {target[:200]} {body[:200]!r}: {wrong}"
                )
            elif reply.status == 201:
                _learn(operation, reply, known)


def verdict(reply: Reply) -> str:
    """The fault of a response: a status of 500 or more, or an error without a problem document; otherwise empty."""
    if reply.status >= 500 and reply.status != 503:
        return f"{reply.status} {reply.body[:300]!r}"
    if reply.status >= 400 and reply.body and "json" not in reply.headers.get("content-type", ""):
        return f"{reply.status} without a problem document: {reply.body[:200]!r}"
    return ""


def _chosen(routes: list[Operation], random: Random) -> Operation:
    while True:
        found: Operation = pick(random, routes)
        if not any(part in found.path for part in _DEAR) or random.integers(_DEAR_ONE_IN) == 0:
            return found


def _request(
    operation: Operation, known: Known, samples: dict[str, Any], random: Random
) -> tuple[str, str, list[Header], bytes]:
    target, headers = _target(operation.path, known, random), []
    part = max((part for part in samples if part in operation.path), key=len, default="")
    body = b""
    if operation.method in ("POST", "PUT", "PATCH") and part:
        value = samples[part] if random.random() < 0.2 else changed_json(samples[part], random, 3)
        body = json.dumps(value).encode()
        if random.random() < 0.1:
            body = mutated(body, body, int(random.integers(2**31)), 0)
        patch = operation.method == "PATCH" and isinstance(value, list)
        headers.append(("content-type", "application/json-patch+json") if patch else JSON)
    for _ in range(int(random.integers(3)) if random.random() < 0.4 else 0):
        name, text = pick(random, _HEADERS)
        headers.append((name, text if random.random() < 0.4 else changed_text(text, random)))
    method = operation.method if random.random() < 0.97 else pick(random, ("GET", "POST", "HEAD", "BREW", "OPTIONS"))
    return method, target, headers, body


def _target(path: str, known: Known, random: Random) -> str:
    for part in path.split("{")[1:]:
        name = part.partition("}")[0]
        plain = name.partition(":")[0]
        chosen = str(pick(random, known.get(plain, ["1"])))
        if random.random() < 0.15:
            chosen = changed_text(chosen, random) or "-"
        path = path.replace(f"{{{name}}}", chosen.replace("?", "%3F"), 1)
    if random.random() < 0.3:
        names = [pick(random, sorted(_QUERIES)) for _ in range(int(random.integers(1, 4)))]
        texts = (_QUERIES[name] if random.random() < 0.4 else str(pick(random, HOSTILE)) for name in names)
        path += "?" + "&".join(f"{name}={text}" for name, text in zip(names, texts, strict=True))
    return path


def _learn(operation: Operation, reply: Reply, known: Known) -> None:
    """Add the ids of created objects to those that later requests use."""
    kinds = {"/v1/jobs": "job_id", "/v1/projects": "project_id"}
    if operation.path in kinds and operation.method == "POST":
        known[kinds[operation.path]] = [*known[kinds[operation.path]][-9:], json.loads(reply.body)["id"]]
