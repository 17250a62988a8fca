"""A real service on loopback with a toy method that returns its frames, for tests of live clients."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from pipeline.methods.base import Method
from service.settings import Settings
from tests.service.live import running
from tests.workers.live_toys import Echo
from workers.farm import Farm


def only_echo(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make "echo" the only method wherever this process looks methods up."""
    found: dict[str, Method] = {"echo": Echo()}  # type: ignore[dict-item]
    for place in ("pipeline.methods", "workers.live.sessions", "service.live.connection"):
        monkeypatch.setattr(f"{place}.methods", lambda: found)


@contextmanager
def served(home: Path, **settings: Any) -> Iterator[tuple[str, Farm]]:
    """Start a service; its address and its farm."""
    chosen = Settings(home=home, pool="none", **{"live_sessions": 2, "live_resume_s": 2.0, **settings})
    farm = Farm(chosen, None)
    farm.start()
    with running(chosen, farm) as url:
        yield url, farm
    farm.stop()
