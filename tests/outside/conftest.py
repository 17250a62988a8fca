"""A service in whose environment the distribution impasto-posterize is installed, and a browser."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.e2e.conftest import browser, fresh, playwright
from tests.outside import posterize

__all__ = ["browser", "fresh", "playwright"]

ROOT = Path(__file__).resolve().parents[2]
METADATA = "Metadata-Version: 2.1\nName: impasto-posterize\nVersion: 1.0\n"
ENTRY_POINTS = "[impasto.methods]\nposterize = impasto_posterize:Posterize\n"


@pytest.fixture(scope="package")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment in which the distribution impasto-posterize is installed."""
    site = tmp_path_factory.mktemp("site")
    (site / "impasto_posterize.py").write_text(Path(posterize.__file__).read_text())
    about = site / "impasto_posterize-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(METADATA)
    (about / "entry_points.txt").write_text(ENTRY_POINTS)
    return {**os.environ, "PYTHONPATH": f"{ROOT}:{site}"}


@pytest.fixture(scope="package")
def address(installed: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a service in that environment."""
    home = tmp_path_factory.mktemp("home")
    command = [sys.executable, "-m", "impasto", "serve", "--port", "0", "--home", str(home), "--workers", "1"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=installed, cwd=ROOT)
    assert process.stdout is not None
    yield process.stdout.readline().strip()
    process.terminate()
    assert process.wait(30) == 0
