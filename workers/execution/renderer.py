"""`Renderer`: runs one task order, start to end, on this machine. No Ray, no store: blobs in, blobs out."""

from __future__ import annotations

import faulthandler
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2

from pipeline.errors import BadFrame, BadInput, BadParameter, Cancelled
from pipeline.methods import method, parse_params
from pipeline.methods.base import AnyParams, Method, Params, Step, Task
from pipeline.video.guard.decoder_server import start_decoder_server
from workers.blobs.base import Blobs
from workers.contract.order import ProgressReport, TaskOrder, TaskOutcome
from workers.errors import NotFound, WrongVersion
from workers.execution.artefact_handover import ArtefactHandover
from workers.execution.assembly import Assembly
from workers.execution.context import AttemptContext
from workers.execution.decoders import Decoders
from workers.execution.frame_cache import FrameCache
from workers.execution.result_quality import report_pairs
from workers.execution.reuse import reused
from workers.execution.usage import METER
from workers.execution.warm_up import finish_warm_up, warm_up_process
from workers.faults import fault_from
from workers.jobs.job_warnings import method_warning, no_artefact_warning, note_warning
from workers.jobs.state_machine import ASSEMBLE
from workers.process.free_memory import return_free_memory
from workers.process.heartbeat import heartbeats
from workers.process.logs import AttemptLog, captured, set_up_logs
from workers.process.starting import HUNG_STATUS
from workers.settings import FarmSettings

_LOG = logging.getLogger(__name__)


SWITCH_INTERVAL_S = 0.0005


def prepare_process() -> None:
    """Prepare a process for rendering.

    One OpenCV thread, because our own threads provide the parallelism. Short switch intervals of the interpreter: a
    method's threads return to it after every kernel, and a kernel of a small frame takes a tenth of Python's default
    interval.
    """
    cv2.setNumThreads(1)
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    start_decoder_server()
    logging.getLogger("pipeline").setLevel(logging.INFO)
    _LOG.setLevel(logging.INFO)


@dataclass(frozen=True)
class Shared:
    """Decoders, arrays on their way between tasks, and decoded frames that all renderers of a process use. The pool
    closes the decoders."""

    decoders: Decoders
    handover: ArtefactHandover
    frames: FrameCache = field(default_factory=FrameCache)


