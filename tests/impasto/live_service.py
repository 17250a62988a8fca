"""A real service on loopback with a toy method that gives frames back: what live clients are tested against."""

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
    """The one method there is, "echo", in every place of this process that looks methods up."""
    found: dict[str, Method] = {"echo": Echo()}  # type: ignore[dict-item]
    for place in ("pipeline.methods", "workers.live.sessions", "service.live.connection"):
        monkeypatch.setattr(f"{place}.methods", lambda: found)


@contextmanager
def served(home: Path, **settings: Any) -> Iterator[tuple[str, Farm]]:
    """The address of a service, and its farm."""
    chosen = Settings(home=home, pool="none", **{"live_sessions": 2, "live_resume_s": 2.0, **settings})
    farm = Farm(chosen, None)
    farm.start()
    with running(chosen, farm) as url:
        yield url, farm
    farm.stop()
