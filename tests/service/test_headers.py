"""Security headers of every response, page and file, including files of users."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service import bundle
from service.settings import Settings
from tests.service.conftest import CLIP, open_client
from tests.service.driven_farm import DrivenFarm

SERVICE = Path(__file__).resolve().parents[2] / "service"
SCRIPTS = [*sorted(SERVICE.glob("web/src/**/*.ts*")), *sorted(SERVICE.glob("docs/*.js"))]
PAGES = [*(bundle.WEB / name for name in bundle.PAGES), SERVICE / "docs/index.html"]


def addresses(client: TestClient) -> list[str]:
    """All addresses without parameters that answer GET, and all static files."""
    plain = [path for path, item in client.get("/openapi.json").json()["paths"].items() if "get" in item]
    static = [f"/static/{path.relative_to(bundle.DIST)}" for path in sorted(bundle.DIST.rglob("*.*"))]
    known = ["/", "/live", "/docs", "/docs/docs.js", "/openapi.json", "/healthz", "/readyz", "/metrics", "/nothing"]
    return [*known, *(path for path in plain if "{" not in path), *static]


def test_every_page_and_file_has_the_security_headers(client: TestClient, pages: Path) -> None:
    looked = addresses(client)
    assert len(looked) > 40
    for path in looked:
        headers = client.get(path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'self'" in policy or "default-src 'none'" in policy, path
        assert "unsafe" not in policy and "*" not in policy, path
        assert "frame-ancestors 'none'" in policy and headers["x-frame-options"] == "DENY", path
        assert headers["x-content-type-options"] == "nosniff", path
        assert headers["referrer-policy"] == "no-referrer", path
        assert headers["cross-origin-opener-policy"] == headers["cross-origin-resource-policy"] == "same-origin", path
        wanted = "microphone=(self)" if path == "/live" else "microphone=()"
        assert wanted in headers["permissions-policy"], path
        assert not {"access-control-allow-origin", "server", "x-powered-by"} & headers.keys(), path


class Reader(HTMLParser):
    """Collects what a policy without 'unsafe' forbids, and what is loaded from other hosts."""

    def __init__(self) -> None:
        super().__init__()
        self.bad: list[str] = []
        self._inline = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.bad += [f"{tag} {name}" for name in given if name.startswith("on") or name == "style"]
        for name in ("src", "href", "action", "poster", "data"):
            if re.match(r"(?:https?:|javascript:|//)", given.get(name) or "") and tag != "a":
                self.bad.append(f"{tag} {name}={given[name]}")
        self._inline = tag if tag in ("script", "style") and "src" not in given else ""

    def handle_data(self, data: str) -> None:
        if self._inline and data.strip():
            self.bad.append(f"inline {self._inline}")

    def handle_endtag(self, tag: str) -> None:
        self._inline = ""


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_pages_use_nothing_that_their_content_policy_forbids(page: Path) -> None:
    reader = Reader()
    reader.feed(page.read_text())
    assert reader.bad == []


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_scripts_do_not_evaluate_text_as_code_or_markup(script: Path) -> None:
    text = re.sub(r"(?m)//.*$|/\*[\s\S]*?\*/", "", script.read_text())
    found = re.search(r"\beval\(|new Function\(|\.(?:inner|outer)HTML\s*=|insertAdjacentHTML|document\.write", text)
    assert not found, found and found[0]


def test_a_file_of_a_user_cannot_run_scripts(client: TestClient) -> None:
    page = b"<svg xmlns='http://www.w3.org/2000/svg'><script>alert(1)</script></svg>"
    asset = client.post("/v1/assets", files={"file": ("a.svg", CLIP + page)}).json()["id"]
    headers = client.get(f"/v1/assets/{asset}/content").headers
    assert headers["content-security-policy"].startswith("sandbox; default-src 'none'")
    assert headers["x-content-type-options"] == "nosniff"
    assert "text/html" not in headers["content-type"]


def test_metrics_need_a_key(settings: Settings, farm: DrivenFarm) -> None:
    closed = settings.model_copy(update={"auth": "required"})
    for client in open_client(closed, farm):
        assert client.get("/metrics").status_code == 401
        assert client.get("/healthz").status_code == 200


def test_the_request_id_of_an_answer_is_in_the_logs(client: TestClient) -> None:
    numbers = {client.get("/healthz").headers["x-request-id"] for _ in range(3)}
    assert len(numbers) == 3 and all(re.fullmatch(r"[0-9a-f]{16}", number) for number in numbers)
