"""Keys, scopes, owners, rates and quotas; and protection where no key is required."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.access.rates import MAX_BUCKETS, Rates
from service.app import create_app
from service.settings import Settings, is_loopback
from tests.service.conftest import CLIP
from tests.service.driven_farm import DrivenFarm

ADMIN = "a-long-secret"
Login = Callable[..., TestClient]


@pytest.fixture
def login(settings: Settings, farm: DrivenFarm) -> Login:
    """A client with a new key of the given scopes and quotas, or without a key."""
    closed = settings.model_copy(update={"auth": "required", "admin_key": None})
    app = create_app(closed.model_copy(update={"quota_active_jobs": 100}), farm)

    def client(*scopes: str, **quotas: int) -> TestClient:
        headers = {"Authorization": f"Bearer {farm.keys.create('k', scopes, quotas)[1]}"} if scopes else {}
        return TestClient(app, "https://impasto.example", headers=headers, raise_server_exceptions=False)

    return client


def upload(client: TestClient) -> str:
    return str(client.post("/v1/assets", files={"file": ("a.mp4", CLIP)}).json()["id"])


def submit(client: TestClient, **more: Any) -> Any:
    return client.post("/v1/jobs", json={"method": "toy", "inputs": {"video": upload(client)}}, **more)


@pytest.mark.parametrize("header", [None, "Bearer wrong", "Basic eDp5", "Bearer ", "Bearer é"])
def test_requests_without_a_valid_key_get_401(login: Login, header: str | None) -> None:
    answer = login().get("/v1/jobs", headers={"Authorization": header.encode()} if header else {})
    assert (answer.status_code, answer.json()["code"]) == (401, "unauthorized")
    assert answer.headers["www-authenticate"] == "Bearer"
    assert answer.json()["field"] == "Authorization"


def test_a_key_in_the_url_is_not_accepted(login: Login, farm: DrivenFarm) -> None:
    secret = farm.keys.create("k", ["read"])[1]
    assert login().get("/v1/jobs", params={"key": secret}).status_code == 401


def test_a_shared_asset_keeps_the_file_name_of_each_owner(login: Login) -> None:
    first, second = login("submit", "read"), login("submit", "read")
    asset = first.post("/v1/assets", files={"file": ("secret-film.mp4", CLIP)}).json()["id"]
    second.post("/v1/assets", files={"file": ("my-cat.mp4", CLIP)})
    for query in ("", "?download=true"):
        disposition = second.get(f"/v1/assets/{asset}/content{query}").headers["content-disposition"]
        assert "my-cat.mp4" in disposition
        assert "secret" not in disposition


def test_a_revoked_key_is_refused(login: Login, farm: DrivenFarm) -> None:
    client = login("read")
    assert client.get("/v1/jobs").status_code == 200
    farm.keys.revoke(farm.keys.list()[0].id)
    assert client.get("/v1/jobs").status_code == 401


@pytest.mark.parametrize(
    ("scope", "verb", "path", "status"),
    [
        ("read", "GET", "/v1/jobs", 200),
        ("read", "POST", "/v1/jobs/job_x/cancel", 403),
        ("read", "POST", "/v1/previews", 403),
        ("read", "DELETE", "/v1/assets/ast_x", 403),
        ("submit", "GET", "/v1/jobs", 403),
        ("submit", "DELETE", "/v1/jobs/job_x", 404),
        ("submit", "GET", "/v1/ops/snapshot", 403),
        ("submit", "GET", "/v1/keys", 403),
        ("admin", "GET", "/v1/ops/snapshot", 200),
        ("admin", "GET", "/v1/jobs", 200),
        ("read", "GET", "/metrics", 200),
    ],
)
def test_scopes_limit_the_endpoints_of_a_key(login: Login, scope: str, verb: str, path: str, status: int) -> None:
    body = {"method": "toy", "inputs": {}} if path.endswith("previews") else None
    answer = login(scope).request(verb, path, json=body)
    assert answer.status_code == status
    assert status != 403 or answer.json()["code"] == "forbidden"


def test_pages_health_and_openapi_need_no_key(login: Login) -> None:
    for path in ("/", "/docs", "/openapi.json", "/healthz", "/readyz"):
        assert login().get(path).status_code == 200, path


def test_resources_of_other_owners_are_404(login: Login, farm: DrivenFarm) -> None:
    mine, other, admin = login("read", "submit"), login("read", "submit"), login("admin")
    job = submit(mine).json()
    asset, task = job["request"]["inputs"]["video"], farm.add_task(job["id"]).id
    for path in (
        f"/v1/jobs/{job['id']}",
        f"/v1/jobs/{job['id']}/tasks",
        f"/v1/jobs/{job['id']}/events",
        f"/v1/jobs/{job['id']}/result",
        f"/v1/jobs/{job['id']}/files",
        f"/v1/jobs/{job['id']}/webhooks",
        f"/v1/tasks/{task}",
        f"/v1/tasks/{task}/log",
        f"/v1/assets/{asset}",
        f"/v1/assets/{asset}/content",
    ):
        assert other.get(path).status_code == 404, path
        assert other.get(path).json()["code"] == "not-found"
    for verb in ("cancel", "pause", "resume", "retry"):
        assert other.post(f"/v1/jobs/{job['id']}/{verb}").status_code == 404
    assert other.post(f"/v1/tasks/{task}/requeue").status_code == 404
    assert other.delete(f"/v1/jobs/{job['id']}").status_code == other.delete(f"/v1/assets/{asset}").status_code == 404
    assert other.post("/v1/jobs", json={"method": "toy", "inputs": {"video": asset}}).status_code == 404
    assert other.get("/v1/jobs").json()["items"] == other.get("/v1/assets").json()["items"] == []
    assert admin.get(f"/v1/jobs/{job['id']}").status_code == 200
    assert len(admin.get("/v1/jobs").json()["items"]) == 1


def test_the_same_bytes_may_have_two_owners(login: Login) -> None:
    one, two = login("read", "submit"), login("read", "submit")
    for client in (one, two):
        assert client.post("/v1/assets", files={"file": ("a.mp4", CLIP)}).status_code == 201
    asset = upload(one)
    assert one.delete(f"/v1/assets/{asset}").status_code == 204
    assert one.get(f"/v1/assets/{asset}").status_code == 404
    assert two.get(f"/v1/assets/{asset}").status_code == 200


def test_uploads_belong_to_their_key(login: Login) -> None:
    headers = {"Tus-Resumable": "1.0.0", "Upload-Length": "8"}
    where = login("read", "submit").post("/v1/uploads", headers=headers).headers["location"]
    other = login("read", "submit")
    assert other.head(where, headers=headers).status_code == other.delete(where, headers=headers).status_code == 404


def test_a_key_has_a_request_rate_limit(login: Login) -> None:
    client, other = login("read", requests_per_minute=12), login("read")
    answers = [client.get("/v1/jobs") for _ in range(4)]
    assert [answer.status_code for answer in answers] == [200, 200, 429, 429]
    assert answers[2].json()["code"] == "rate-limited"
    assert 1 <= int(answers[2].headers["retry-after"]) <= 5
    assert other.get("/v1/jobs").status_code == 200


def test_guessing_keys_is_rate_limited(settings: Settings, farm: DrivenFarm) -> None:
    app = create_app(settings.model_copy(update={"auth": "required", "requests_per_minute": 30}), farm)
    client = TestClient(app, "https://impasto.example")
    guesses = [client.get("/v1/jobs", headers={"Authorization": f"Bearer {n}"}).status_code for n in range(7)]
    assert guesses[:5] == [401] * 5
    assert guesses[-1] == 429


def test_quotas_limit_jobs_and_asset_bytes(login: Login) -> None:
    jobs = login("submit", active_jobs=1)
    once = {"Idempotency-Key": "once"}
    assert [submit(jobs, headers=once).status_code for _ in range(2)] == [201, 200]  # the same job costs nothing
    assert submit(jobs).status_code == 429
    client = login("submit", asset_bytes=len(CLIP))
    assert client.post("/v1/assets", files={"file": ("a.mp4", CLIP)}).status_code == 201
    assert (
        client.post("/v1/assets", files={"file": ("a.mp4", CLIP)}).status_code == 200
    )  # the owner has these bytes already: no quota is used
    full = client.post("/v1/assets", files={"file": ("a.mp4", CLIP + b"!")})
    assert (full.status_code, full.json()["code"]) == (429, "quota-exceeded")
    tus = {"Tus-Resumable": "1.0.0", "Upload-Length": "1"}
    assert client.post("/v1/uploads", headers=tus).status_code == 429


def test_a_job_that_is_started_again_counts_against_the_quota(login: Login) -> None:
    client = login("submit", "read", active_jobs=1)
    first = submit(client).json()["id"]
    client.post(f"/v1/jobs/{first}/cancel")
    second = submit(client).json()["id"]
    refused = client.post(f"/v1/jobs/{first}/retry")
    assert (refused.status_code, refused.json()["code"]) == (429, "quota-exceeded")
    client.post(f"/v1/jobs/{second}/cancel")
    assert client.post(f"/v1/jobs/{first}/retry").status_code == 200


def test_an_admin_creates_and_revokes_keys(settings: Settings, farm: DrivenFarm) -> None:
    closed = settings.model_validate(settings.model_dump() | {"auth": "required", "admin_key": ADMIN})
    client = TestClient(
        create_app(closed, farm), "https://impasto.example", headers={"Authorization": f"Bearer {ADMIN}"}
    )
    made = client.post("/v1/keys", json={"name": "ci", "scopes": ["read"], "quotas": {"active_jobs": 2}})
    assert made.status_code == 201
    with_key = {"Authorization": f"Bearer {made.json()['secret']}"}
    assert client.get("/v1/jobs", headers=with_key).status_code == 200
    assert made.json()["secret"] not in client.get("/v1/keys").text
    assert client.delete(f"/v1/keys/{made.json()['key']['id']}").json()["revoked_at"] > 0
    assert client.get("/v1/jobs", headers=with_key).status_code == 401
    assert client.delete("/v1/keys/key_none").status_code == 404


# -- open on loopback


FOREIGN = ["evil.example", "127.0.0.1.evil.example", "[::1", "", "evil@127.0.0.1", "evil@127.0.0.1:8420", "127.0.0.1/x"]


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.1:8420", "localhost:1", "[::1]:8420", "LOCALHOST"])
def test_loopback_requests_need_no_key(client: TestClient, host: str) -> None:
    assert client.get("/v1/jobs", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize("host", ["0.0.0.0:8420", "192.168.0.1", *FOREIGN])
def test_an_unknown_host_header_is_refused(client: TestClient, host: str) -> None:
    answer = client.get("/v1/jobs", headers={"Host": host})
    assert (answer.status_code, answer.json()["field"]) == (403, "Host")


@pytest.mark.parametrize("bound", ["127.0.0.1", "0.0.0.0"])
def test_the_host_header_is_checked_without_authentication(settings: Settings, farm: DrivenFarm, bound: str) -> None:
    more = {"auth": "off", "host": bound, "allowed_hosts": frozenset({"Studio.local"})}
    client = TestClient(create_app(settings.model_copy(update=more), farm), "http://127.0.0.1:8420")
    for host in FOREIGN:
        answer = client.get("/v1/jobs", headers={"Host": host})
        assert (answer.status_code, answer.json()["field"]) == (403, "Host"), host
        rebound = {"Host": host, "Origin": f"http://{host}"}
        assert client.post("/v1/projects", json={"name": "x"}, headers=rebound).status_code == 403, host
    for host in ("127.0.0.1:8420", "192.168.0.7:8420", "[fd00::7]:80", "studio.local", "localhost"):
        assert client.get("/v1/jobs", headers={"Host": host}).status_code == 200, host


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "http://127.0.0.1:9999", "https://127.0.0.1:8420"])
def test_a_foreign_origin_is_refused(client: TestClient, origin: str) -> None:
    answer = client.post("/v1/jobs/job_x/cancel", headers={"Origin": origin})
    assert (answer.status_code, answer.json()["field"]) == (403, "Origin")


def test_the_own_origin_is_accepted(client: TestClient) -> None:
    answer = client.post("/v1/jobs/job_x/cancel", headers={"Origin": "http://127.0.0.1:8420"})
    assert answer.status_code == 404


def test_a_non_loopback_address_requires_a_key(settings: Settings, farm: DrivenFarm) -> None:
    app = create_app(settings.model_copy(update={"host": "0.0.0.0"}), farm)
    assert TestClient(app, "http://127.0.0.1").get("/v1/jobs").status_code == 401


@pytest.mark.parametrize(
    ("host", "yes"),
    [("localhost", True), ("127.9.9.9", True), ("::1", True), ("0.0.0.0", False), ("::", False), ("a", False)],
)
def test_loopback_addresses_are_recognised(host: str, yes: bool) -> None:
    assert is_loopback(host) is yes


# -- buckets


def test_a_rate_limit_bucket_refills() -> None:
    now = 100.0
    rates = Rates(lambda: now)
    assert [rates.take("a", 2.0, 3) for _ in range(4)] == [0.0, 0.0, 0.0, 0.5]
    now += 0.5
    assert [rates.take("a", 2.0, 3) for _ in range(2)] == [0.0, 0.5]
    now += 1e6
    assert [rates.take("a", 2.0, 3) for _ in range(4)] == [0.0, 0.0, 0.0, 0.5]


def test_the_number_of_rate_limit_buckets_is_bounded() -> None:
    rates = Rates(lambda: 0.0)
    for caller in range(MAX_BUCKETS + 10):
        rates.take(str(caller), 1.0, 1)
    assert len(rates._buckets) == MAX_BUCKETS
