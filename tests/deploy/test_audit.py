""".ci/audit.py: a finding fails the build, a missing network does not."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def audit() -> ModuleType:
    spec = importlib.util.spec_from_file_location("audit", ROOT / ".ci" / "audit.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def report(*rows: dict[str, object]) -> str:
    return json.dumps({"dependencies": rows, "fixes": []})


def test_a_vulnerability_fails_the_audit(audit: ModuleType) -> None:
    hole = {"id": "PYSEC-2020-1", "fix_versions": ["2.0"], "aliases": []}
    status, text = audit.judged(
        report({"name": "a", "version": "1.0", "vulns": [hole]}, {"name": "b", "vulns": []}), ""
    )
    assert status == 1 and "a 1.0: PYSEC-2020-1, fixed in 2.0" in text


def test_no_known_vulnerability_passes_the_audit(audit: ModuleType) -> None:
    status, text = audit.judged(report({"name": "a", "vulns": []}, {"name": "b", "skip_reason": "not found"}), "")
    assert (status, text) == (0, "1 of 2 packages audited: nothing known")


@pytest.mark.parametrize(
    ("out", "complaint"),
    [("", "Traceback\nConnectionError: no route"), ("[]", ""), (report({"name": "a", "skip_reason": "x"}), "")],
)
def test_a_failed_audit_is_reported(audit: ModuleType, out: str, complaint: str) -> None:
    status, text = audit.judged(out, complaint)
    assert status == 0 and text.startswith("NOT AUDITED")


def test_ci_runs_the_audit() -> None:
    assert ".ci/audit.py" in (ROOT / ".ci" / "run").read_text() + (ROOT / "Makefile").read_text()
    assert re.search(r"^make .*\baudit\b", (ROOT / ".ci" / "run").read_text(), re.MULTILINE)
