"""Signing in with an OpenID provider, over HTTP with real keys; sessions by cookie, and their protection."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest
from fastapi.testclient import TestClient
from joserfc.jwk import RSAKey
from pydantic import ValidationError
from starlette.testclient import WebSocketDenialResponse

from service.access.gate import COOKIE
from service.app import create_app
from service.settings import Settings
from tests.service.driven_farm import DrivenFarm
from tests.service.openid_provider import CLIENT, SECRET, Provider, running

HOST = "http://127.0.0.1:8420"
OWN = {"Origin": HOST}
SOCKET = "ws://127.0.0.1:8420/v1/live"


@pytest.fixture
def provider() -> Iterator[Provider]:
    with running() as provider:
        yield provider


@pytest.fixture
def settings(settings: Settings, provider: Provider) -> Settings:
    return Settings(
        home=settings.home, public_url=HOST, oidc_issuer=provider.url, oidc_client_id=CLIENT,
        oidc_client_secret=SECRET, oidc_admins="operators",
    )  # fmt: skip


@pytest.fixture
def app(settings: Settings, farm: DrivenFarm) -> Any:
    return create_app(settings, farm)


@pytest.fixture
def browser(app: Any) -> TestClient:
    return _browser(app)


def _browser(app: Any) -> TestClient:
    return TestClient(app, HOST, follow_redirects=False, raise_server_exceptions=False)


def _go(browser: TestClient, query: str = "") -> str:
    """Begin to sign in; returns the address to which the provider sends the browser back."""
    there = browser.get(f"/sign-in{query}")
    assert there.status_code == 302, there.text
    return str(httpx.get(there.headers["location"], timeout=10).headers["location"])


def _sign_in(browser: TestClient, query: str = "") -> Any:
    return browser.get(_go(browser, query))


def test_a_user_signs_in_and_out(browser: TestClient, provider: Provider, farm: DrivenFarm) -> None:
    refused = browser.get("/v1/me")
    assert (refused.status_code, refused.headers["www-authenticate"]) == (401, 'Bearer sign_in="/sign-in"')
    back = _sign_in(browser, "?next=/%23/jobs")
    assert (back.status_code, back.headers["location"]) == (303, f"{HOST}/#/jobs")
    cookie = next(line for line in back.headers.get_list("set-cookie") if line.startswith(COOKIE))
    assert "HttpOnly" in cookie and "samesite=lax" in cookie.lower() and "Path=/" in cookie
    me = browser.get("/v1/me").json()
    assert (me["name"], me["scopes"], me["session"]) == ("Anna", ["read", "submit"], True)
    assert provider.tokens == 1
    assert browser.post("/sign-out", headers=OWN).status_code == 204
    assert browser.get("/v1/me").status_code == 401
    done = [entry.action for entry in farm.audit.page(me["user"]).items]
    assert done == ["sign_out", "sign_in"]


def _proxied(app: Any, prefix: str, removed: bool) -> Any:
    """The app behind a proxy that serves it under a prefix, and removes that from paths or leaves it."""

    async def proxy(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "http":
            path = scope["path"].removeprefix(prefix) if removed else scope["path"]
            headers = [*scope["headers"], (b"x-forwarded-prefix", prefix.encode())]
            scope = {**scope, "path": path, "raw_path": path.encode(), "headers": headers}
        await app(scope, receive, send)

    return proxy


@pytest.mark.parametrize("removed", [True, False])
def test_a_user_signs_in_behind_a_path_prefix(removed: bool, settings: Settings, farm: DrivenFarm) -> None:
    public = f"{HOST}/paint"
    app = create_app(settings.model_copy(update={"public_url": public}), farm)
    browser = _browser(_proxied(app, "/paint", removed))
    assert browser.get("/paint/v1/me").headers["www-authenticate"] == 'Bearer sign_in="/sign-in"'  # in the service
    there = browser.get("/paint/sign-in?next=/paint/%23/jobs").headers["location"]
    address = str(httpx.get(there, timeout=10).headers["location"])
    assert address.startswith(f"{public}/sign-in/callback?")
    back = browser.get(address)
    assert (back.status_code, back.headers["location"]) == (303, f"{public}/#/jobs")
    cookie = next(line for line in back.headers.get_list("set-cookie") if line.startswith(COOKIE))
    assert "Path=/paint;" in f"{cookie};"
    assert browser.get("/paint/v1/me").json()["name"] == "Anna"
    assert browser.get("/v1/me").status_code == 401  # another service of that host gets no cookie


def test_the_same_subject_is_the_same_user(app: Any, provider: Provider, farm: DrivenFarm) -> None:
    users = []
    for name in ("Anna", "Anna Smith"):
        provider.claims = {"sub": "u1", "name": name}
        browser = _browser(app)
        _sign_in(browser)
        users.append(browser.get("/v1/me").json()["user"])
    provider.claims = {"sub": "u2", "email": "ben@example.org"}
    _sign_in(browser)
    other = browser.get("/v1/me").json()
    assert users[0] == users[1] != other["user"] and other["name"] == "ben@example.org"


def test_an_existing_user_is_linked_to_a_subject(browser: TestClient, provider: Provider, farm: DrivenFarm) -> None:
    key, _ = farm.keys.create("anna", ["read"])
    farm.owners.link(key.owner, f"{provider.url} u1")
    _sign_in(browser)
    assert browser.get("/v1/me").json()["user"] == key.owner


@pytest.mark.parametrize(
    "claims",
    [{"aud": "another"}, {"iss": "https://elsewhere"}, {"nonce": "replayed"}, {"exp": 1}, {"sub": None}],
    ids=str,
)
def test_an_id_token_for_another_occasion_is_refused(
    browser: TestClient, provider: Provider, claims: dict[str, Any]
) -> None:
    provider.claims = {"sub": "u1", **claims}
    back = _sign_in(browser)
    assert (back.status_code, back.json()["code"]) == (401, "unauthorized")
    assert COOKIE not in browser.cookies


def test_an_id_token_of_another_key_is_refused(browser: TestClient, provider: Provider) -> None:
    provider.signing = RSAKey.generate_key(2048, parameters={"kid": "k1"})
    assert _sign_in(browser).status_code == 401
    assert browser.get("/v1/me").status_code == 401


def test_a_way_back_that_another_browser_began_is_refused(app: Any, browser: TestClient) -> None:
    """An attacker cannot sign a victim in as the attacker: the state is in a cookie of the browser that began."""
    back = _go(browser)
    assert _browser(app).get(back).status_code == 401
    changed = back.replace(parse_qs(urlsplit(back).query)["state"][0], "guessed")
    assert browser.get(changed).status_code == 401
    assert browser.get(back).status_code == 303
    assert browser.get(back).status_code == 401, "once only"


def test_a_code_is_worth_nothing_without_the_verifier(browser: TestClient, provider: Provider) -> None:
    back = _go(browser)
    for asked in provider.asked.values():
        asked["code_challenge"] = "of another browser"
    assert browser.get(back).status_code == 401 and provider.tokens == 0


def test_a_provider_that_is_down_is_said_to_be(browser: TestClient, provider: Provider) -> None:
    provider.down = True
    assert browser.get("/sign-in").status_code == 503
    provider.down = False
    assert _sign_in(browser).status_code == 303


@pytest.mark.parametrize(
    "page", ["//evil.example", "https://evil.example", "/\\evil.example", "\\/evil.example", "/\t/e.x"]
)
def test_signing_in_leads_to_no_other_host(browser: TestClient, page: str) -> None:
    there = browser.get("/sign-in", params={"next": page}).headers["location"]
    back = browser.get(httpx.get(there, timeout=10).headers["location"])
    assert back.headers["location"] == f"{HOST}/"


@pytest.mark.parametrize("origin", [{}, {"Origin": "https://evil.example"}, {"Origin": "null"}], ids=str)
def test_a_page_elsewhere_changes_nothing_with_the_cookie(browser: TestClient, origin: dict[str, str]) -> None:
    _sign_in(browser)
    body = {"name": "made by another page"}
    assert browser.post("/v1/projects", json=body, headers=origin).status_code == 403
    assert browser.post("/sign-out", headers=origin).status_code == 403
    assert browser.get("/v1/projects", headers=origin).json()["items"] == []
    with pytest.raises(WebSocketDenialResponse) as refused, browser.websocket_connect(SOCKET, headers=origin):
        pass
    assert refused.value.status_code == 403
    assert browser.post("/v1/projects", json=body, headers=OWN).status_code == 201


def test_an_ordinary_key_is_not_accepted_in_a_cookie(browser: TestClient, farm: DrivenFarm) -> None:
    browser.cookies.set(COOKIE, farm.keys.create("anna", ["read"])[1])
    assert browser.get("/v1/me").status_code == 401


def test_sessions_end_by_themselves(browser: TestClient, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch) -> None:
    _sign_in(browser)
    later = time.time() + 12 * 3600 + 1
    monkeypatch.setattr(farm.keys, "_now", lambda: later)
    assert browser.get("/v1/me").status_code == 401
    assert farm.keys.forget_sessions() == 1 and farm.keys.forget_sessions() == 0


def test_a_disabled_user_is_refused_at_once_and_at_signing_in(browser: TestClient, farm: DrivenFarm) -> None:
    _sign_in(browser)
    user = browser.get("/v1/me").json()["user"]
    farm.owners.change(user, disabled=True)
    assert browser.get("/v1/me").status_code == 401
    assert _sign_in(browser).status_code == 403
    farm.owners.change(user, disabled=False)
    assert _sign_in(browser).status_code == 303


def test_members_of_a_group_of_the_provider_are_operators(browser: TestClient, provider: Provider) -> None:
    _sign_in(browser)
    assert browser.get("/v1/ops/owners").status_code == 403
    provider.claims = {"sub": "u3", "groups": ["artists", "operators"]}
    _sign_in(browser)
    assert browser.get("/v1/ops/owners").status_code == 200


def test_who_has_signed_in_manages_the_own_keys(browser: TestClient, farm: DrivenFarm) -> None:
    other, _ = farm.keys.create("ben", ["read"])
    _sign_in(browser)
    user = browser.get("/v1/me").json()["user"]
    made = browser.post("/v1/keys", json={"name": "Blender", "scopes": ["read"]}, headers=OWN).json()
    assert made["key"]["owner"] == user
    program = TestClient(browser.app, HOST, headers={"Authorization": f"Bearer {made['secret']}"})
    assert program.get("/v1/me").json()["user"] == user
    assert program.post("/v1/keys", json={"name": "k", "scopes": ["read"]}).status_code == 403
    assert {key["owner"] for key in browser.get("/v1/keys").json()["items"]} == {user}
    for body in ({"scopes": ["admin"]}, {"scopes": ["read"], "owner": other.owner},
                 {"scopes": ["read"], "quotas": {"active_jobs": 9}}):  # fmt: skip
        assert browser.post("/v1/keys", json={"name": "k", **body}, headers=OWN).status_code == 403, body
    assert browser.delete(f"/v1/keys/{other.id}", headers=OWN).status_code == 404
    assert browser.post(f"/v1/keys/{other.id}/rotate", headers=OWN).status_code == 404
    assert browser.delete(f"/v1/keys/{made['key']['id']}", headers=OWN).status_code == 200
    assert program.get("/v1/me").status_code == 401


def test_a_link_outlives_the_session_that_made_it(browser: TestClient, farm: DrivenFarm) -> None:
    _sign_in(browser)
    project = browser.post("/v1/projects", json={"name": "x"}, headers=OWN).json()
    token = browser.post(f"/v1/projects/{project['id']}/share", json={}, headers=OWN).json()["token"]
    user = browser.get("/v1/me").json()["user"]
    browser.post("/sign-out", headers=OWN)
    assert browser.get(f"/v1/shared/{token}").status_code == 200
    farm.owners.change(user, disabled=True)
    assert browser.get(f"/v1/shared/{token}").status_code == 410


@pytest.mark.parametrize(
    "wrong",
    [{"oidc_client_id": ""}, {"public_url": ""}, {"auth": "off"}, {"oidc_issuer": "http://login.example"},
     {"public_url": "http://paint.example"}],
    ids=str,
)  # fmt: skip
def test_settings_that_cannot_work_are_refused(settings: Settings, wrong: dict[str, str]) -> None:
    given = {"oidc_issuer": "https://login.example", "oidc_client_id": "c", "public_url": "https://paint.example"}
    Settings(home=settings.home, **given)
    with pytest.raises(ValidationError, match=r"IMPASTO_|Signing in"):
        Settings(home=settings.home, **{**given, **wrong})
