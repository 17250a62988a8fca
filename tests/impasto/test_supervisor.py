"""`impasto render` goes on by itself after a library has hung in one of its threads."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import AbstractContextManager
from pathlib import Path

import psutil
import pytest

from tests.conftest import ROOT
from tests.processes import started
from tests.waiting import until

RENDER = """
import sys
from contextlib import AbstractContextManager
from pathlib import Path
from impasto.cli import supervisor

supervisor.SILENT_S = 5
supervisor.watch_from_here()
from tests.workers.hangs import HANGS
from workers.execution.renderer import Renderer
from workers.scheduling import dispatcher

mark, hang = Path(sys.argv.pop()), sys.argv.pop()
dispatcher.stall_limit_s = lambda order, stall_s: 5.0
step = Renderer._step

def hanging(self, order, context):
    if order.emits and not mark.exists():
        mark.touch()
        HANGS[hang]()
    return step(self, order, context)

Renderer._step = hanging
from impasto.cli.app import main
main()
"""


def _started(clip: Path, out: Path, *more: str) -> AbstractContextManager[subprocess.Popen[str]]:
    command = ["render", str(clip), "-m", "multistyle", "-o", str(out), "--home", f"{out}.home", "--quiet"]
    return started([sys.executable, "-c", RENDER, *command, *more], cwd=ROOT, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("hang", ["spin_in_python", "spin_in_native_code_with_the_lock"])
def test_a_render_in_which_a_library_hangs_is_started_again(hang: str, tiny_clip: Path, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    with _started(tiny_clip, tmp_path / "out.mp4", hang, str(mark)) as process:
        _, errors = process.communicate(timeout=180)
        assert process.returncode == 0, errors
    assert errors.count("A library hung; the render is started again.") == 1
    mark.touch()
    with _started(tiny_clip, tmp_path / "other.mp4", hang, str(mark)) as undisturbed:
        assert undisturbed.wait(120) == 0
    assert (tmp_path / "out.mp4").read_bytes() == (tmp_path / "other.mp4").read_bytes()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_signal_ends_both_processes(number: signal.Signals, tiny_clip: Path, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    with _started(tiny_clip, tmp_path / "out.mp4", "sleep_in_python", str(mark)) as process:
        until(mark.exists, 60)
        children = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(number)
        assert process.wait(30) == (130 if number == signal.SIGINT else -number)
    _, alive = psutil.wait_procs(children, 10)
    assert alive == []
