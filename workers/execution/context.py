"""The task context of a worker: `pipeline.methods.base.TaskContext` over blobs."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from pydantic import JsonValue

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter, Cancelled
from pipeline.frames import Frame, Plane
from pipeline.methods.base import AnyParams, Arrays, MadePass
from pipeline.passes.made import PASSES
from pipeline.perception.cuts import thumbnail
from pipeline.video.guard.reader import GuardedReader
from pipeline.video.index import Index
from pipeline.video.media import SourceOptions
from pipeline.video.writer import SegmentSpec
from workers.blobs.base import Blobs
from workers.contract.order import ProgressReport, TaskOrder
from workers.contract.request import FAIL
from workers.execution.arrays import read_arrays
from workers.execution.artefact_handover import ArtefactHandover
from workers.execution.artefact_writer import ArtefactWriter
from workers.execution.decoders import Decoders
from workers.execution.emission import Emission, EmissionSource, EmitError
from workers.execution.frame_cache import FrameCache
from workers.execution.input_damage import InputDamage, within
from workers.execution.input_files import InputFiles
from workers.execution.pair_recorder import keep_pairs
from workers.execution.pass_files import PassWriter
from workers.execution.preview_publisher import PreviewPublisher
from workers.execution.reuse import arrays_digest
from workers.execution.stage_timer import StageTimer
from workers.jobs.frame_window import video_info
from workers.process.heartbeat import current_heartbeat
from workers.process.log_context import set_context
from workers.process.logs import attempt_facts

Picture = TypeVar("Picture")
PART = "part:"
"""Marks artefacts that are files, not arrays: parts of a download that the job's last step joins."""
_NAME = re.compile(r"[A-Za-z0-9._-]{1,150}")
_ASK_EVERY_S = 0.1
_REPORT_EVERY_S = 0.2


