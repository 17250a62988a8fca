"""Mutated media files as uploads of a real service: every frame and preview of an accepted one is requested."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fastapi.testclient import TestClient

from service.app import create_app
from service.settings import Settings
from tests.fuzz import media
from tests.fuzz.ledger import Run
from tests.service.records import records
from workers.farm import open_farm

METHODS = ("abstraction", "multistyle")
PREVIEWED_ONE_IN = 4
"""One accepted upload in so many has its previews made, because they take a hundred times as long as frames."""
SIDE_PX = 64


@contextmanager
def service(folder: Path) -> Iterator[TestClient]:
    """A service in this process."""
    options = Settings(home=folder / "home", pool="none", requests_per_minute=10**6)
    farm = open_farm(options)
    try:
        with TestClient(create_app(options, farm), "http://127.0.0.1:8420", raise_server_exceptions=False) as client:
            yield client
    finally:
        farm.stop()


def cases(seed: int, number: int) -> list[media.Case]:
    """One case of each kind that a method takes as a video."""
    return [case for case in media.cases(seed, number) if case.kind != "exr"]


def outcome(client: TestClient, case: media.Case, previews: bool) -> str:
    """The outcome of a case: "accepted", "refused", or "fault: ..." for an internal error of the service."""
    sent = client.post("/v1/assets", files={"file": (f"upload.{case.kind}", case.data())})
    if sent.status_code >= 500:
        return f"fault: upload {sent.status_code} {sent.text[:200]}"
    if sent.status_code not in (200, 201):
        return "refused"
    found = [*_frames(client, sent.json()), *(_previews(client, sent.json()) if previews else ())]
    return f"fault: {'; '.join(found)}" if found else "accepted"


def _frames(client: TestClient, asset: dict[str, Any]) -> Iterator[str]:
    count = int(asset["info"]["frames"])
    for index in sorted({0, count // 2, max(0, count - 1), count + 5}):
        answer = client.get(f"/v1/assets/{asset['id']}/frame", params={"index": index, "max_side_px": SIDE_PX})
        if answer.status_code >= 500:
            yield f"frame {index}: {answer.status_code} {answer.text[:200]}"


def _previews(client: TestClient, asset: dict[str, Any]) -> Iterator[str]:
    last = max(0, int(asset["info"]["frames"]) - 1)
    for method in METHODS:
        body = {"method": method, "inputs": {"video": asset["id"]}, "frame": last, "max_side_px": SIDE_PX}
        answer = client.post("/v1/previews", json=body)
        if answer.status_code >= 500:
            yield f"preview of {method}: {answer.status_code} {answer.text[:200]}"
        yield from _project_previews(client, asset["id"], method, last)


def _project_previews(client: TestClient, asset_id: str, method: str, frame: int) -> Iterator[str]:
    shot = {"id": "s1", "video": "clip", "layers": [{"id": "l1", "method": method}]}
    document = {"schema": 1, "name": "Mutated", "assets": {"clip": {"id": asset_id}}, "shots": [shot]}
    made = client.post("/v1/projects", json={"document": document})
    if made.status_code != 201:
        if made.status_code >= 500:
            yield f"project: {made.status_code} {made.text[:200]}"
        return
    for kind, more in (("source", {"frames": [0, 2]}), ("paint", {"frame": frame}), ("directions", {"frame": frame})):
        body = {"shot": "s1", "max_side_px": SIDE_PX, **more}
        answer = client.post(f"{made.json()['links']['self']}/previews/{kind}", json=body)
        if answer.status_code >= 500:
            yield f"{kind} of {method}: {answer.status_code} {answer.text[:200]}"
        elif answer.status_code == 200:
            for head, _ in records(answer.content):
                if head["type"] == "error" and head["problem"]["status"] >= 500:
                    yield f"{kind} of {method}: {head}"


def fuzz(run: Run, folder: Path, goes_on: Callable[[], bool]) -> None:
    """Run steps until the time is up. In each, one case of each kind."""
    with service(folder) as client:
        accepted = 0
        while goes_on():
            for case in cases(run.seed, run.first + run.steps):
                began = time.monotonic()
                what = outcome(client, case, accepted % PREVIEWED_ONE_IN == 0)
                accepted += what == "accepted"
                run.count(what.partition(":")[0], time.monotonic() - began)
                if what.startswith("fault"):
                    run.findings[case.id] = what
            run.steps += 1
