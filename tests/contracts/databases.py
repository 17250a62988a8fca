"""The databases on which the contract of the store is tested."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.databases import migrated_sqlite


def _sqlite(request: pytest.FixtureRequest, migrated: bool) -> str:
    path: Path = request.getfixturevalue("tmp_path") / "impasto.db"
    if migrated:
        migrated_sqlite(path)
    return f"sqlite:///{path}"


def _postgres(request: pytest.FixtureRequest, migrated: bool) -> str:
    server = request.getfixturevalue("postgres")
    return str(server.fresh() if migrated else server.empty())


DATABASES: dict[str, Callable[[pytest.FixtureRequest, bool], str]] = {"sqlite": _sqlite, "postgres": _postgres}
"""Name -> the URL of a new database; one that is to be migrated may be so already, where that saves time."""


def _copied_sqlite(request: pytest.FixtureRequest, url: str) -> str:
    path: Path = request.getfixturevalue("tmp_path") / "copy.db"
    shutil.copyfile(url.removeprefix("sqlite:///"), path)
    return f"sqlite:///{path}"


def _copied_postgres(request: pytest.FixtureRequest, url: str) -> str:
    return str(request.getfixturevalue("postgres").copy(url))


COPIES: dict[str, Callable[[pytest.FixtureRequest, str], str]] = {
    "sqlite": _copied_sqlite,
    "postgres": _copied_postgres,
}
"""Name -> the URL of a copy of the database at a URL, to which nothing is connected."""
