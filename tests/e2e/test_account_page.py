"""Signing in, keys and groups in Chromium, with a real service and an OpenID provider over HTTP."""

from __future__ import annotations

from collections.abc import Iterator

import httpx
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.pages import KEY, Watched, serve
from tests.service.openid_provider import CLIENT, SECRET, Provider, running

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

SOON_MS = 60_000


@pytest.fixture(scope="module")
def provider() -> Iterator[Provider]:
    with running() as provider:
        provider.claims = {"sub": "u1", "name": "Anna Berger"}
        yield provider


@pytest.fixture(scope="module")
def service(provider: Provider, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    settings = {"ADMIN_KEY": KEY, "PUBLIC_URL": "http://127.0.0.1:PORT", "OIDC_ISSUER": provider.url,
                "OIDC_CLIENT_ID": CLIENT, "OIDC_CLIENT_SECRET": SECRET}  # fmt: skip
    yield from serve(tmp_path_factory.mktemp("account") / "home", **settings)


def _sign_in(page: Page, service: str) -> str:
    """Sign in from the start page; the user's id."""
    page.goto(f"{service}/#/account")
    page.get_by_role("dialog").get_by_role("link", name="Sign in").click()
    expect(page.get_by_role("heading", name="Anna Berger")).to_be_visible(timeout=SOON_MS)
    assert page.url == f"{service}/#/account", "back where it began"
    return page.locator(".account-page code").first.inner_text()


def test_a_user_signs_in_makes_a_key_works_in_a_group_and_signs_out(fresh: Watched, service: str) -> None:
    page = fresh.page
    user = _sign_in(page, service)
    cookie = next(each for each in page.context.cookies() if each["name"] == "impasto_session")
    assert cookie["httpOnly"] and cookie["sameSite"] == "Lax"

    page.get_by_label("Name of the key").fill("Blender")
    page.get_by_role("button", name="Make a key").click()
    secret = page.locator(".secret code").inner_text(timeout=SOON_MS)
    own = httpx.Client(base_url=service, headers={"Authorization": f"Bearer {secret}"}, timeout=60)
    assert own.get("/v1/me").json()["user"] == user
    page.locator(".keys li", has_text="Blender").get_by_role("button", name="Revoke").click()
    expect(page.locator(".keys li", has_text="revoked")).to_be_visible(timeout=SOON_MS)
    assert own.get("/v1/me").status_code == 401

    admin = httpx.Client(base_url=service, headers={"Authorization": f"Bearer {KEY}"}, timeout=60)
    group = admin.post("/v1/ops/owners", json={"kind": "group", "name": "Heron"}).json()["id"]
    admin.put(f"/v1/groups/{group}/members/{user}", json={"role": "editor"})
    admin.post(f"/groups/{group}/v1/projects", json={"name": "Shot 010"})
    admin.post("/v1/projects", json={"name": "Somebody else's"})
    page.reload()
    page.get_by_role("link", name="Heron").click()
    page.wait_for_url(f"**/groups/{group}/", timeout=SOON_MS)
    expect(page.get_by_role("link", name="Shot 010")).to_be_visible(timeout=SOON_MS)
    expect(page.locator("#account")).to_have_text("Heron")
    expect(page.get_by_text("Somebody else's")).to_have_count(0)

    page.goto(f"{service}/groups/{group}/#/account")
    page.locator(".account-page > .latest-head").get_by_role("button", name="Sign out").click()
    expect(page.get_by_role("dialog").get_by_role("link", name="Sign in")).to_be_visible(timeout=SOON_MS)
    assert not [each for each in page.context.cookies() if each["name"] == "impasto_session"]
    assert all("401" in complaint for complaint in fresh.complaints), fresh.complaints
