"""`Renderer`: runs one task order, start to end, on this machine. No Ray, no store: blobs in, blobs out."""

from __future__ import annotations

import logging
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2

from pipeline.errors import BadFrame, BadInput, BadParameter, Cancelled
from pipeline.methods import method, parse_params
from pipeline.methods.base import Method, Step, Task
from pipeline.video.guard.nursery import get_ready
from workers.assemble import Assembly
from workers.bench import TaskBench
from workers.blobs.base import Blobs
from workers.decoders import Decoders
from workers.errors import NotFound
from workers.faults import fault_from
from workers.jobs import ASSEMBLE
from workers.logs import AttemptLog, captured, set_up_logs
from workers.model import TaskOrder, TaskOutcome
from workers.pool import Tell
from workers.settings import FarmSettings
from workers.warmup import warm_up_process

_LOG = logging.getLogger(__name__)


TURN_S = 0.0005


def prepare_process() -> None:
    """What every process that renders needs first.

    One OpenCV thread: parallel work is ours to spread. Short turns at the interpreter: a method's threads come back to
    it after every kernel, and a kernel of a small frame takes a tenth of Python's default turn.
    """
    cv2.setNumThreads(1)
    sys.setswitchinterval(TURN_S)
    get_ready()
    logging.getLogger("pipeline").setLevel(logging.INFO)
    _LOG.setLevel(logging.INFO)


class Renderer:
    """Runs orders one after another, keeping decoders open from one to the next. Not thread-safe: one a thread.

    Args:
        blobs: where inputs are and results go.
        scratch: folder for files while they are written; None: the system's.
        find: finds a method by name (the registry; a test may bring its own).
    """

    def __init__(self, blobs: Blobs, scratch: Path | None = None, find: Callable[[str], Method] = method) -> None:
        prepare_process()
        self._blobs = blobs
        self._scratch = scratch
        self._find = find
        self._decoders = Decoders(blobs)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._decoders.close()

    def warm_up(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Load what methods need before their first frame, once a process. From any thread; never raises."""
        warm_up_process(stopped)

    def run(
        self,
        order: TaskOrder,
        report: Tell = lambda done, preview="": None,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> TaskOutcome:
        """Run one attempt. What goes wrong is in the outcome, never raised.

        Args:
            report: told the fraction done, 0..1, a few times a second, and every other second of a new frame to show.
            cancelled: asked ten times a second; once it says yes, the outcome is `cancelled`.
        """
        with captured(order.job_id, order.task_id, order.attempt_id) as log:
            outcome = TaskOutcome(order.attempt_id, {}, {}, {}, None, {}, "")
            _LOG.info("step %s, task %s", order.step, order.key)
            try:
                outcome = self._run(order, report, cancelled)
            except Cancelled:
                outcome = replace(outcome, cancelled=True)
            except Exception as error:
                _log_failure(order, error)
                outcome = replace(outcome, fault=fault_from(error))
            return _with_log(outcome, log)

    def _run(self, order: TaskOrder, report: Tell, cancelled: Callable[[], bool]) -> TaskOutcome:
        with self._folder() as folder:
            params = None if order.step == ASSEMBLE else parse_params(self._find(order.method), order.params)
            bench = TaskBench(order, params, self._blobs, self._decoders, folder, report, cancelled)
            try:
                bench.progress(0.0)
                return self._assemble(order, bench, folder) if order.step == ASSEMBLE else self._step(order, bench)
            finally:
                bench.close()

    def _step(self, order: TaskOrder, bench: TaskBench) -> TaskOutcome:
        step = _step_of(self._find(order.method), order.step)
        task = Task(order.key, order.args, order.after, order.emits)
        with bench.stages.method():
            note = dict(step.run(task, bench))
        segment = bench.finish()
        if bench.emitted and order.emits and bench.emitted[1] < order.emits[1]:
            _LOG.info("the video ended at frame %d of [%d, %d)", bench.emitted[1], *order.emits)
            note["emitted"] = list(bench.emitted)
        for warning in bench.warnings:
            _LOG.warning("%s", warning)
        return TaskOutcome(order.attempt_id, note, bench.artefacts, bench.files, segment, bench.stages.seconds(), "")

    def _assemble(self, order: TaskOrder, bench: TaskBench, folder: Path) -> TaskOutcome:
        prefix = f"jobs/{order.job_id}/{order.step}/{order.key}/{order.attempt_id}"
        assembly = Assembly(order, self._blobs, self._decoders, folder, prefix)
        with bench.stages.waiting("join"):
            note = assembly.run(bench.progress)
        return TaskOutcome(order.attempt_id, note, {}, assembly.files, None, bench.stages.seconds(), "")

    @contextmanager
    def _folder(self) -> Iterator[Path]:
        if self._scratch:
            self._scratch.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix="impasto-", dir=self._scratch))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def far_renderer(settings: FarmSettings, blobs: Blobs, scratch: Path | None) -> Renderer:
    """A renderer in a process of its own, whose logs are to be like those of the service."""
    set_up_logs(settings)
    return Renderer(blobs, scratch)


def _step_of(chosen: Method, name: str) -> Step:
    for step in chosen.steps:
        if step.name == name:
            return step
    raise BadParameter(f"The method {chosen.name!r} has no such step.", field="step", value=name)


def _log_failure(order: TaskOrder, error: Exception) -> None:
    """What the user is to mend is said in a line. All else may be ours to mend: where it broke is said as well, and so
    it is of an array that is no frame, since here a method has made it."""
    if isinstance(error, BadInput | NotFound) and not isinstance(error, BadFrame):
        _LOG.warning("step %s, task %s failed: %s", order.step, order.key, error)
    else:
        _LOG.error("step %s, task %s failed", order.step, order.key, exc_info=error)


def _with_log(outcome: TaskOutcome, log: AttemptLog) -> TaskOutcome:
    return replace(outcome, log=log.text())