class AttemptContext:
    """The context of one attempt. Its blobs are under `jobs/<job>/<step>/<task>/<attempt>/`: a late attempt overwrites
    nothing. `frames`, `emit` and `progress` raise `Cancelled` once the job is cancelled. Close it.

    Args:
        params: the method's validated Params.
        scratch: a folder of this attempt's own.
    """

    def __init__(
        self,
        order: TaskOrder,
        params: AnyParams,
        blobs: Blobs,
        decoders: Decoders,
        scratch: Path,
        report: ProgressReport,
        cancelled: Callable[[], bool],
    ) -> None:
        self.params = params
        self.seed = order.seed
        self.video = video_info(order.input_info["video"], 0 if params is None else params.lead_frames)
        self.size = (self.video.width, self.video.height)
        self.stages = StageTimer()
        self.artefacts: dict[str, str] = {}
        self.files: dict[str, tuple[str, str]] = {}
        self.warnings: list[str] = []
        self.method_warnings: list[str] = []
        """What the method tells the user."""
        self.damage = InputDamage(order.on_damage == FAIL)
        self._order = order
        self.report_pairs: Sequence[int] = ()
        """Second frames of the pairs that the job's quality report measures."""
        self._facts = attempt_facts(order.job_id, order.task_id, order.attempt_id)
        self._blobs = blobs
        self._writer = ArtefactWriter(blobs)
        self._decoders = decoders
        self._scratch = scratch
        self._report = report
        self._cancelled = cancelled
        self._beat = current_heartbeat()
        self._last_check = self._last_report = float("-inf")
        self._done = 0.0
        self._publisher = PreviewPublisher(blobs, self._key("live"))
        self._ended_at: int | None = None
        self._index: Index | None = None
        self._exit_stack = ExitStack()
        self._emission: Emission | None = None
        self._has_alpha: dict[str, bool] = {}
        """Whether the pictures of an input have opacity, by the inputs that were opened."""
        self.opacity_of = "video"
        """The input whose opacity the film gets."""
        self.made_passes: tuple[MadePass, ...] = ()
        """Passes that the method can make."""
        self._passes: PassWriter | None = None
        self._inputs = InputFiles(order, blobs)
        self._exit_stack.callback(self._inputs.close)
        self.reads = self._inputs.reads
        self.handover: ArtefactHandover | None = None
        """Holds saved artefacts for later tasks in this process; None: tasks read them from the blob store only."""
        self.reads_again = False
        """Whether artefacts stay in the handover for further tasks that read them."""
        self.frame_cache: FrameCache | None = None
        """Keeps decoded frames for later tasks in this process; None: tasks read them from decoders only."""
        self.shown = True
        """Whether previews may be published."""

    # -- inputs

    def frames(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        def read(reader: GuardedReader, first: int, last: int | None) -> Iterator[Frame]:
            frames = reader.read(first, last) if cache is None else cache.read(cached, reader, first, last)
            return keep_pairs(frames, set(self.report_pairs), self.save, -self.video.lead) if pairs else frames

        cache, pairs = self.frame_cache, self._is_first_pass(name, start, stop)
        cached = self._cache_key(name)
        return self._read(name, start, stop, read)

    @property
    def deep(self) -> bool:
        return self._order.output.encoding.is_deep

    def deep_frames(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[AnyArray]:
        if not self.deep:
            return self.frames(name, start, stop)
        return self._read(name, start, stop, GuardedReader.read, replace(self._options(name), deep=True))

    @property
    def paints_opacity(self) -> bool:
        return self._order.output.alpha == "painted"

    def mattes(self, start: int, stop: int) -> Iterator[AnyArray] | None:
        return self._matte(start, stop)

    def thumbnails(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[Plane]:
        pairs = self._is_first_pass(name, start, stop) and self.report_pairs
        if pairs or self.frame_cache is not None:  # the frames themselves are kept
            return map(thumbnail, self.frames(name, start, stop))
        return self._read(name, start, stop, GuardedReader.read_thumbnails)

    def _read(
        self, name: str, start: int | None, stop: int | None,
        read: Callable[[GuardedReader, int, int | None], Iterator[Picture]], options: SourceOptions | None = None,
    ) -> Iterator[Picture]:  # fmt: skip
        """The pictures that `read` returns for frames [start, stop) of an input; records the input's damage.

        Args:
            options: None: those of the job; others: the frame cache is not used.
        """
        first, last = self._span(name, start, stop)
        key, cache = self._inputs.key(name), self.frame_cache if options is None else None
        to_decode = first if cache is None else cache.first_missing(self._cache_key(name), first)
        with self._decoders.reader(key, to_decode, options or self._options(name)) as reader:
            self._has_alpha[name] = reader.has_alpha
            noted, unreadable, at = len(reader.errors), len(reader.unreadable), first
            expected = within(reader.index, self._span(name, None, None))
            self.damage.note(name, reader.notes)
            self.damage.record(name, expected, ())
            if name == "video":
                self._index = reader.index
            source = read(reader, first, last)
            while (frame := self._next(source)) is not None:
                at += 1
                if len(reader.unreadable) > unreadable:
                    self.damage.record(name, expected, reader.unreadable[unreadable:])
                    unreadable = len(reader.unreadable)
                yield frame
            self.warnings += [f"{name}: {error}" for error in reader.errors[noted:]]
        if name == "video" and (last is None or at < last):
            self._ended_at = at

    def _options(self, name: str) -> SourceOptions:
        """Reading options of the input: those of the job for the video, otherwise the defaults."""
        options = self._order.reading if name == "video" else SourceOptions()
        if name == self.opacity_of and self._order.output.reads_colours:
            options = replace(options, opacity="straight")
        return options

    def _cache_key(self, name: str) -> str:
        """Key of the input's frames in the frame cache."""
        options = self._options(name)
        return self._inputs.key(name) + ("" if options == SourceOptions() else f" {options}")

    def _is_first_pass(self, name: str, start: int | None, stop: int | None) -> bool:
        """Whether the first step reads the whole video: then, frames for the quality report are saved."""
        if name != "video" or (start, stop) != (None, None) or self._order.results or self._order.emits:
            return False
        self.reads.record("report")
        return True

    def _span(self, name: str, start: int | None, stop: int | None) -> tuple[int, int | None]:
        """Frames [start, stop) of an input; None: of the video, the frames to paint."""
        if name == "video" and self._order.frames is not None:
            start = self.video.first if start is None else start
            stop = self.video.stop if stop is None else stop
        return start or 0, stop

    def _next(self, source: Iterator[Picture]) -> Picture | None:
        self._check_cancelled()
        with self.stages.waiting("decode"):
            return next(source, None)

    def image(self, name: str) -> Frame:
        return next(self.frames(name, 0, 1))

    def has(self, name: str) -> bool:
        return self._inputs.has(name)

    def json(self, name: str) -> JsonValue:
        return self._inputs.json(name)

    def images(self, name: str) -> Mapping[int, AnyArray]:
        return self._inputs.images(name)

    def entries(self, name: str) -> Mapping[str, bytes]:
        return self._inputs.entries(name)

    def passes(self) -> Mapping[str, bytes]:
        return self._inputs.entries("video")

    @property
    def pass_facts(self) -> Mapping[str, JsonValue]:
        found: Mapping[str, JsonValue] = self._order.input_info["video"].get("passes", {})
        return found

    # -- artefacts

    def save(self, name: str, arrays: Arrays) -> None:
        self._beat()
        with self.stages.waiting("store"):
            digest = f"-{arrays_digest(arrays)}" if self._order.records_reads else ""
            key = self._key(f"{_checked(name)}{digest}.npz")
            copies = None if self.handover is None else self.handover.give(key, arrays)
            self._writer.put(key, arrays if copies is None else copies)
        self._keep(name, key)

    def load(self, step: str, name: str) -> dict[str, AnyArray]:
        self._beat()
        self.reads.record(f"artefact {step}/{name}")
        key = self._order.artefacts[f"{step}/{name}"]
        with self.stages.waiting("store"):
            handed = self._handed_over(key)
            return read_arrays(self._blobs.get(key)) if handed is None else handed

    def _handed_over(self, key: str) -> dict[str, AnyArray] | None:
        if self.handover is None:
            return None
        return self.handover.copy(key) if self.reads_again else self.handover.take(key)

    def save_file(self, name: str, data: bytes, media_type: str) -> None:
        """Keep a file for the user. If its name is `<artefact>-...` with an artefact that the job requested, it is a
        part of that artefact: the last step joins all parts (of zips: their entries) to one zip of that name."""
        key = self._key(f"files/{_checked(name)}")
        with self.stages.waiting("store"):
            self._blobs.put(key, data)
        if any(name.startswith(f"{artefact}-") for artefact in self._order.output.artefacts):
            self._keep(f"{PART}{name}", key)
        else:
            self.files[name] = (key, media_type)

    def warn(self, message: str) -> None:
        self.method_warnings.append(message)

    def wants(self, artefact: str) -> bool:
        self.reads.record(f"wants {artefact}")
        return artefact in self._order.output.artefacts

    def wants_pass(self, name: str) -> bool:
        self.reads.record(f"pass {name}")
        return name in self._order.output.passes

    def emit_passes(self, index: int, made: Arrays) -> None:
        self._check_cancelled()
        if self.video.delivers(index):
            with self.stages.blocked():
                self._passes = self._passes or PassWriter(
                    self.made_passes, self._order.output, self._scratch, self.size
                )
                self._passes.add(self._video_index().number(index), made)

    def _finish_passes(self) -> None:
        path = None if self._passes is None else self._passes.finish()
        if path is not None:
            key = self._key(f"files/{PASSES}-{self._order.key}")
            with self.stages.waiting("store"):
                self._blobs.put(key, path)
            self._keep(f"{PART}{PASSES}-{self._order.step}-{self._order.key}", key)

    def _keep(self, name: str, key: str) -> None:
        full = f"{self._order.step}/{name}"
        if full in self.artefacts or full in self._order.artefacts:
            raise BadParameter("An artefact's name is unique in its step.", field="artefact", value=full)
        self.artefacts[full] = key

    def _key(self, name: str) -> str:
        order = self._order
        return f"jobs/{order.job_id}/{order.step}/{order.key}/{order.attempt_id}/{name}"

    # -- frames out

    def emit(self, index: int, frame: AnyArray) -> None:
        self._check_cancelled()
        if not self.video.delivers(index):
            return
        with self.stages.blocked():
            self._emission = self._emission or self._start_emission()
            self._emission.take(index, frame)
        self.show(frame)

    def show(self, frame: AnyArray) -> None:
        self._check_cancelled()
        if self.shown and self._publisher.due():
            with self.stages.waiting("store"):
                preview = self._publisher.put(frame)
            self._report(self._done, preview)

    def _start_emission(self) -> Emission:
        if (run := self._delivered_run()) is None:
            raise EmitError("This task announced no frames.", field="emit", value=self._order.key)
        index, output = self._video_index(), self._order.output
        matte = self._matte(*run) if output.keeps_opacity else None
        spec = SegmentSpec(
            output.format, self.size, index.time_base, index.fps, output.quality, output.profile,
            matte is not None or self.paints_opacity, output.colour, self._order.source.colour_view,
        )  # fmt: skip
        return Emission(self._scratch / "segment", spec, index, run, EmissionSource(self.clock, matte))

    def _delivered_run(self) -> tuple[int, int] | None:
        """Frames [start, stop) of those that the task announced that are part of the result; None: none."""
        if self._order.emits is None:
            return None
        piece = self._order.frames or self._order.emits
        start, stop = max(self._order.emits[0], piece[0]), min(self._order.emits[1], piece[1])
        return (start, stop) if start < stop else None

    def _matte(self, start: int, stop: int) -> Iterator[AnyArray] | None:
        """The opacity of the frames [start, stop) of the film, gray; None if its source has none."""
        key, options = self._inputs.key(self.opacity_of), self._options(self.opacity_of)
        if self.opacity_of not in self._has_alpha:
            with self._decoders.reader(key, 0, options) as reader:
                self._has_alpha[self.opacity_of] = reader.has_alpha
        if not self._has_alpha[self.opacity_of]:
            return None
        first, last = self._span(self.opacity_of, start, stop)
        matte = replace(options, opacity="matte", deep=self.deep)
        return self._exit_stack.enter_context(self._decoders.reader(key, first, matte)).read(first, last)

    def _video_index(self) -> Index:
        """Presentation times of the source's frames; the index is reused if the step has read the video."""
        if self._index is None:
            with self._decoders.reader(self._inputs.key("video"), 0, self._order.reading) as reader:
                self._index = reader.index
                self._has_alpha["video"] = reader.has_alpha
        return self._index

    def finish(self) -> str | None:
        """Commit artefacts, the segment and the preview; the segment's blob key, or None. Raises EmitError,
        StorageError."""
        self._finish_passes()
        with self.stages.waiting("store"):
            self._writer.finish()
        if self._delivered_run() is None:
            return None
        with self.stages.blocked():
            self._emission = self._emission or self._start_emission()
            segment = self._emission.finish(self._ended_at)
            preview = self._emission.preview() if self.shown else None
        if segment is None:
            return None
        with self.stages.waiting("store"):
            self._blobs.put(self._key("segment"), segment)
            if preview is not None:
                self._blobs.put(self._key("preview.jpg"), preview)
                self.files["preview"] = (self._key("preview.jpg"), "image/jpeg")
        return self._key("segment")

    @property
    def emitted(self) -> tuple[int, int] | None:
        """Frames [start, stop) that were emitted, or None if the task announced none."""
        run = self._delivered_run()
        return None if run is None or self._emission is None else (run[0], self._emission.next)

    # -- time

    def clock(self, stage: str) -> AbstractContextManager[None]:
        set_context(self._facts)
        self._beat()
        return self.stages.clock(stage)

    def progress(self, done: float) -> None:
        self._check_cancelled()
        now = time.monotonic()
        if now - self._last_report >= _REPORT_EVERY_S:
            self._last_report, self._done = now, min(max(0.0, done), 1.0)  # NaN: 0
            self._report(self._done)

    def _check_cancelled(self) -> None:
        set_context(self._facts)
        self._beat()
        now = time.monotonic()
        if now - self._last_check < _ASK_EVERY_S:
            return
        self._last_check = now
        if self._cancelled():
            raise Cancelled("The job was cancelled.")

    def close(self) -> None:
        self._writer.close()
        if self._emission:  # it may still read the opacity from a decoder
            self._emission.close()
        self._exit_stack.close()


def _checked(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise BadParameter("An artefact's name is made of [A-Za-z0-9._-].", field="artefact", value=name)
    return name
