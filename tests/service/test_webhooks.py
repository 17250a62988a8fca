"""Webhooks: a real receiver verifies them with the standard's own library; internal targets are refused."""

from __future__ import annotations

import http.server
import threading
import time
from collections.abc import Iterator
from typing import Any

import anyio
import httpcore
import pytest
from fastapi.testclient import TestClient
from standardwebhooks import Webhook, WebhookVerificationError

from pipeline.errors import BadParameter
from service.settings import Settings
from service.webhooks import targets
from service.webhooks.connect import GuardedBackend
from service.webhooks.secrets import WebhookSecrets
from service.webhooks.targets import check_target, is_public
from tests.service.conftest import open_client
from tests.service.driven_farm import DrivenFarm
from workers.contract.record import Delivery


class Receiver:
    """Collects requests; answers with the given statuses, then 204. A status of 0 hangs."""

    def __init__(self, *statuses: int) -> None:
        self.got: list[tuple[dict[str, str], str]] = []
        self._statuses = list(statuses)
        receiver = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"])).decode()
                receiver.got.append(({name.lower(): value for name, value in self.headers.items()}, body))
                receiver.answer(self)

            def log_message(self, *_: Any) -> None: ...

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/hook"

    def answer(self, handler: http.server.BaseHTTPRequestHandler) -> None:
        status = self._statuses.pop(0) if self._statuses else 204
        if status == 0:
            time.sleep(6.0)
            return
        handler.send_response(status)
        handler.send_header("Location", self.url + "/elsewhere")
        handler.send_header("Content-Length", "0")
        handler.end_headers()

    def wait(self, count: int) -> None:
        deadline = time.monotonic() + 20
        while len(self.got) < count and time.monotonic() < deadline:
            time.sleep(0.02)
        assert len(self.got) >= count


@pytest.fixture
def hooked(settings: Settings, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch) -> Iterator[TestClient]:
    monkeypatch.setattr("workers.store.webhooks.WAITS_S", (0.05,) * 7)
    more = {"webhook_private": True, "webhook_poll_s": 0.02, "webhook_timeout_s": 2}
    yield from open_client(settings.model_copy(update=more), farm)


def serve(receiver: Receiver) -> Receiver:
    threading.Thread(target=receiver.server.serve_forever, daemon=True).start()
    return receiver


def post(farm: DrivenFarm, url: str) -> Delivery:
    return farm.send(url)


def settled(farm: DrivenFarm, count: int) -> list[tuple[str, int | None, str]]:
    deadline = time.monotonic() + 20
    while len(farm.outcomes) < count and time.monotonic() < deadline:
        time.sleep(0.02)
    return farm.outcomes


def test_a_webhook_signature_verifies_and_a_changed_message_does_not(hooked: TestClient, farm: DrivenFarm) -> None:
    receiver = serve(Receiver())
    sent = post(farm, receiver.url)
    receiver.wait(1)
    headers, body = receiver.got[0]
    secret = hooked.get("/v1/webhooks/secret").json()["secret"]
    assert Webhook(secret).verify(body, headers) == sent.body
    assert headers["webhook-id"] == sent.id
    with pytest.raises(WebhookVerificationError):
        Webhook(secret).verify(body.replace("succeeded", "failed"), headers)
    assert settled(farm, 1) == [(sent.id, 204, "")]


def test_a_failed_webhook_is_retried_with_the_same_id(hooked: TestClient, farm: DrivenFarm) -> None:
    receiver = serve(Receiver(500, 503))
    sent = post(farm, receiver.url)
    receiver.wait(3)
    assert {headers["webhook-id"] for headers, _ in receiver.got} == {sent.id}
    assert [status for _, status, _ in settled(farm, 3)] == [500, 503, 204]


def test_webhooks_do_not_follow_redirects(hooked: TestClient, farm: DrivenFarm) -> None:
    receiver = serve(Receiver(302))
    post(farm, receiver.url)
    assert settled(farm, 1)[0][1:] == (302, "HTTP 302")


