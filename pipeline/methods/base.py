"""What a method is: parameters, inputs, a plan, and step functions. Pure data and arrays; no farm, no HTTP.

A *method* describes its work as *steps*; a step is a list of *tasks*, each one unit that a worker runs alone.
The farm runs any plan and knows no method:

    plan:   for each step in order: `tasks = step.plan(brief)`          once the steps it needs are done
    run:    for each task whose `needs` and `after` are done:           on any worker, any number of times
                note = step.run(task, bench)

`brief.notes` carries the small JSON results ("notes") of finished steps, so that a later step can size itself by
what an earlier one found (scene cuts, patches). Large results are *artefacts*: named dictionaries of arrays that a
task saves on its bench and a later task loads. Finished frames are *emitted*; the platform encodes and joins them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from pipeline.frames import Frame

Note = dict[str, Any]
"""A task's small JSON result."""
Arrays = Mapping[str, NDArray[Any]]
"""An artefact: arrays by name, stored without pickle."""
InputKind = Literal["video", "image", "image-or-video", "images", "json"]


class Params(BaseModel):
    """Base of every method's parameters: unknown names and NaN are refused, values are immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)


@dataclass(frozen=True)
class InputSpec:
    """An input a method takes. The video to be stylised is always named `video`."""

    name: str
    kind: InputKind
    required: bool
    title: str
    help: str


@dataclass(frozen=True)
class VideoInfo:
    """What planning may know of the video: sizes in pixels after rotation, frame count as the container tells it.

    `frames` may be wrong (containers lie); a method that must know counts them in a step of its own.
    """

    width: int
    height: int
    frames: int
    fps: float
    duration_s: float


@dataclass(frozen=True)
class Brief:
    """All that a plan may depend on. Two equal briefs give equal plans, on any machine."""

    params: Any
    """The method's Params."""
    seed: int
    video: VideoInfo
    inputs: frozenset[str] = frozenset()
    """Names of the inputs that were given."""
    notes: Mapping[str, Mapping[str, Note]] = field(default_factory=dict)
    """Notes of finished steps: step name -> task key -> note."""


@dataclass(frozen=True)
class Needs:
    """What a task has of a machine to itself while it runs. What is not said here, the farm's settings say."""

    cpus: float | None = None
    gpus: float | None = None
    """A part of one (0.25: four such tasks share a GPU), or whole ones. 0: it computes on processors, whatever there
    is; None: it computes on the process's compute device, and takes of a GPU what the farm gives to such tasks."""
    memory_bytes: int = 0
    """Its peak, and that of the process that it runs in; 0: nothing in particular."""


@dataclass(frozen=True)
class Task:
    """One unit of a step. `key` is unique in its step, stable, and made of [a-z0-9-]."""

    key: str
    args: Note = field(default_factory=dict)
    after: tuple[str, ...] = ()
    """Keys of tasks of the SAME step that must be done first (a chain), in plan order. Earlier steps are done anyway.

    A task may load what earlier steps have saved and, of its own step, what these tasks have: nothing else, so that
    what it sees does not depend on what happened to run before it."""
    emits: tuple[int, int] | None = None
    """Frames [start, stop) that this task emits, each exactly once and in order; None = none."""
    weight: float = 1.0
    """Expected cost, for progress and ETA, in one unit for all steps of the method: what it costs to paint one frame.
    A pass that only decodes and looks is about 0.05 a frame."""
    needs: Needs | None = None
    """What it has of a machine; None: what the method's `needs` says of its step, if it has such, else what the farm's
    settings say."""


