"""Options that are given twice are refused; empty environment variables count as not set."""

from __future__ import annotations

from pathlib import Path

import pytest

from impasto.cli.app import run
from impasto.settings import CommandSettings
from impasto_client import DEFAULT_SERVER
from service.settings import Settings


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["owners", "change", "usr_1", "--quota", "active_jobs=2", "--quota", "active_jobs=3"], "given twice"),
        (["ops", "costs", "--since", "2026-12-30", "--until", "2026-11-30"], "The period has no day"),
        (["ops", "costs", "--since", "2026-12-30", "--until", "2026-12-30"], "The period has no day"),
    ],
)
def test_it_is_refused_before_a_request(words: list[str], why: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*words, "--server", "http://127.0.0.1:9"]) == 2
    assert why in capsys.readouterr().err


def test_empty_variables_are_not_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty IMPASTO_HOME was the current folder."""
    for name in ("SERVER", "HOME", "API_KEY", "HOST", "PORT"):
        monkeypatch.setenv(f"IMPASTO_{name}", "")
    found = CommandSettings()
    assert found.server == DEFAULT_SERVER
    assert found.home != Path()
    service = Settings()
    assert (service.host, service.port) == ("127.0.0.1", 8420), "it would listen on all networks"
