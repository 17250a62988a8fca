"""Compilation in several processes under one lock."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from pipeline.kernels import kernel_cache
from pipeline.kernels.jit import LOCK, kernel
from pipeline.kernels.kernel_cache import UNUSED_DAYS


@kernel
def _inner(x: int) -> int:
    return x + 1


@kernel
def _outer(x: int) -> int:
    return _inner(x) * 2


def test_a_kernel_waits_while_another_process_compiles() -> None:
    folder = Path(_outer.compiled.stats.cache_path)  # type: ignore[attr-defined]
    folder.mkdir(parents=True, exist_ok=True)
    got: list[int] = []
    with (folder / LOCK).open("wb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        thread = threading.Thread(target=lambda: got.append(_outer(20)))
        thread.start()
        thread.join(0.3)
        assert got == []
    thread.join(60)
    assert got == [42], "a kernel within a kernel is compiled in the same turn"


SCRIPT = """
from tests.pipeline.kernels.test_jit import _outer
print(_outer(3), _outer(3.5))
"""


def test_processes_that_start_together_compile_once(tmp_path: Path) -> None:
    env = {"NUMBA_CACHE_DIR": str(tmp_path), "PATH": "", "HOME": str(tmp_path)}
    command = [sys.executable, "-c", SCRIPT]
    root = Path(__file__).parents[3]
    children = [subprocess.Popen(command, cwd=root, env=env, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    assert {child.communicate(timeout=90)[0] for child in children} == {"8 9.0\n"}
    assert len(list(tmp_path.rglob("*.nbc"))) == 4, "two kernels, each for integers and for real numbers"


def _run(script: str, folder: Path, **settings: str) -> str:
    """The output of a new process that runs `script` with an empty cache."""
    env = {"NUMBA_CACHE_DIR": str(folder), "PATH": "", "HOME": str(folder)} | settings
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=Path(__file__).parents[3], env=env, capture_output=True, text=True, timeout=90)
    assert done.returncode == 0, done.stderr
    return done.stdout


TWO_THREADS = """
import threading, time
from tests.pipeline.kernels.test_jit import _inner, _outer
first = threading.Thread(target=lambda: print(_outer(3)))
first.start()
time.sleep(0.3)
print(_inner(3))
first.join()
"""


def test_a_kernel_is_called_while_another_thread_compiles_its_caller(tmp_path: Path) -> None:
    assert sorted(_run(TWO_THREADS, tmp_path).split()) == ["4", "8"]


def test_numba_is_imported_at_the_first_call_of_a_kernel(tmp_path: Path) -> None:
    script = "import sys, pipeline.methods.abstraction.session; print('numba' in sys.modules)"
    assert _run(script, tmp_path) == "False\n"


def test_a_kernel_is_its_function_where_compiling_is_switched_off(tmp_path: Path) -> None:
    assert _run(SCRIPT, tmp_path, NUMBA_DISABLE_JIT="1") == "8 9.0\n"
    assert list(tmp_path.rglob("*.nbc")) == []


def test_code_that_was_not_used_for_long_is_deleted(tmp_path: Path) -> None:
    ours = tmp_path / "impasto-kernels"
    old, recent, of_others = ours / "old", ours / "recent", tmp_path / "of-others"
    for folder, days in ((old, UNUSED_DAYS + 1), (recent, UNUSED_DAYS - 1), (of_others, UNUSED_DAYS + 1)):
        folder.mkdir(parents=True)
        (folder / "kernel.nbc").write_bytes(b"code")
        os.utime(folder, (time.time() - days * 86_400,) * 2)
    assert _run(SCRIPT, tmp_path) == "8 9.0\n"
    assert not old.exists()
    assert (of_others / "kernel.nbc").exists(), "other programs keep their code in the same place"
    assert (recent / "kernel.nbc").read_bytes() == b"code"


def test_the_stamp_of_a_kernel_changes_with_its_callees(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = {"a": "from pipeline.b import f", "b": "from pipeline.c import g\nimport os", "c": "x = 1", "d": "y = 1"}
    (tmp_path / "pipeline").mkdir()
    for name, text in texts.items():
        (tmp_path / "pipeline" / f"{name}.py").write_text(text)
    monkeypatch.setattr(kernel_cache, "_ROOT", tmp_path)

    def stamps() -> dict[str, str]:
        for remembered in (kernel_cache.stamp_of, kernel_cache._imported, kernel_cache._text):
            remembered.cache_clear()
        return {name: kernel_cache.stamp_of(tmp_path / "pipeline" / f"{name}.py") for name in texts}

    before = stamps()
    (tmp_path / "pipeline" / "c.py").write_text("x = 2")
    after = stamps()
    assert {name for name in texts if before[name] != after[name]} == {"a", "b", "c"}
    moved = tmp_path / "pipeline" / "elsewhere" / "d.py"
    moved.parent.mkdir()
    moved.write_text(texts["d"])
    assert kernel_cache.stamp_of(moved) != after["d"], "compiled code names the module that it belongs to"
