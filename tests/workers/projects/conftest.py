"""These tests use the built-in methods, not the toy method of the farm's tests."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def only_toy() -> None:
    """Replaces the fixture of the same name."""
