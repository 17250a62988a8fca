"""The contract of a method: parameters, inputs, steps, hooks. Pure data and arrays; no farm, no HTTP.

A *method* describes its work as *steps*. A step is a list of *tasks*; a task is a unit of work that one worker runs on
its own. The farm runs any plan without knowing the method:

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
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar, Generic, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from pipeline.frames import Frame

TaskResult = dict[str, Any]
"""A task's small JSON result."""
Arrays = Mapping[str, NDArray[Any]]
"""An artefact: arrays by name, stored without pickle."""
InputKind = Literal["video", "image", "image-or-video", "images", "json"]


class Params(BaseModel):
    """Base class of every method's parameters: immutable; unknown names and NaN are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)


P = TypeVar("P", bound=Params)
P_co = TypeVar("P_co", bound=Params, covariant=True)


@dataclass(frozen=True)
class InputSpec:
    """An input of a method. The video to be stylised is always named `video`.

    Attributes:
        part: the part of a project's layer from which the input is made: "keys.image" = the images of its painted keys
            by frame, "label_styles" = that member as JSON. Empty: a file that the layer names in its own `inputs`.
        preview: whether the input takes part in a preview of a single frame. A preview refuses inputs that do not.
    """

    name: str
    kind: InputKind
    required: bool
    title: str
    help: str
    part: str = ""
    preview: bool = True


@dataclass(frozen=True)
class VideoInfo:
    """Facts about the video that a plan may use.

    Attributes:
        width, height: px, after rotation.
        frames: frame count according to the container, which may be wrong. A method that needs the true count has a
            step that decodes the video (`pipeline.methods.scan`).
        fps: frames per second; duration_s: seconds.
    """

    width: int
    height: int
    frames: int
    fps: float
    duration_s: float


@dataclass(frozen=True)
class PlanContext(Generic[P_co]):
    """Everything that a plan may depend on. Two equal plan contexts give equal plans, on any machine.

    Attributes:
        inputs: names of the inputs that were given.
        results: results of the tasks of finished steps: step name -> task key -> result.
    """

    params: P_co
    seed: int
    video: VideoInfo
    inputs: frozenset[str] = frozenset()
    results: Mapping[str, Mapping[str, TaskResult]] = field(default_factory=dict)


@dataclass(frozen=True)
class Resources:
    """Resources that a task occupies while it runs. The farm's settings fill in what is None.

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
        after: keys of tasks of the SAME step that must be done first, in plan order. Earlier steps are always done. A
            task may load artefacts of earlier steps and, within its own step, artefacts of these tasks only, so that
            its input does not depend on the order in which tasks happen to run.
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

    def frames(self, name: str = "video", start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        """Decode frames [start, stop) of an input, one at a time; fewer if the video ends earlier."""
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
        """The files of the archive `name` by path, without the folder that all share, each read on access. Empty if
        the input is not an archive."""
        ...

    def save(self, name: str, arrays: Arrays) -> None:
        """Save arrays as the artefact `name` of this step. The name is unique among the step's tasks."""
        ...

    def load(self, step: str, name: str) -> dict[str, NDArray[Any]]:
        """Load the artefact `name` of an earlier step, or of a task of this step that `Task.after` names.

        Raises: KeyError, if there is no such artefact.
        """
        ...

    def save_file(self, name: str, data: bytes, media_type: str) -> None:
        """Save a file that the user can download (an SVG, a JSON report)."""
        ...

    def wants(self, artefact: str) -> bool:
        """Whether the job asked for an optional artefact (`output.artefacts`), for example "svg" or "labels"."""
        ...

    def emit(self, index: int, frame: Frame) -> None:
        """Deliver finished frame `index`, in order. Returns quickly: encoding runs outside the method's clocks."""
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
    """

    name: str
    title: str
    plan: Callable[[PlanContext[P]], Sequence[Task]]
    run: Callable[[Task, TaskContext[P]], TaskResult]
    weight: float = 1.0


class Session(Protocol):
    """A causal method applied to a stream: one frame in, one frame out.

    `step(frame)` is `paint(analyze(frame))`. The two halves keep separate state: `analyze` of a frame may run on one
    thread while `paint` of an earlier frame runs on another, as long as each half receives every frame, in order.
    """

    def step(self, frame: Frame) -> Frame: ...

    def analyze(self, frame: Frame) -> Any:
        """First half: the analysis of the incoming frame, an opaque value for `paint`."""
        ...

    def paint(self, analysis: Any) -> Frame:
        """Second half: the outgoing frame."""
        ...

    def use_helper(self, helper: Executor) -> None:
        """Run independent parts of a frame on `helper`, too, from now on. This shortens the latency of a frame and
        raises the total CPU time; the output bytes stay the same.

        Args:
            helper: an executor with one thread. It must outlive the session.
        """
        ...

    def reconfigure(
        self, params: Any, size: tuple[int, int], references: Mapping[str, Iterator[Frame]] | None = None
    ) -> Session:
        """A session that continues this one with other parameters or another frame size, without a visible jump.

        Args:
            params: the method's Params.
            size: (width, height) of the following frames, px.
            references: as for `Method.stream`; None keeps those in use.

        Call it when every analyzed frame has been painted; do not use this session afterwards.
        """
        ...


@dataclass(frozen=True)
class Example:
    """A preset: parameters with a name that users recognise. The API lists it, the page offers it."""

    name: str
    title: str
    params: TaskResult


@dataclass(frozen=True)
class PreviewRequest(Generic[P_co]):
    """A preview of one frame, for a method that has a way of its own to draw one (`Method.preview`).

    Attributes:
        frames: uint8 (height, width, 3), consecutive; the last one is to be painted, the others come before it.
        number: of the last frame in the video; total: frames of the video.
        documents: inputs of kind "json" by name, parsed.
        images: inputs of kind "images" by name: image by frame number.
        artefacts: archives that an earlier job of the same video made, by artefact name: file by path.
    """

    params: P_co
    seed: int
    frames: Sequence[Frame]
    number: int
    total: int
    documents: Mapping[str, Any] = field(default_factory=dict)
    images: Mapping[str, Mapping[int, NDArray[Any]]] = field(default_factory=dict)
    artefacts: Mapping[str, Mapping[str, bytes]] = field(default_factory=dict)


class KeyPropagator(Protocol):
    """Repaints the frames around a painted key while somebody edits it (`Method.propagator`).

    It keeps what an edit does not change, such as motion and earlier results, from call to call. Not thread-safe: one
    call of `prepare`, or one iteration over `repaint`, at a time. An iteration may be abandoned at any frame.
    """

    @property
    def size_bytes(self) -> int:
        """Bytes of main memory that are kept between calls."""
        ...

    def prepare(self, key: int, around: int) -> None:
        """Compute in advance what `repaint` needs besides the painting.

        Args:
            key: index of the key among the frames.
            around: frames on each side of it.
        """
        ...

    def repaint(self, key: int, image: NDArray[np.uint8], around: int) -> Iterator[tuple[int, Frame]]:
        """(index, picture) of the key, then of the frames around it, nearest first; uint8 (height, width, 3).

        Args:
            image: the painted key, uint8 (height, width, 3) or, with opacity, (height, width, 4), of the frames' size.
                The key's own picture equals it where it is opaque; the method fills its transparent pixels.
        """
        ...


@dataclass(frozen=True)
class InputFault:
    """A fault of a JSON document that a method takes.

    Attributes:
        path: members and indices from the document's root.
    """

    path: tuple[str | int, ...]
    message: str
    value: Any = None
    remedy: str = ""


class InputCheck(Protocol):
    """Checks a JSON document that a method takes, before anything runs."""

    def __call__(self, document: Any, *, frames: int | None, masks: bool | None) -> Sequence[InputFault]:
        """Every fault of the document.

        Args:
            frames: frame count of the video; None: frame numbers are not checked.
            masks: whether the method's label maps are given; None: unknown.
        """
        ...


class Method:
    """Base class of a published method. An instance is stateless and registered in `pipeline.methods`.

    A subclass sets the class variables without a default and overrides the hooks that it needs.

    Attributes:
        paper: key in references.bib.
        artefacts: optional artefacts that a job may ask for.
        input_schemas: JSON Schema of the inputs of kind "json", by input name, made when asked for.
        input_checks: checks of those documents, by input name.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    summary: ClassVar[str]
    paper: ClassVar[str]
    Params: ClassVar[type[Params]]
    inputs: ClassVar[tuple[InputSpec, ...]]
    steps: ClassVar[tuple[Step[Any], ...]]
    artefacts: ClassVar[tuple[str, ...]] = ()
    examples: ClassVar[tuple[Example, ...]] = ()
    input_schemas: ClassVar[Mapping[str, Callable[[], dict[str, Any]]]] = MappingProxyType({})
    input_checks: ClassVar[Mapping[str, InputCheck]] = MappingProxyType({})

    def stream(
        self, params: Any, size: tuple[int, int], seed: int, references: Mapping[str, Iterator[Frame]]
    ) -> Session | None:
        """A live session for frames of `size` (width, height) px; None if the method is not causal."""
        return None

    def preview(self, request: PreviewRequest[Any]) -> Frame | None:
        """The last frame of the request, painted; None if the platform shall run the stream or the plan for it.

        Raises: BadParameter, if a document or an image is unsound, with the path of the fault.
        """
        return None

    def directions(self, request: PreviewRequest[Any]) -> NDArray[np.float32] | None:
        """Stroke directions in the last frame of the request: float32 (h', w', 2), angle in [0, pi), clockwise from x,
        and strength >= 0, perhaps coarser than the frame; None if the method has none. Raises as `preview`."""
        return None

    def propagator(self, params: Any, frames: Sequence[Frame], seed: int) -> KeyPropagator | None:
        """Repaints the frames around a painted key while somebody edits it; None if the method has no quick way for
        these parameters: the platform then runs the plan over those frames.

        Args:
            frames: of the shot at preview size, uint8 (height, width, 3); each is decoded when it is asked for.
        """
        return None

    def single_frame_params(self, params: Any) -> Any:
        """The parameters with which the plan paints a frame on its own: what needs other frames is switched off."""
        return params

    def resources(self, step: str, context: PlanContext[Any]) -> Resources | None:
        """Resources of a task of `step` that declares none; None: those of the farm's settings.

        Memory depends on the size of the frames and of the window, never on the length of the video.
        """
        return None


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


def seeded(seed: int, *purpose: int) -> np.random.Generator:
    """Random numbers for one purpose: Philox keyed by (seed, purpose...), equal on any worker in any order."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=purpose)))
