"""Methods practise once a process, in the background, and stop when the farm does."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import BadInput
from pipeline.methods.base import Params
from tests.workers.toy import ToyRunner
from workers.blobs.disk import DiskBlobs
from workers.execution import warm_up
from workers.execution.renderer import Renderer
from workers.pools.local_pool import LocalPool


class Pupil:
    """Counts the frames it practises on."""

    name = "pupil"
    Params = Params
    fault: Exception | None = None

    def __init__(self) -> None:
        self.frames = 0

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


def test_a_process_practises_once(pupil: Pupil, tmp_path: Path) -> None:
    with Renderer(DiskBlobs(tmp_path)) as renderer:
        renderer.warm_up()
        renderer.warm_up()
    assert pupil.frames == 2 * warm_up.FRAMES


def test_a_render_that_has_practised_is_not_disturbed(pupil: Pupil) -> None:
    warm_up.warm_up(pupil, Params())  # type: ignore[arg-type]
    warm_up.warm_up_process()
    assert pupil.frames == 2 * warm_up.FRAMES


@pytest.mark.parametrize("fault", [BadInput("too small"), RuntimeError("broken")])
def test_a_method_that_cannot_practise_hinders_nobody(pupil: Pupil, fault: Exception) -> None:
    pupil.fault = fault
    warm_up.warm_up_process()
    assert pupil.frames == 1


def test_practice_stops_with_the_farm(pupil: Pupil) -> None:
    warm_up.warm_up_process(stopped=lambda: pupil.frames >= 2)
    assert pupil.frames == 2


def test_a_pool_is_ready_while_it_warms_up(tmp_path: Path) -> None:
    ended = threading.Event()

    class Slow(ToyRunner):
        def warm_up(self, stopped: Callable[[], bool]) -> None:
            while not stopped():
                ended.wait(0.01)
            ended.set()

    pool = LocalPool(lambda: Slow(DiskBlobs(tmp_path)), 1)
    pool.start(lambda report: None)
    assert not ended.is_set()
    pool.stop()
    assert ended.is_set()
