"""The browser bundle: exact versions, no web addresses, and a clear response while it is not built."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service import bundle

KINDS = ("dependencies", "devDependencies")


def test_every_npm_package_has_an_exact_version() -> None:
    packages = [json.loads((folder / "package.json").read_text()) for folder in (bundle.WEB, bundle.TYPES)]
    versions = {name: version for each in packages for kind in KINDS for name, version in each.get(kind, {}).items()}
    assert {"vite", "openapi-fetch", "openapi-typescript"} <= set(versions)
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in versions.values()), versions


def test_the_lock_file_contains_no_host_name() -> None:
    lock = (bundle.WEB / "package-lock.json").read_text()
    assert "://" not in lock, "write it again with: python -m service.bundle lock"
    packages = json.loads(lock)["packages"]
    downloaded = [package for name, package in packages.items() if "node_modules/" in name and "link" not in package]
    assert len(downloaded) > 50
    assert all("integrity" in package for package in downloaded)


def test_missing_built_pages_are_reported_with_a_remedy(
    client: TestClient, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(bundle, "DIST", tmp_path)
    answer = client.get("/")
    assert answer.status_code == 503
    assert "make web" in answer.text


def test_a_changed_source_makes_the_built_pages_stale(pages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert bundle.is_current()
    monkeypatch.setattr(bundle, "SOURCES", ("src",))
    assert not bundle.is_current()


def test_bundled_files_are_cached_permanently_and_pages_are_not(client: TestClient, pages: Path) -> None:
    script = next((pages / "assets").glob("*.js")).name
    assert "immutable" in client.get(f"/static/assets/{script}").headers["cache-control"]
    assert client.get("/").headers["cache-control"] == "no-cache"
