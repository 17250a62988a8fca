"""docs/api.md describes every route of the service, and no other."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.methods import methods
from service.app import create_app
from service.errors import TABLE
from service.settings import Settings
from tests.conftest import ROOT
from workers.farm import open_farm

API = (ROOT / "docs" / "api.md").read_text()
README = (ROOT / "README.md").read_text()
OUTSIDE = {"/v1/live"}


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> Iterator[set[str]]:
    """All paths of the OpenAPI document, with variables written as `{id}` or `{name}`."""
    settings = Settings(home=tmp_path_factory.mktemp("home"), pool="none")
    farm = open_farm(settings)
    yield {_plain(path) for path in create_app(settings, farm).openapi()["paths"]}
    farm.stop()


def _plain(path: str) -> str:
    return re.sub(r"\{\w+_id\}", "{id}", path)


def _documented() -> set[str]:
    """Paths in the tables and the text: `GET /v1/a/{id}/b`; a following `/c` replaces the last part."""
    found: set[str] = set()
    for cell in re.findall(r"^\|([^|]*`[A-Z]+ /[^|]*)\||`[A-Z]* ?(/v1/[^`?]*)`", API, re.M):
        last = ""
        for path in re.findall(r"`(?:[A-Z]+ )?(/[^`?\s]*)", cell[0] or f"`{cell[1]}"):
            last = path if path.startswith(("/v1", "/healthz", "/readyz", "/metrics")) else _beside(last, path)
            found.add(last)
    return found


def _beside(before: str, part: str) -> str:
    return before.rpartition("/")[0] + part


def test_every_endpoint_is_documented(paths: set[str]) -> None:
    assert sorted(path for path in paths if path not in _documented()) == []


def test_every_documented_endpoint_exists(paths: set[str]) -> None:
    documented = {path.rstrip("/") for path in _documented()} - {"/v1"}
    assert sorted(documented - paths - OUTSIDE) == []


def test_every_error_code_is_documented() -> None:
    assert [code for code in TABLE if f"`{code}`" not in API] == []


def test_the_readme_names_every_method_and_its_links_resolve() -> None:
    assert [name for name in methods() if f"`{name}`" not in README] == []
    links = [link for link in re.findall(r"\]\((?!http)([^)#]+)\)", README + API) if link]
    by_others = {"docs/images/hero.jpg", "docs/abstraction.md", "DESIGN.md"}
    assert [
        link
        for link in links
        if link not in by_others and not ((ROOT / link).exists() or (ROOT / "docs" / link).exists())
    ] == []


def test_examples_compile() -> None:
    for path in (ROOT / "examples").glob("*.py"):
        compile(Path(path).read_text(), path, "exec")
