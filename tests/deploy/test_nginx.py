"""deploy/nginx/impasto.conf in a real nginx: uploads, event streams and live sessions pass through TLS unbuffered."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from pydantic import SecretStr

from service.settings import Settings
from tests.conftest import tiny_frame
from tests.real.nginx import Nginx
from tests.service.live import running
from tests.service.live_client import jpeg, live
from workers.farm import open_farm

pytestmark = pytest.mark.real("nginx")
KEY = "an admin key for behind a proxy"


@pytest.fixture(scope="module")
def proxy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nginx]:
    home = tmp_path_factory.mktemp("home")
    settings = Settings(home=home, auth="required", admin_key=SecretStr(KEY), heartbeat_s=0.2)
    farm = open_farm(settings)
    farm.start()
    with running(settings, farm) as url:
        found = Nginx(tmp_path_factory.mktemp("nginx"), url.removeprefix("http://"))
        found.start()
        yield found
        found.close()
    farm.stop()


@pytest.fixture
def http(proxy: Nginx) -> Iterator[httpx.Client]:
    headers = {"Authorization": f"Bearer {KEY}"}
    with httpx.Client(base_url=proxy.url, verify=proxy.trust, headers=headers, timeout=30) as client:
        yield client


def test_plain_http_is_redirected_to_https(proxy: Nginx, http: httpx.Client) -> None:
    answer = httpx.get(f"http://127.0.0.1:{proxy.plain_port}/v1/jobs", headers={"Host": "localhost"})
    assert (answer.status_code, answer.headers["location"]) == (308, "https://localhost/v1/jobs")
    assert "max-age" in http.get("/healthz").headers["strict-transport-security"]


def test_the_proxy_requires_a_key_and_hides_metrics(proxy: Nginx, http: httpx.Client) -> None:
    assert httpx.get(f"{proxy.url}/v1/jobs", verify=proxy.trust).status_code == 401
    assert http.get("/v1/jobs").status_code == 200
    assert http.get("/metrics").status_code == 404
    assert http.get("/").headers["content-security-policy"]


def test_the_proxy_passes_large_uploads(http: httpx.Client, tiny_clip: Path) -> None:
    big = tiny_clip.read_bytes() + b"\0" * (6 << 20)
    answer = http.post("/v1/assets", files={"file": ("a.mp4", big)})
    assert answer.status_code == 201 and answer.json()["size_bytes"] == len(big)


def test_the_proxy_does_not_buffer_events(http: httpx.Client, tiny_clip: Path) -> None:
    asset = http.post("/v1/assets", files={"file": ("a.mp4", tiny_clip.read_bytes())}).json()["id"]
    job = http.post("/v1/jobs", json={"method": "abstraction", "inputs": {"video": asset}}).json()
    began = time.monotonic()
    with http.stream("GET", job["links"]["events"]) as stream:
        lines = stream.iter_lines()
        next(lines)
        assert time.monotonic() - began < 5, "the first line came when it was there"
        assert any("succeeded" in line for line in lines)


def test_the_proxy_passes_live_frames_in_both_directions(proxy: Nginx) -> None:
    async def talk() -> int:
        headers = {"Authorization": f"Bearer {KEY}"}
        async with live(proxy.url, additional_headers=headers, ssl=proxy.trust) as client:
            await client.send_message({"type": "hello", "width": 96, "height": 64, "method": "abstraction"})
            await client.message("ready", 60)
            for index in range(3):
                await client.send(jpeg(tiny_frame(index)))
                await client.answer(60)
            return client.sequence

    assert asyncio.run(talk()) == 3
