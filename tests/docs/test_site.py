"""The documentation site: it builds without a warning, its links and anchors exist, and it can be searched."""

from __future__ import annotations

import re
from collections import defaultdict
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from docs.site import CHAPTERS, build
from pipeline.methods import methods
from service.app import openapi_document

pytestmark = pytest.mark.slow


class Page(HTMLParser):
    """The links and ids of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.ids: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and name == "id":
                self.ids.add(value)
            elif value and ((tag, name) in {("a", "href"), ("img", "src"), ("link", "href"), ("script", "src")}):
                self.links.append(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    assert build(out) == 0, "warnings of Sphinx: see stderr"
    return out


def test_every_page_is_in_the_site(site: Path) -> None:
    for pages in CHAPTERS.values():
        for page in pages:
            assert (site / f"{page}.html").is_file(), page


def test_every_internal_link_and_anchor_exists(site: Path) -> None:
    pages = {path: Page(path.read_text()) for path in site.rglob("*.html") if "_static" not in path.parts}
    broken: dict[str, set[str]] = defaultdict(set)
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                assert parts.scheme in ("http", "https", "mailto", "data"), link
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            known = pages.get(target)
            if not target.is_file() or (parts.fragment and known and unquote(parts.fragment) not in known.ids):
                broken[str(path.relative_to(site))].add(link)
    assert len(pages) > 30
    assert not broken


def test_references_are_complete_and_searchable(site: Path) -> None:
    http = re.sub(r"<[^>]+>", "", (site / "docs" / "http.html").read_text())
    for path, item in openapi_document()["paths"].items():
        for verb in item:
            assert f"{verb.upper()} {path}" in http
    python = (site / "docs" / "python.html").read_text()
    named = ("impasto.library.render", "impasto_client.Client", "impasto_client.Client.submit")
    assert all(f'id="{name}"' in python for name in named)
    tables = (site / "docs" / "methods.html").read_text()
    assert all(name in tables for name in methods())
    index = (site / "searchindex.js").read_text()
    assert '"titles":' in index
    assert "keyframe" in index
