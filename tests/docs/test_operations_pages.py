"""Settings, commands, files and sections that docs/operations.md, runbook.md and security.md name exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.main import get_command

from impasto.cli.app import app
from impasto.settings import CommandSettings
from service.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "docs" / f"{name}.md" for name in ("operations", "users", "runbook", "security")]
OTHERS = {"IMPASTO_REQUIRE_REAL"}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_documented_settings_exist(page: Path) -> None:
    fields = {f"IMPASTO_{name.upper()}" for name in (*Settings.model_fields, *CommandSettings.model_fields)}
    named = set(re.findall(r"IMPASTO_[A-Z0-9_]+", page.read_text()))
    assert {name.removesuffix("_FILE") for name in named} - fields - OTHERS == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_documented_commands_exist(page: Path) -> None:
    known = set(get_command(app).commands)  # type: ignore[attr-defined]
    named = set(re.findall(r"(?:^    |`|exec service )impasto ([a-z]+)", page.read_text(), re.M))
    assert named <= known


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_links_resolve(page: Path) -> None:
    for target in re.findall(r"\]\(([^)]+)\)", page.read_text()):
        path, _, anchor = target.partition("#")
        found = page if not path else page.parent / path
        assert found.is_file(), target
        assert not anchor or anchor in anchors(found), target


def anchors(page: Path) -> set[str]:
    titles = re.findall(r"^#+ (.+)$", page.read_text(), re.M)
    return {re.sub(r"[^\w -]", "", title.lower()).strip().replace(" ", "-") for title in titles}


def test_named_files_exist() -> None:
    for page in PAGES:
        for name in re.findall(r"`((?:deploy|docker|tests|pipeline)/[\w./-]+?)(?:::\w+)?`", page.read_text()):
            assert (ROOT / name).exists() or name.startswith(("deploy/.env", "deploy/prometheus/secrets")), name


def test_tests_that_are_named_exist() -> None:
    page = (ROOT / "docs" / "operations.md").read_text()
    named = set(re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", page))
    assert len(named) >= 10
    for path, name in named:
        assert f"def {name}" in (ROOT / path).read_text(), f"{path}::{name}"
    guarantees = page.split("### Guarantees and their tests")[1].split("\n### ")[0]
    for row in re.findall(r"^\| (?!guarantee|---)(.*) \|$", guarantees, re.M):
        assert "`tests/" in row, f"no test for: {row}"
