"""A Prometheus in a temporary folder with our configuration, at shorter intervals."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import httpx

from tests.ports import free_port
from tests.real.processes import end, start, until

SHIPPED = Path(__file__).resolve().parents[2] / "deploy" / "prometheus"


def missing() -> str:
    """Why there can be no server here; empty if there can."""
    lacks = [name for name in ("prometheus", "promtool") if shutil.which(name) is None]
    return f"there is no {lacks[0]}: apt-get install prometheus" if lacks else ""


def promtool(*words: str | Path) -> str:
    """The output of promtool. Raises AssertionError with that output if promtool fails."""
    done = subprocess.run(["promtool", *map(str, words)], capture_output=True, text=True)
    output = done.stdout + done.stderr
    assert done.returncode == 0, output
    return output


class Prometheus:
    """The server. `key` is its key for the service; `targets` are "host:port"."""

    def __init__(self, folder: Path, key: str, targets: list[str]) -> None:
        self.folder = folder / "prometheus"
        shutil.copytree(SHIPPED, self.folder, ignore=shutil.ignore_patterns("targets", "secrets"))
        config = self.folder / "prometheus.yml"
        quick = config.read_text().replace("_interval: 15s", "_interval: 1s").replace("scrape_timeout: 10s", "")
        self._port = free_port()
        config.write_text(quick.replace("localhost:9090", f"localhost:{self._port}"))
        (self.folder / "secrets").mkdir()
        (self.folder / "secrets" / "metrics_key").write_text(key)
        (self.folder / "targets").mkdir()
        (self.folder / "targets" / "impasto.yml").write_text(f"- targets: {targets}\n")
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        log = self.folder / "log"
        flags = {
            "config.file": self.folder / "prometheus.yml",
            "storage.tsdb.path": self.folder / "data",
            "web.listen-address": f"127.0.0.1:{self._port}",
        }
        self._process = start(["prometheus", *(f"--{name}={value}" for name, value in flags.items())], log)
        until(self._ready, self._process, log)

    def _ready(self) -> bool:
        try:
            return httpx.get(f"http://127.0.0.1:{self._port}/-/ready").is_success
        except httpx.TransportError:
            return False

    def ask(self, what: str, **params: str) -> Any:
        """The data of a response of its HTTP API."""
        answer = httpx.get(f"http://127.0.0.1:{self._port}/api/v1/{what}", params=params, timeout=20)
        body = answer.json()
        assert body["status"] == "success", body
        return body["data"]

    def query(self, expr: str) -> list[dict[str, Any]]:
        """The current value of an expression."""
        return list(self.ask("query", query=expr)["result"])

    def close(self) -> None:
        if self._process is not None:
            end(self._process)
