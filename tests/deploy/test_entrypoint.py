"""docker/entrypoint.sh with a real Ray: a service joins a cluster as a node, works, and ends in order."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import psutil
import pytest

from impasto import Client
from tests.ports import free_port
from tests.waiting import answers, until

pytestmark = [pytest.mark.slow, pytest.mark.real("ray"), pytest.mark.timeout(900)]
ROOT = Path(__file__).resolve().parents[2]


class Containers:
    """The commands of the containers as processes of one machine."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.port, self.head_port, self.agent_port = folder, free_port(), free_port(), free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self.started: list[psutil.Popen] = []
        tools = f"{ROOT / 'docker'}:{Path(sys.executable).parent}:{os.environ['PATH']}"
        self.env = {
            **os.environ,
            "PATH": tools,
            "PYTHONPATH": str(ROOT),
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN": "0123456789abcdef" * 4,
            "IMPASTO_RAY_ADDRESS": f"127.0.0.1:{self.head_port}",
            "IMPASTO_HOME": str(folder / "home"),
            "IMPASTO_PORT": str(self.port),
            "IMPASTO_LOG_FORMAT": "json",
            "IMPASTO_LOG_LEVEL": "info",
            "RAY_AGENT_PORT": str(self.agent_port),
        }

    def start(self, *command: str, **changes: str) -> psutil.Popen:
        """Start a command; its output is in a file that is named after its first argument.

        Args:
            changes: of its environment.
        """
        with (self.folder / f"{command[1]}.log").open("wb") as log:
            process = psutil.Popen(command, env=self.env | changes, stdout=log, stderr=log, cwd=ROOT)
        self.started.append(process)
        return process

    def head(self) -> None:
        """Like `entrypoint.sh head`, but with one CPU and with free ports."""
        small = ["--num-cpus=1", "--include-dashboard=false", "--object-store-memory=80000000"]
        small.append("--include-log-monitor=false")
        where = [f"--port={self.head_port}", f"--temp-dir={self.folder / 'r'}"]
        where.append(f"--dashboard-agent-listen-port={self.agent_port}")
        self.start("ray", "start", "--head", "--block", "--disable-usage-stats", *where, *small)

    def service(self) -> psutil.Popen:
        return self.start("entrypoint.sh", "service")

    def ready(self) -> bool:
        return answers(f"{self.url}/readyz")

    def close(self) -> None:
        for process in self.started:
            for child in [*_tree(process), process]:
                with_no_fuss(child.kill)


def _tree(process: psutil.Process) -> list[psutil.Process]:
    try:
        return list(process.children(recursive=True))
    except psutil.NoSuchProcess:
        return []


def with_no_fuss(act: Callable[[], None]) -> None:
    try:
        act()
    except psutil.NoSuchProcess:
        return


@pytest.fixture(scope="module")
def containers() -> Iterator[Containers]:
    """Containers in a folder with a short path (a Unix socket's path has at most 107 bytes, and Ray adds about 75); a
    head has just been started."""
    with TemporaryDirectory(prefix="imp-", ignore_cleanup_errors=True) as folder:
        found = Containers(Path(folder))
        found.head()
        yield found
        found.close()


def test_a_service_container_runs_jobs_on_its_ray_cluster(containers: Containers, tiny_clip: Path) -> None:
    service = containers.service()
    until(containers.ready, 60)
    assert subprocess.run(["healthy.py", "service"], env=containers.env).returncode == 0
    client = Client(containers.url)
    asset = client.upload(tiny_clip)["id"]
    job = client.submit("abstraction", {"video": asset})
    until(lambda: client.job(job["id"])["state"] == "succeeded", 60)
    _check_logs(containers, job["id"])
    assert {actor.nice() for actor in _render_actors(containers)} == {10}, "NICENESS of workers/process/starting.py"
    service.send_signal(signal.SIGTERM)
    assert service.wait(40) == 0
    assert not containers.ready()

    service = containers.service()
    until(containers.ready, 60)
    log = containers.folder / "service.log"
    until(lambda: "Ray runtime started" in log.read_text(), 30)  # until then `ray start` waits 30 s for a lost raylet
    (node,) = [child for child in _tree(service) if child.name() == "raylet"]
    node.kill()
    assert service.wait(60) == 1, "a service without its node ends, so that it is started again"


def _render_actors(containers: Containers) -> list[psutil.Process]:
    tree = [child for process in containers.started for child in _tree(process)]
    return [child for child in tree if _command(child).startswith("ray::_RenderActor")]


def _command(process: psutil.Process) -> str:
    """The process's command; empty if it has ended."""
    try:
        return " ".join(process.cmdline())
    except psutil.NoSuchProcess:
        return ""


def _check_logs(containers: Containers, job: str) -> None:
    """Log lines of the service and of its worker about one attempt name the same job, task and attempt."""
    service = _lines(containers.folder / "service.log")
    began = {row["attempt"] for row in service if row["message"] == "attempt begins" and row["job"] == job}
    logs = [path for path in containers.folder.rglob("worker-*.err") if "session_latest" not in path.parts]
    worker = [row for path in logs for row in _lines(path) if row.get("job") == job]
    assert began and began == {row["attempt"] for row in worker}
    assert all(row["task"].startswith("tsk_") for row in worker)


def _lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines() if line.startswith("{")]


def test_a_worker_with_a_wrong_token_cannot_join(containers: Containers) -> None:
    until(lambda: subprocess.run(["healthy.py", "worker"], env=containers.env, capture_output=True).returncode == 0, 60)
    intruder = containers.start("entrypoint.sh", "worker", RAY_AUTH_TOKEN="fedcba9876543210" * 4)
    assert intruder.wait(90) != 0
    assert "InvalidAuthToken" in (containers.folder / "worker.log").read_text()
