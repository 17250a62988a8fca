"""impasto serve: the process starts, prints its address and stops in order."""

from __future__ import annotations

import logging
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI

from pipeline.errors import BadParameter
from service.log_limit import BURST
from service.server import make_server, serve
from service.settings import Settings
from workers.process.descriptors import MAX_DESCRIPTORS

PROGRAM = """
import sys
from pathlib import Path
from service.server import serve
from service.settings import Settings
serve(Settings(home=Path(sys.argv[1]), port=0, pool="none"), lambda url: print(url, flush=True))
print("stopped in order", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_event_streams_and_the_process(home: Path, tiny_clip: Path, number: signal.Signals) -> None:
    process = subprocess.Popen([sys.executable, "-c", PROGRAM, str(home)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        url = process.stdout.readline().strip()
        with httpx.Client(base_url=url, timeout=20) as http:
            asset = http.post("/v1/assets", files={"file": ("a.mp4", tiny_clip.read_bytes())}).json()["id"]
            job = http.post("/v1/jobs", json={"method": "abstraction", "inputs": {"video": asset}}).json()
            with http.stream("GET", job["links"]["events"]) as stream:
                lines = stream.iter_lines()
                assert next(lines).startswith("retry:")
                threading.Timer(0.3, process.send_signal, [number]).start()
                began = time.monotonic()
                assert sum(1 for _ in lines) > 0
        assert process.wait(10) == 0
        assert time.monotonic() - began < 8
        assert process.stdout.read() == "stopped in order\n"
    finally:
        process.kill()
        process.wait()


def test_the_service_does_not_start_publicly_without_a_key(home: Path) -> None:
    with pytest.raises(BadParameter) as error:
        serve(Settings(home=home, host="0.0.0.0", port=0, pool="none"))
    assert error.value.field == "IMPASTO_ADMIN_KEY"
    assert "127.0.0.1" in error.value.remedy


def test_only_the_handler_of_the_service_drops_repeated_lines(home: Path, caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(BadParameter):
        serve(Settings(home=home, host="0.0.0.0", port=0, pool="none"))
    for _ in range(2 * BURST):
        logging.getLogger("workers").error("the same")
    assert [record.getMessage() for record in caplog.records].count("the same") == 2 * BURST


def test_a_taken_port_is_reported(home: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(OSError, match="in use"):
        serve(Settings(home=home, port=taken.getsockname()[1], pool="none"))


def test_the_limit_of_open_files_is_raised_at_start(home: Path) -> None:
    before, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (500, hard))
        make_server(FastAPI(), Settings(home=home))
        most = MAX_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, MAX_DESCRIPTORS)
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (most, hard)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (before, hard))


def test_settings_come_from_the_environment(monkeypatch: pytest.MonkeyPatch, home: Path) -> None:
    monkeypatch.setenv("IMPASTO_HOME", str(home))
    monkeypatch.setenv("IMPASTO_WORKERS", "3")
    monkeypatch.setenv("IMPASTO_ALLOWED_HOSTS", '["studio.files.local"]')
    settings = Settings()
    assert (settings.home, settings.workers, settings.allowed_hosts) == (home, 3, {"studio.files.local"})