def test_dead_and_hanging_receivers_block_nobody(hooked: TestClient, farm: DrivenFarm) -> None:
    hanging, well = serve(Receiver(*[0] * 50)), serve(Receiver())
    for _ in range(5):
        post(farm, hanging.url)
        post(farm, "http://127.0.0.1:9/")
    post(farm, "http://no-such-host.invalid/")
    began = time.monotonic()
    post(farm, well.url)
    well.wait(1)
    assert time.monotonic() - began < 8, "ten of them would take twenty seconds"
    deadline = time.monotonic() + 20
    while not any(error == "no answer within 2 s" for _, _, error in farm.outcomes):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert hooked.get("/healthz").status_code == 200


def test_a_job_lists_its_webhook_deliveries(hooked: TestClient, farm: DrivenFarm) -> None:
    asset = hooked.post("/v1/assets", files={"file": ("a.mp4", b"CLIP")}).json()["id"]
    job = hooked.post("/v1/jobs", json={"method": "toy", "inputs": {"video": asset}}).json()["id"]
    assert hooked.get(f"/v1/jobs/{job}/webhooks").json() == {"items": [], "cursor": None}


def test_each_owner_has_a_permanent_webhook_secret(settings: Settings) -> None:
    path = settings.home / "webhook_secret"
    secrets = WebhookSecrets(path)
    assert secrets.of("a") != secrets.of("b")
    assert WebhookSecrets(path).of("a") == secrets.of("a")
    assert path.stat().st_mode & 0o077 == 0
    assert list(settings.home.iterdir()) == [path]


@pytest.mark.parametrize(
    "address",
    [
        "127.0.0.1", "10.1.2.3", "172.16.0.1", "192.168.1.1", "169.254.169.254", "0.0.0.0", "100.64.0.1", "224.0.0.1",
        "255.255.255.255", "::1", "::", "fe80::1", "fe80::1%eth0", "fd00::1", "ff02::1", "::ffff:127.0.0.1",
        "::ffff:10.0.0.1", "2002:7f00:1::", "64:ff9b::7f00:1", "64:ff9b::a9fe:a9fe", "nonsense",
    ],
)  # fmt: skip
def test_internal_addresses_are_not_public(address: str) -> None:
    assert not is_public(address)


@pytest.mark.parametrize(
    "address", ["93.184.216.34", "2606:2800:220:1::1", "::ffff:93.184.216.34", "64:ff9b::5db8:d822"]
)
def test_external_addresses_are_public(address: str) -> None:
    assert is_public(address)


@pytest.mark.parametrize(
    "url",
    [
        "http://localhost/x", "http://127.1/", "http://0x7f000001/", "http://2130706433/", "http://[::1]:80/",
        "ftp://example.org/", "http://", "http://user:pw@example.org/", "http://example.org:99999/", "http://[::1",
        "https://example.org/#here", "https://exa mple.org/", "//example.org/", "http://example.org:0/",
    ],
)  # fmt: skip
def test_invalid_webhook_targets_are_refused(url: str) -> None:
    with pytest.raises(BadParameter) as error:
        check_target(url, private=False)
    assert error.value.field == "webhook"
    assert error.value.remedy


def test_a_public_name_that_resolves_to_an_internal_address_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(targets, "_resolve", lambda host, port: ["93.184.216.34", "10.0.0.1"])
    with pytest.raises(BadParameter, match="private"):
        check_target("https://example.org/hook", private=False)
    monkeypatch.setattr(targets, "_resolve", lambda host, port: ["93.184.216.34"])
    check_target("https://example.org/hook", private=False)


def test_a_name_rebound_to_an_internal_address_is_refused_at_connection() -> None:
    receiver = serve(Receiver())

    async def connect() -> None:
        async with httpcore.AsyncConnectionPool(network_backend=GuardedBackend()) as pool:
            await pool.request("POST", receiver.url.replace("127.0.0.1", "localhost"), content=b"{}")

    with pytest.raises(httpcore.ConnectError, match="not a public address"):
        anyio.run(connect)
    assert receiver.got == []


def test_webhooks_to_internal_addresses_are_disabled_by_default(settings: Settings, farm: DrivenFarm) -> None:
    receiver = serve(Receiver())
    for _client in open_client(settings.model_copy(update={"webhook_poll_s": 0.02}), farm):
        post(farm, receiver.url)
        ((_, status, error),) = settled(farm, 1)
    assert (status, receiver.got) == (None, [])
    assert error == "127.0.0.1 is not a public address."
