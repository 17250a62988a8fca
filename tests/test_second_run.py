"""Which failures are final, and what a second run does with the others."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.second_run import COMPUTES, FAILED, WAITS, is_final, main

TIME_LIMIT = re.compile(r"\btimeout=\d|settimeout\(|time\.monotonic\(|\bstarted\(|[^.]\buntil\(")
SUITE = """
from pathlib import Path

def test_late():
    mark = Path("mark")
    late, _ = not mark.exists(), mark.touch()
    assert not late

def test_wrong():
    assert False
"""


def test_the_files_that_wait_are_those_with_a_time_limit() -> None:
    files = {
        path.relative_to(ROOT).as_posix(): path for folder in COMPUTES for path in (ROOT / folder).rglob("test_*.py")
    }
    assert {file for file, path in files.items() if TIME_LIMIT.search(path.read_text())} == set(WAITS)


def test_what_computes_has_one_chance() -> None:
    assert is_final("tests/pipeline/test_frames.py::test_a_frame[1]")
    assert is_final("tests/e2e/test_page.py"), "it cannot be imported"
    assert not is_final("tests/e2e/test_page.py::test_a_page")
    assert not is_final(f"{WAITS[0]}::test_it")


def test_a_final_failure_or_none_is_not_run_again(capfd: pytest.CaptureFixture[str]) -> None:
    late, wrong = "tests/e2e/test_page.py::test_a_page", "tests/laws/test_laws.py::test_a_law"
    assert (main([late, wrong]), main([])) == (1, 1)
    assert capfd.readouterr().out.splitlines() == [
        "These failures are final:", wrong, "No test has failed, but another step.",
    ]  # fmt: skip


def test_a_late_test_passes_alone_and_a_wrong_one_fails_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.chdir(tmp_path)
    Path("test_it.py").write_text(SUITE)
    subprocess.run([sys.executable, "-m", "pytest", "-q"], capture_output=True, check=False)
    assert main(json.loads(FAILED.read_text())) == 1
    *_, failed, passed, summary = capfd.readouterr().out.splitlines()
    assert passed == "PASSED test_it.py::test_late"
    assert failed.startswith("FAILED test_it.py::test_wrong")
    assert "1 failed, 1 passed" in summary
