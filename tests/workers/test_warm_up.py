"""Methods are warmed up once per process, in the background; the warm-up stops with the farm."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import BadInput, DeviceError
from pipeline.methods.base import Params
from tests.workers.toy import ToyRunner
from workers.blobs.disk import DiskBlobs
from workers.execution import warm_up
from workers.execution.renderer import Renderer
from workers.pools.local_pool import LocalPool


class Pupil:
    """A method that counts its warm-up frames."""

    name = "pupil"
    Params = Params
    fault: Exception | None = None

    def __init__(self) -> None:
        self.frames = 0
        self.loads = 0

    def load(self) -> None:
        self.loads += 1
        if self.fault:
            raise self.fault

    def stream(self, *args: Any) -> Pupil:
        return self

    def reconfigure(self, *args: Any) -> Pupil:
        return self

    def step(self, frame: Any) -> Any:
        self.frames += 1
        if self.fault:
            raise self.fault
        return frame


@pytest.fixture
def pupil(monkeypatch: pytest.MonkeyPatch) -> Pupil:
    made = Pupil()
    monkeypatch.setattr(warm_up, "methods", lambda: {"pupil": made})
    monkeypatch.setattr(warm_up, "_practised", threading.Event())
    return made


def test_a_process_warms_up_once(pupil: Pupil, tmp_path: Path) -> None:
    with Renderer(DiskBlobs(tmp_path)) as renderer:
        renderer.warm_up()
        renderer.warm_up()
    assert pupil.frames == 2 * warm_up.FRAMES


def test_a_process_that_does_not_warm_up_starts_without_work(pupil: Pupil, tmp_path: Path) -> None:
    with Renderer(DiskBlobs(tmp_path), warms_up=False) as renderer:
        renderer.warm_up()
    assert pupil.frames == 0


def test_a_method_warmed_by_a_render_is_not_warmed_again(pupil: Pupil) -> None:
    warm_up.begin_warm_up(pupil, Params())  # type: ignore[arg-type]
    warm_up.warm_up_process()
    warm_up.finish_warm_up()
    assert pupil.frames == warm_up.JOB_FRAMES


def test_only_a_render_loads_what_its_tasks_need_and_a_fault_shows_later(pupil: Pupil) -> None:
    """Processes that serve all methods load it with the first task."""
    warm_up.warm_up_process()
    assert pupil.loads == 0
    pupil.fault = DeviceError("no device", field="device", remedy="none")
    warm_up.begin_warm_up(pupil, Params())  # type: ignore[arg-type]
    warm_up.finish_warm_up()
    assert pupil.loads == 1


@pytest.mark.parametrize("fault", [BadInput("too small"), RuntimeError("broken")])
def test_a_failing_warm_up_of_one_method_does_not_block_others(pupil: Pupil, fault: Exception) -> None:
    pupil.fault = fault
    warm_up.warm_up_process()
    assert pupil.frames == 1


def test_the_warm_up_stops_with_the_farm(pupil: Pupil) -> None:
    warm_up.warm_up_process(stopped=lambda: pupil.frames >= 2)
    assert pupil.frames == 2


def test_a_pool_is_ready_while_it_warms_up(tmp_path: Path) -> None:
    ended = threading.Event()

    class Slow(ToyRunner):
        def warm_up(self, stopped: Callable[[], bool]) -> None:
            while not stopped():
                ended.wait(0.01)
            ended.set()

    pool = LocalPool(lambda number: Slow(DiskBlobs(tmp_path)), 1, warm_up=lambda stopped: None)
    pool.start(lambda report: None)
    assert not ended.is_set()
    pool.stop()
    assert ended.is_set()


_LOADS = """
import sys
from pipeline.methods import method, parse_params
from workers.execution.warm_up import warm_up
warm_up(method(sys.argv[1]), parse_params(method(sys.argv[1]), {}))
print("numba.np.arraymath" in sys.modules)
"""


@pytest.mark.parametrize("name", ["abstraction", "multistyle"])
def test_compiled_kernels_load_without_linear_algebra(name: str) -> None:
    """A kernel that takes the maximum or the mean of an array makes Numba import it: 0.2 s at every start."""
    command = [sys.executable, "-c", _LOADS, name]
    subprocess.run(command, check=True, capture_output=True)
    loaded = subprocess.run(command, check=True, capture_output=True, text=True)
    assert loaded.stdout.split() == ["False"]
