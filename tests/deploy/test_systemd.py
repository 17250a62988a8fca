"""deploy/systemd: systemd accepts the units, their programs exist, and they have few privileges."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from service.settings import Settings

HERE = Path(__file__).resolve().parents[2] / "deploy" / "systemd"
UNITS = sorted(HERE.glob("*.service"))
pytestmark = pytest.mark.real("systemd")


@pytest.fixture
def placed(tmp_path: Path) -> Path:
    """The units, with the programs of this environment."""
    for unit in UNITS:
        text = unit.read_text().replace("/opt/impasto/bin/", f"{Path(sys.executable).parent}/")
        (tmp_path / unit.name).write_text(text)
    return tmp_path


def test_systemd_accepts_the_units(placed: Path) -> None:
    done = subprocess.run(
        ["systemd-analyze", "verify", *sorted(map(str, placed.glob("*.service")))], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_misspelt_unit_option_is_reported(placed: Path) -> None:
    unit = placed / "impasto.service"
    unit.write_text(unit.read_text().replace("ExecStart=/", "ExecStart=/nowhere/"))
    done = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True)
    assert done.returncode != 0


@pytest.mark.parametrize("unit", UNITS, ids=lambda path: path.name)
def test_units_have_few_privileges(placed: Path, unit: Path) -> None:
    """systemd's exposure score, from 0 (no privileges) to 10 (all); a plain unit has 9.6."""
    command = ["systemd-analyze", "security", "--offline=yes", "--threshold=25", str(placed / unit.name)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-300:]


def test_the_environment_holds_known_settings() -> None:
    names = re.findall(r"^#?(IMPASTO_\w+)=", (HERE / "impasto.env.example").read_text(), re.M)
    assert names and {name.removeprefix("IMPASTO_").lower() for name in names} <= set(Settings.model_fields)
    assert shutil.which("systemd-analyze")
