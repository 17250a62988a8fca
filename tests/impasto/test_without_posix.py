"""Imports and commands without POSIX modules, as on Windows: a process blocks these modules.

Windows itself is untested.

Clients, `impasto.render` and the commands that use a service work; commands that start a farm say what they need.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

MODULES = ("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "syslog", "_posixshmem")
FUNCTIONS = ("fork", "sched_getaffinity", "setsid", "killpg", "getpgid", "getloadavg", "nice")
BLOCK = f"""
import os, sys
sys.modules.update(dict.fromkeys({MODULES!r}))
for name in {FUNCTIONS!r}:
    delattr(os, name)
"""
IMPORTS = """
import importlib, pkgutil
import impasto, impasto.live, impasto.cli, impasto_client
from impasto.cli import app
modules = [m.name for p in (impasto.live, impasto_client) for m in pkgutil.walk_packages(p.__path__, p.__name__ + ".")]
for name in ["impasto.library", "impasto.cli.render", "impasto.cli.live", *modules]:
    importlib.import_module(name)
print(len(modules))
"""
RENDER = """
import numpy as np
import impasto
frames = np.full((4, 48, 64, 3), 40, np.uint8)
frames[:, 10:30, 10:30] = 200
print(sum(frame.shape == (48, 64, 3) for frame in impasto.render("abstraction", frames, lines="off")))
print(len(list(impasto.render("abstraction", sys.argv[1], lines="off"))))
"""
COMMAND = "from impasto.cli.app import run; sys.exit(run(sys.argv[1:]))"


def _run(script: str, *words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", BLOCK + script, *map(str, words)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)


def test_clients_and_commands_are_imported() -> None:
    done = _run(IMPORTS)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 20


def test_impasto_render_paints_arrays_and_files(tiny_clip: Path) -> None:
    done = _run(RENDER, tiny_clip)
    assert done.returncode == 0, done.stderr
    arrays, file = map(int, done.stdout.split())
    assert arrays == 4 and file > 1


@pytest.mark.parametrize("words", [("render", "CLIP", "-o", "out.mp4"), ("serve", "--port", "0")])
def test_commands_that_need_a_farm_say_so(words: tuple[str, ...], tiny_clip: Path, tmp_path: Path) -> None:
    given = [str(tiny_clip) if word == "CLIP" else word for word in words]
    done = _run(COMMAND, *given, "--home", tmp_path)
    assert done.returncode == 2 and "needs Linux" in done.stderr, done.stderr
    assert "Traceback" not in done.stderr and "impasto submit" in done.stderr


def test_a_command_that_uses_a_service_asks_the_service() -> None:
    done = _run(COMMAND, "jobs", "--server", "http://127.0.0.1:1")
    assert done.returncode != 0 and "No answer" in done.stderr, done.stderr
