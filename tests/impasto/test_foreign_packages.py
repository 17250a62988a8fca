"""The command works where PYTHONPATH and the working folder have packages named like its own; the client needs none."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from impasto.own_packages import NAMES
from impasto_client import Client
from tests.conftest import ROOT
from tests.ports import free_port
from tests.processes import started


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    for name in NAMES:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"raise RuntimeError('the foreign {name}')")
    return tmp_path


def _environment(foreign: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(foreign), str(ROOT), str(ROOT / "client")])}


def test_the_command_renders_and_serves(foreign: Path, tiny_clip: Path) -> None:
    env, impasto = _environment(foreign), [sys.executable, "-m", "impasto"]
    command = [*impasto, "render", str(tiny_clip), "-o", "out.mp4", "--home", str(foreign / "home")]
    done = subprocess.run(command, cwd=foreign, env=env, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and (foreign / "out.mp4").stat().st_size, done.stderr
    address = f"http://127.0.0.1:{free_port()}"
    serve = [*impasto, "serve", "--port", address.rpartition(":")[2], "--home", str(foreign / "served")]
    with started(serve, cwd=foreign, env=env, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline().strip() == address
        with Client(address) as client:
            job = client.submit("abstraction", {"video": client.upload(tiny_clip)["id"]}, {"lines": "off"})
            assert client.wait(job["id"], 120)["state"] == "succeeded"


def test_the_client_imports_none_of_them(foreign: Path) -> None:
    script = "import sys, impasto_client; impasto_client.Client().close(); print({*sys.modules} & " + f"{set(NAMES)})"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=foreign, env=_environment(foreign), capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "set()", done.stderr
