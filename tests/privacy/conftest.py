"""A farm that runs nothing by itself."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from workers.farm import Farm, open_farm
from workers.settings import FarmSettings


@pytest.fixture
def farm(home: Path) -> Iterator[Farm]:
    opened = open_farm(FarmSettings(home=home, pool="none", reserve_bytes=0))
    yield opened
    opened.stop()