class Bench(Protocol):
    """What a step function works at: inputs in, artefacts and frames out, a clock, and a way to be told to stop."""

    params: Any
    seed: int
    video: VideoInfo
    size: tuple[int, int]
    """(width, height) of the frames, px."""

    def frames(self, name: str = "video", start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        """Decode frames [start, stop) of an input; fewer when the video ends earlier. One at a time, never all."""
        ...

    def has(self, name: str) -> bool:
        """Whether the input `name` was given."""
        ...

    def image(self, name: str) -> Frame:
        """The input `name` as one image (the first frame of a video)."""
        ...

    def json(self, name: str) -> Any:
        """The input `name` parsed as JSON."""
        ...

    def images(self, name: str) -> Mapping[int, NDArray[Any]]:
        """The images of the input `name` by the number in their file name, as stored: 8 or 16 bit, alpha kept."""
        ...

    def entries(self, name: str) -> Mapping[str, bytes]:
        """The files in the input `name` if it is an archive, by their path in it (folders that all share left out),
        read when asked for; empty if it is none."""
        ...

    def save(self, name: str, arrays: Arrays) -> None:
        """Keep arrays as the artefact `name` of this step (unique over the step's tasks)."""
        ...

    def load(self, step: str, name: str) -> dict[str, NDArray[Any]]:
        """The artefact `name` that a task of `step` has saved: an earlier step, or this one and a task of `after`.
        KeyError if there is none."""
        ...

    def save_file(self, name: str, data: bytes, media_type: str) -> None:
        """Keep a file as an artefact that the user can download (an SVG, a JSON report)."""
        ...

    def wants(self, artefact: str) -> bool:
        """Whether the job asked for an optional artefact (`output.artefacts`), for example "svg" or "labels"."""
        ...

    def emit(self, index: int, frame: Frame) -> None:
        """Hand over finished frame `index`, in order. Fast: encoding is done outside the method's clocks."""
        ...

    def show(self, frame: Frame) -> None:
        """Show a picture of work that goes on, of any size: a coarse preview before anything can be emitted."""
        ...

    def clock(self, stage: str) -> AbstractContextManager[None]:
        """Time a stage of the method (wall seconds, may overlap other threads' stages)."""
        ...

    def progress(self, done: float) -> None:
        """Report the fraction done, 0..1. Raises `Cancelled` if the job was cancelled: call it a few times a second."""
        ...


@dataclass(frozen=True)
class Step:
    """A stage of a method's plan."""

    name: str
    title: str
    plan: Callable[[Brief], Sequence[Task]]
    run: Callable[[Task, Bench], Note]
    weight: float = 1.0
    """Weight of its tasks together that is to be expected a frame of the video, until the step is planned."""


class Session(Protocol):
    """A causal method at work on a stream: one frame in, one frame out.

    `step(frame)` is `paint(look(frame))`. The two halves have memories of their own: `look` of a frame may run on one
    thread while `paint` of an earlier one runs on another, as long as each sees every frame, in order.
    """

    def step(self, frame: Frame) -> Frame: ...

    def look(self, frame: Frame) -> Any:
        """The first half: what is to be known of the incoming frame. Hand the result to `paint`."""
        ...

    def paint(self, seen: Any) -> Frame:
        """The second half: the outgoing frame."""
        ...

    def hurry(self, helper: Executor) -> None:
        """From now on, let parts of a frame that need not wait for each other run on `helper` as well: a frame is done
        sooner, for more work in all; its bytes stay the same.

        Args:
            helper: an executor of one thread. It must outlive the session.
        """
        ...

    def follow(
        self, params: Any, size: tuple[int, int], references: Mapping[str, Iterator[Frame]] | None = None
    ) -> Session:
        """A session that goes on from here with other parameters or frames of another size, without a jump.

        Args:
            params: the method's Params.
            size: (width, height) of the frames to come, px.
            references: as for `Method.stream`; None keeps those in use.

        Call it when every frame looked at has been painted; this session is not to be used any more.
        """
        ...


@dataclass(frozen=True)
class Example:
    """A ready set of parameters with a name people recognise: listed by the API, offered by the page."""

    name: str
    title: str
    params: Note


class Method(Protocol):
    """A published method. An instance is stateless; registered in `pipeline.methods`."""

    name: ClassVar[str]
    title: ClassVar[str]
    summary: ClassVar[str]
    paper: ClassVar[str]
    """Key in references.bib."""
    Params: ClassVar[type[Params]]
    inputs: ClassVar[tuple[InputSpec, ...]]
    steps: ClassVar[tuple[Step, ...]]
    artefacts: ClassVar[tuple[str, ...]]
    """Optional artefacts a job may ask for."""
    examples: ClassVar[tuple[Example, ...]]

    def stream(
        self, params: Any, size: tuple[int, int], seed: int, references: Mapping[str, Iterator[Frame]]
    ) -> Session | None:
        """A live session for frames of `size` (width, height) px, or None if the method is not causal."""
        ...


@dataclass(frozen=True)
class FoundRegions:
    """What an earlier job has found of the regions of a video, for a preview: its artefact "regions".

    Attributes:
        tubes: frame -> number of the tube that each pixel is in, int64 (height, width), at any size.
        objects: tube -> object.
    """

    tubes: Callable[[int], NDArray[np.int64]]
    objects: Mapping[int, int]


class Sketcher(Protocol):
    """One frame with a design, now; a method that takes designs has it as its attribute `sketch`."""

    def __call__(
        self, params: Any, seed: int, frames: Sequence[Frame], number: int, total: int, *,
        document: Any = None, masks: Mapping[int, NDArray[Any]] | None = None, found: FoundRegions | None = None,
    ) -> Frame:  # fmt: skip
        """The last of a few consecutive frames, painted.

        Args:
            frames: the frame and some before it; `number`: of the last one; `total`: of the video.
            document: the design, parsed JSON; masks: label maps by frame number; found: regions of an earlier job.
        """
        ...


def sketcher(chosen: Method) -> Sketcher | None:
    """How a method sketches one frame with a design, if it takes designs."""
    found: Sketcher | None = getattr(chosen, "sketch", None)
    return found


def input_schemas(chosen: Method) -> Mapping[str, Callable[[], Note]]:
    """JSON Schema, by the name of the input, of the JSON documents that a method takes, where it publishes them: its
    attribute `input_schemas`."""
    found: Mapping[str, Callable[[], Note]] = getattr(chosen, "input_schemas", {})
    return found


PROCESS_BYTES = 512 << 20
"""Of a process that runs tasks, before its first: our libraries, compiled kernels, and the children that decode."""


def needs_of(chosen: Method, step: str, brief: Brief) -> Needs | None:
    """What a task of a step has of a machine, where the method can say: its attribute `needs`, called with the step's
    name and the brief. Memory goes by the size of the frames and of the window, never by the video's length."""
    says: Callable[[str, Brief], Needs] | None = getattr(chosen, "needs", None)
    return None if says is None else says(step, brief)


def working(video: VideoInfo, bytes_a_pixel: float, device: bool = False) -> Needs:
    """Needs of a task that keeps so many bytes for each pixel of a frame.

    Args:
        device: it computes on the process's compute device.
    """
    return Needs(
        gpus=None if device else 0.0,
        memory_bytes=PROCESS_BYTES + int(bytes_a_pixel * video.width * video.height),
    )


def seeded(seed: int, *purpose: int) -> np.random.Generator:
    """Random numbers for one purpose: Philox keyed by (seed, purpose...), the same on any worker in any order."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=purpose)))
