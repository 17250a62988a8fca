"""Plan of a method: steps, tasks, and their contexts.

A *step* is a list of *tasks*; a task is a unit of work that one worker runs on its own. The farm runs any plan without
knowing the method:

    plan:   for each step in order: `tasks = step.plan(plan_context)`     when all earlier steps are done
    run:    for each task whose `after` is done:                          on any worker, any number of times
                result = step.run(task, task_context)

`PlanContext.results` holds the small JSON results of the tasks of finished steps, so that a later step can size itself
by what an earlier one found (scene cuts, patches). Large results are *artefacts*: named dictionaries of arrays that a
task saves through its context and a later task loads. Finished frames are *emitted*; the platform encodes and joins
them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol

from pydantic import JsonValue

from pipeline.arrays import AnyArray, Arrays, State
from pipeline.frames import Frame, Plane
from pipeline.methods.fields import P, P_co

TaskResult = dict[str, Any]
"""A task's small JSON result."""
Clock = Callable[[str], AbstractContextManager[None]]
"""Timer: called with the name of a stage, it returns a context manager that measures the wall time inside."""


def no_clock(stage: str) -> AbstractContextManager[None]:
    """A `Clock` that measures nothing."""
    return nullcontext()


@dataclass(frozen=True)
class VideoInfo:
    """Facts about the video that a plan may use.

    A job may paint a piece of a film. Frame numbers are those of the film everywhere: in `first`, in tasks, in
    documents and images by frame. So everything with a time is evaluated at the film's time.

    Attributes:
        width, height: px, after rotation.
        frames: number of frames to paint, according to the container, which may be wrong. A method that needs the true
            count has a step that decodes the video (`pipeline.methods.scan`).
        fps: frames per second; duration_s: seconds.
        first: number of the first frame to paint.
        film: frame count of the whole film; 0: it has no other frames.
        lead: how many of the frames are painted only for the memory of the method: they precede the piece, and what is
            emitted for them is thrown away.
    """

    width: int
    height: int
    frames: int
    fps: float
    duration_s: float
    first: int = 0
    film: int = 0
    lead: int = 0

    @property
    def stop(self) -> int:
        """Number of the frame after the last one to paint."""
        return self.first + self.frames

    @property
    def total(self) -> int:
        """Frame count of the film."""
        return max(self.film, self.stop)

    @property
    def is_piece(self) -> bool:
        """Whether the film has frames that are not part of the result."""
        return self.total > self.frames - self.lead

    def delivers(self, frame: int) -> bool:
        """Whether a frame is part of the result: it is neither outside the piece nor painted for its memory only."""
        return self.delivers_any(frame, frame + 1)

    def delivers_any(self, start: int, stop: int) -> bool:
        """Whether one of the frames [start, stop) is part of the result."""
        return not self.is_piece or (start < self.stop and stop > self.first + self.lead)


@dataclass(frozen=True)
class PlanContext(Generic[P_co]):
    """All data on which a plan may depend. Equal plan contexts give equal plans on any machine.

    Attributes:
        inputs: names of the inputs that were given.
        results: results of the tasks of finished steps: step name -> task key -> result.
        deep: whether frames have more than 8 bits of a channel, see `TaskContext.deep`; for `Method.resources` only.
    """

    params: P_co
    seed: int
    video: VideoInfo
    inputs: frozenset[str] = frozenset()
    results: Mapping[str, Mapping[str, TaskResult]] = field(default_factory=dict)
    deep: bool = False


@dataclass(frozen=True)
class Resources:
    """Resources that a task occupies while it runs. None: those of the farm's settings.

    Attributes:
        cpus: processors.
        gpus: a share of one GPU (0.25: four such tasks share it) or a whole number of GPUs. 0: the task computes on
            processors only. None: it computes on the compute device of its process.
        memory_bytes: peak memory of the task's process; 0: no declared need.
    """

    cpus: float | None = None
    gpus: float | None = None
    memory_bytes: int = 0


@dataclass(frozen=True)
class Task:
    """A unit of work of a step.

    Attributes:
        key: unique in its step, stable, made of [a-z0-9-].
        after: tasks that must be done first: "key" names a task of the same step, "step/key" one of any earlier step.
            A task may load artefacts of these tasks, and of every earlier step of which `after` names no task. So its
            input does not depend on the order in which tasks run. The running task sees `after` in plan order.
        emits: frames [start, stop) that this task emits, each exactly once and in order; None: none.
        weight: expected cost, for progress and ETA, where painting one frame costs 1. Decoding and scanning a frame
            costs about 0.05.
        resources: None: those that `Method.resources` gives for the step, else those of the farm's settings.
    """

    key: str
    args: TaskResult = field(default_factory=dict)
    after: tuple[str, ...] = ()
    emits: tuple[int, int] | None = None
    weight: float = 1.0
    resources: Resources | None = None


