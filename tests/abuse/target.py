"""A service of its own to abuse, with objects of every kind."""

from __future__ import annotations

import random
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import psutil

from tests.fuzz.samples import samples
from tests.fuzz.service import document

ADMIN_KEY = "a-long-secret-of-the-operator"
_PROGRAM = """
import resource, sys
from pathlib import Path
limit = int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
from service.server import serve
from service.settings import Settings
settings = Settings(home=Path(sys.argv[1]), port=0, pool="none", auth="required", admin_key=sys.argv[3],
    live_sessions=2, reserve_bytes=0)
serve(settings, lambda url: print(url, flush=True))
"""
_ADDRESS_SPACE_BYTES = 8 << 30
"""Of the service: attempts to take all memory of the machine end here."""


@dataclass
class Target:
    """A running service.

    Attributes:
        keys: the abuser's, and another owner's.
        known: ids by the name of the path parameter.
        facts: bodies and ids that single abuses use.
    """

    url: str
    process: psutil.Process
    keys: tuple[str, str]
    known: dict[str, str] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)

    @property
    def place(self) -> tuple[str, int]:
        parts = urlsplit(self.url)
        return str(parts.hostname), int(parts.port or 80)

    def client(self, key: str) -> httpx.Client:
        return httpx.Client(base_url=self.url, headers={"Authorization": f"Bearer {key}"}, timeout=60)


@contextmanager
def target(folder: Path, tree: Path) -> Iterator[Target]:
    """A service of the program in `tree`, with its own interpreter."""
    python = tree / ".venv" / "bin" / "python"
    command = [str(python), "-c", _PROGRAM, str(folder / "home"), str(_ADDRESS_SPACE_BYTES), ADMIN_KEY]
    with (folder / "log.txt").open("wb") as log:
        process = psutil.Popen(command, cwd=tree, stdout=subprocess.PIPE, stderr=log, text=True)
        try:
            made = Target(process.stdout.readline().strip(), process, ("", ""))
            _fill(made)
            yield made
        finally:
            process.terminate()
            try:
                process.wait(20)
            except psutil.TimeoutExpired:
                process.kill()
                process.wait(20)


def _fill(made: Target) -> None:
    with made.client(ADMIN_KEY) as admin:
        created = [admin.post("/v1/keys", json={"name": name, "scopes": ["read", "submit"]}) for name in ("a", "b")]
    made.keys = (created[0].json()["secret"], created[1].json()["secret"])
    with made.client(made.keys[1]) as other:
        _jobs(other, _asset(other), 3)
    with made.client(made.keys[0]) as own:
        _own(made, own, created[0].json()["key"]["id"])


def _own(made: Target, own: httpx.Client, key_id: str) -> None:
    asset = _asset(own)
    jobs = _jobs(own, asset, 150)
    project = _project(own, document(asset))
    grown = {**document(asset), "ui": {"a": ["x" * 1000], "o": {"k": {}}}}
    many = {**document(asset), "assets": {"clip": {"id": asset}} | many_assets()}
    token = own.post(f"/v1/projects/{project}/share", json={}).json()["token"]
    upload = own.post("/v1/uploads", headers={"Tus-Resumable": "1.0.0", "Upload-Length": "9"}).headers["location"]
    made.known = {
        "asset_id": asset, "job_id": jobs[0], "project_id": project, "token": token, "key_id": key_id,
        "upload_id": upload.rpartition("/")[2], "name": "abstraction", "version": "1", "input_name": "video",
        "task_id": "tsk_" + "a" * 26, "node": "host", "worker_id": "dsp_1", "session_id": "liv_1",
        "attempt_id": "att_1", "entry": "0.svg", "peer_id": "rtc_1",
    }  # fmt: skip
    made.facts = {"grown": _project(own, grown), "many": _project(own, many), "asset": asset}


def many_assets() -> dict[str, Any]:
    return {f"n{n}": {"id": f"ast_{n:064x}"} for n in range(19_000)}


def noise(seed: int, size_bytes: int) -> str:
    """Text that does not become much smaller by compression."""
    return random.Random(seed).randbytes(size_bytes // 2).hex()


def _asset(http: httpx.Client) -> str:
    answer = http.post("/v1/assets", files={"file": ("clip.mp4", samples()["mp4"][0])})
    return str(answer.raise_for_status().json()["id"])


def _jobs(http: httpx.Client, asset: str, count: int) -> list[str]:
    body = {"method": "abstraction", "inputs": {"video": asset}}
    found = []
    for _ in range(count):
        while (answer := http.post("/v1/jobs", json=body)).status_code == 429:
            time.sleep(0.1)
        found.append(str(answer.raise_for_status().json()["id"]))
    return found


def _project(http: httpx.Client, value: dict[str, Any]) -> str:
    answer = http.post("/v1/projects", json={"document": value})
    return str(answer.raise_for_status().json()["id"])