class Renderer:
    """Runs orders one after another, keeping decoders open from one to the next. Not thread-safe.

    Args:
        blobs: where inputs are and results go.
        scratch: folder for files while they are written; None: the system's.
        find: finds a method by name; by default, the registry.
        warms_up: whether `warm_up` does anything.
        overview: whether jobs get previews, a poster and a contact sheet, which only the service shows.
        shared: what the renderers of this process share; None: this one has decoders of its own and passes artefacts on
            as blobs only.
    """

    def __init__(
        self,
        blobs: Blobs,
        scratch: Path | None = None,
        find: Callable[[str], Method] = method,
        *,
        warms_up: bool = True,
        overview: bool = True,
        shared: Shared | None = None,
    ) -> None:
        prepare_process()
        self._blobs = blobs
        self._scratch = scratch
        self._find = find
        self._warms_up, self._overview = warms_up, overview
        self._owns_decoders = shared is None
        self._decoders = Decoders(blobs) if shared is None else shared.decoders
        self._shared = shared

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        if self._owns_decoders:
            self._decoders.close()

    @property
    def pid(self) -> int:
        return os.getpid()

    def kill(self) -> None:
        """End this process, because a thread that hangs cannot be ended. `impasto render` starts it again."""
        faulthandler.dump_traceback(all_threads=True)
        os._exit(HUNG_STATUS)

    def warm_up(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Load kernels before the first frame, once per process. May be called from any thread; never raises."""
        if self._warms_up:
            warm_up_process(stopped)

    def run(
        self,
        order: TaskOrder,
        report: ProgressReport = lambda done, preview="": None,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> TaskOutcome:
        """Run one attempt. Errors become part of the outcome; nothing is raised.

        Args:
            report: receives the fraction done, 0..1, a few times a second, and about every two seconds the blob key of
                a preview.
            cancelled: called about ten times a second; once it returns True, the outcome is `cancelled`.
        """
        with captured(order.job_id, order.task_id, order.attempt_id) as log:
            outcome, told = TaskOutcome(order.attempt_id, {}, {}, {}, None, {}, ""), _LatestReport(report)
            _LOG.info("step %s, task %s", order.step, order.key)
            try:
                with METER.attempt() as usage, heartbeats(told.repeat):
                    outcome = self._run(order, told, cancelled)
                outcome = replace(outcome, stages={**outcome.stages, **usage.measures()})
            except Cancelled:
                outcome = replace(outcome, cancelled=True)
            except Exception as error:
                _log_failure(order, error)
                outcome = replace(outcome, fault=fault_from(error))
            return _with_log(outcome, log)

    def _run(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome:
        with self._folder() as folder:
            chosen = self._find(order.method)
            params = None if order.step == ASSEMBLE else parse_params(chosen, order.params)
            context = AttemptContext(order, params, self._blobs, self._decoders, folder, report, cancelled)
            context.report_pairs = report_pairs(order, chosen)
            context.reads.params_read = chosen.task_params.get(f"{order.step}/{order.key.partition('-')[0]}")
            context.shown, context.opacity_of = self._overview, chosen.opacity_of
            context.made_passes = () if params is None else chosen.passes_of(params)
            if self._shared is not None:
                context.handover = self._shared.handover
                context.reads_again = chosen.reads_again
                context.frame_cache = self._shared.frames if chosen.reads_again else None
            try:
                context.progress(0.0)
                if order.earlier and (found := reused(context.reads, order.earlier, self._blobs)):
                    _LOG.info("nothing that the task reads has changed: the earlier job's result is used")
                    return found
                return self._assemble(order, context, folder) if order.step == ASSEMBLE else self._step(order, context)
            finally:
                context.close()

    def _step(self, order: TaskOrder, context: AttemptContext) -> TaskOutcome:
        step = _step_of(self._find(order.method), context.params, order.step)
        if order.versions and order.versions[-1] != (step.name, step.version):
            raise WrongVersion(
                f"The step {step.name!r} has version {order.versions[-1][1]}, and this worker knows {step.version}.",
                field="step",
                value=step.name,
                remedy="Start workers of the dispatcher's version of Impasto.",
            )
        task = Task(order.key, order.args, order.after, order.emits)
        if task.emits:
            finish_warm_up()
        with context.stages.method():
            result = dict(step.run(task, context))
        segment = context.finish()
        last = min(order.emits[1], order.frames[1]) if order.emits and order.frames else (order.emits or (0, 0))[1]
        if context.emitted and context.emitted[1] < last:
            _LOG.info("the video ended at frame %d of [%d, %d)", context.emitted[1], context.emitted[0], last)
            result["emitted"] = list(context.emitted)
        for warning in context.warnings:
            _LOG.warning("%s", warning)
        outcome = TaskOutcome(
            order.attempt_id, result, context.artefacts, context.files, segment, context.stages.seconds(), "",
            warnings=(*context.damage.warnings(), *map(method_warning, context.method_warnings)),
        )  # fmt: skip
        return replace(outcome, trace=context.reads.outcome(outcome)) if order.records_reads else outcome

    def _assemble(self, order: TaskOrder, context: AttemptContext, folder: Path) -> TaskOutcome:
        return_free_memory()  # that of the painting tasks, of which this one needs a small part
        chosen = self._find(order.method)
        assembly = Assembly(order, chosen, self._blobs, self._decoders, folder, self._overview)
        with context.stages.waiting("join"):
            result = assembly.run(context.progress)
        notes = [note_warning("video", note) for note in assembly.notes]
        warnings = (*notes, *map(no_artefact_warning, assembly.missing))
        stages = context.stages.seconds()
        return TaskOutcome(order.attempt_id, result, {}, assembly.files, None, stages, "", warnings=warnings)

    @contextmanager
    def _folder(self) -> Iterator[Path]:
        if self._scratch:
            self._scratch.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix="impasto-", dir=self._scratch))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


class _LatestReport:
    """Passes progress on, and repeats the last one as a heartbeat."""

    def __init__(self, report: ProgressReport) -> None:
        self._report, self._done = report, 0.0

    def __call__(self, done: float, preview: str = "") -> None:
        self._done = done
        self._report(done, preview)

    def repeat(self) -> None:
        self._report(self._done)


def remote_renderer(settings: FarmSettings, blobs: Blobs, scratch: Path | None) -> Renderer:
    """Entry point of a renderer process; it logs in the format of the service."""
    set_up_logs(settings)
    return Renderer(blobs, scratch, warms_up=settings.warm_up)


def _step_of(chosen: Method, params: Params, name: str) -> Step[AnyParams]:
    for step in chosen.steps_of(params):
        if step.name == name:
            return step
    raise BadParameter(f"The method {chosen.name!r} has no step of this name.", field="step", value=name)


def _log_failure(order: TaskOrder, error: Exception) -> None:
    """User errors are logged as one line, other errors with a traceback. A BadFrame counts as an internal error here,
    because the frame was made by a method."""
    if isinstance(error, BadInput | NotFound) and not isinstance(error, BadFrame):
        _LOG.warning("step %s, task %s failed: %s", order.step, order.key, error)
    else:
        _LOG.error("step %s, task %s failed", order.step, order.key, exc_info=error)


def _with_log(outcome: TaskOutcome, log: AttemptLog) -> TaskOutcome:
    return replace(outcome, log=log.text())