class TaskContext(Protocol[P_co]):
    """Environment of a running task: parameters, inputs, artefacts, emitted frames, clocks, progress, cancellation."""

    @property
    def params(self) -> P_co: ...

    @property
    def seed(self) -> int: ...

    @property
    def video(self) -> VideoInfo: ...

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the video's frames, px."""
        ...

    def frames(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        """Decode frames [start, stop) of an input, one at a time; fewer if the video ends earlier.

        Args:
            start, stop: frame numbers of the film, also outside the piece that the job paints. None: of the video, the
                frames to paint; of another input, all frames.
        """
        ...

    @property
    def deep(self) -> bool:
        """Whether the film holds more than 8 bits of a channel: emitted frames may then be uint16 or float32."""
        ...

    def deep_frames(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[AnyArray]:
        """Like `frames`; if the context is `deep`, frames of sources with more than 8 bits are uint16, or float32 with
        white at 1 and light above it."""
        ...

    @property
    def paints_opacity(self) -> bool:
        """Whether emitted frames have opacity, (h, w, 4) with straight colours: that of what the method has painted.
        Only of methods whose `paints_opacity` says that they can."""
        ...

    def mattes(self, start: int, stop: int) -> Iterator[AnyArray] | None:
        """The opacity of the source's frames [start, stop), gray; None: they are opaque."""
        ...

    def thumbnails(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[Plane]:
        """Thumbnails of frames of an input, see `pipeline.perception.cuts.thumbnail`."""
        ...

    def has(self, name: str) -> bool:
        """Whether the input `name` was given."""
        ...

    def image(self, name: str) -> Frame:
        """The input `name` as one image (the first frame of a video)."""
        ...

    def json(self, name: str) -> JsonValue:
        """The input `name` parsed as JSON."""
        ...

    def images(self, name: str) -> Mapping[int, AnyArray]:
        """The images of the input `name` by the number in their file name, as stored: 8 or 16 bit, alpha kept."""
        ...

    def entries(self, name: str) -> Mapping[str, bytes]:
        """The files of the archive `name` by path, without the folder that all share, each read on access; the file
        itself, if it is an image with planes. Empty if the input is neither."""
        ...

    def passes(self) -> Mapping[str, bytes]:
        """The files of the video, like `entries("video")`, also where frames are smaller than the video's."""
        ...

    @property
    def pass_facts(self) -> Mapping[str, JsonValue]:
        """Facts about these files, found when the video was stored: `PassFacts.as_json`; empty: none are stored."""
        ...

    def save(self, name: str, arrays: Arrays) -> None:
        """Save arrays as the artefact `name` of this step. The name is unique among the step's tasks."""
        ...

    def load(self, step: str, name: str) -> State:
        """Load the artefact `name` of a step. Which artefacts a task may load: see `Task.after`.

        Raises: KeyError, if there is no such artefact.
        """
        ...

    def save_file(self, name: str, data: bytes, media_type: str) -> None:
        """Save a file that the user can download (an SVG, a JSON report)."""
        ...

    def warn(self, message: str) -> None:
        """Tell the user something about the job, one sentence, although it continues."""
        ...

    def wants(self, artefact: str) -> bool:
        """Whether the job requests an optional artefact (`output.artefacts`), for example "svg" or "labels"."""
        ...

    def wants_pass(self, name: str) -> bool:
        """Whether the job requests the pass `name` of `Method.makes_passes`."""
        ...

    def emit_passes(self, index: int, made: Arrays) -> None:
        """Deliver passes of frame `index`, by name, of those that `wants_pass` names: (h, w) or (h, w, channels),
        integers or floating point as their descriptions say, of any size (it is enlarged to the frame's). A task calls
        it once a frame, from one thread; other tasks may deliver other passes of the frame."""
        ...

    def emit(self, index: int, frame: AnyArray) -> None:
        """Deliver finished frame `index`, in order: uint8 (h, w, 3); if the context is `deep`, also uint16 or float32
        with white at 1. Returns quickly: encoding runs outside the method's clocks."""
        ...

    def show(self, frame: Frame) -> None:
        """Publish a picture of work in progress, of any size, before frames can be emitted."""
        ...

    def clock(self, stage: str) -> AbstractContextManager[None]:
        """Measure a stage of the method, wall seconds. Stages of several threads may overlap."""
        ...

    def progress(self, done: float) -> None:
        """Report the fraction done, 0..1. Call it a few times a second.

        Raises: Cancelled, if the job was cancelled.
        """
        ...


@dataclass(frozen=True)
class Step(Generic[P]):
    """A stage of a method's plan.

    Attributes:
        weight: expected total weight of its tasks per frame of the video, used until the step is planned.
        version: of its tasks' args, results, artefacts and values. Raise it with every change of them, and that of the
            first step also with every change of the parameters' names or the list of steps: unfinished work of a lower
            version is planned again, and finished work is not reused. `tests/pipeline/methods/test_versions.py` records
            the formats.
        reads: lower versions that this one can continue from.
    """

    name: str
    title: str
    plan: Callable[[PlanContext[P]], Sequence[Task]]
    run: Callable[[Task, TaskContext[P]], TaskResult]
    weight: float = 1.0
    version: int = 1
    reads: tuple[int, ...] = ()


PROCESS_BYTES = 512 << 20
"""Memory of a worker process before its first task: libraries, compiled kernels and its decoder processes."""


def resources_per_pixel(video: VideoInfo, bytes_per_pixel: float, device: bool = False) -> Resources:
    """Resources of a task that keeps `bytes_per_pixel` bytes for each pixel of a frame.

    Args:
        device: whether the task computes on the compute device of its process.
    """
    return Resources(
        gpus=None if device else 0.0,
        memory_bytes=PROCESS_BYTES + int(bytes_per_pixel * video.width * video.height),
    )
