"""The contract of a method: everything that a new method needs is imported from here. Pure data and arrays.

A method subclasses `Method` and states its parameters (`Params`), inputs (`InputSpec`) and steps (`Step`). The parts of
the contract, by file:

    applies    when a parameter or an input has an effect, as data
    input_facts what inputs must have in common
    fields     base class of the parameters, and their fields
    tasks      steps, tasks, and the contexts in which they are planned and run
    live       sessions of causal methods on a live stream
    parts      parts of a project's layer from which inputs are made
    studio     what the web page's studio offers for layers of the method, as data
    previews   previews of single frames, found regions, repainting around painted keys, checks of documents

The rest is optional: a hook that a subclass does not override has the default of `Method`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from pipeline.arrays import AnyArray, Arrays
from pipeline.errors import BadParameter
from pipeline.frames import Frame, Plane
from pipeline.methods.applies import Alternatives, Ineffective, Situation, When, ineffective, unmade
from pipeline.methods.fields import P, P_co, Params
from pipeline.methods.input_facts import ANY, Fits, InputFacts, checked
from pipeline.methods.live import LiveFilter, References, Session
from pipeline.methods.parts import LayerPart, PaintedKeys
from pipeline.methods.previews import (
    FilmPlane,
    FilmPlaneKind,
    FilmTasks,
    FrameClusters,
    FrameRegions,
    InputCheck,
    InputFault,
    KeyPropagator,
    PreviewRequest,
)
from pipeline.methods.studio import PreviewKind, Studio
from pipeline.methods.tasks import (
    PROCESS_BYTES,
    Clock,
    PlanContext,
    Resources,
    Step,
    Task,
    TaskContext,
    TaskResult,
    VideoInfo,
    no_clock,
    resources_per_pixel,
)
from pipeline.passes.made import MadePass
from pipeline.randomness import seeded

__all__ = [
    "PROCESS_BYTES",
    "Alternatives",
    "AnyParams",
    "Arrays",
    "Clock",
    "Example",
    "Exemplar",
    "Fits",
    "FrameClusters",
    "FrameRegions",
    "Ineffective",
    "InputCheck",
    "InputFacts",
    "InputFault",
    "InputKind",
    "InputSpec",
    "JsonSchema",
    "KeyPropagator",
    "LayerPart",
    "LiveFilter",
    "MadePass",
    "MakesOpacity",
    "Method",
    "P",
    "P_co",
    "Params",
    "PlanContext",
    "PreviewRequest",
    "References",
    "Resources",
    "Session",
    "Step",
    "Studio",
    "Task",
    "TaskContext",
    "TaskResult",
    "VideoInfo",
    "When",
    "checked",
    "missing_inputs",
    "no_clock",
    "resources_per_pixel",
    "seeded",
]

InputKind = Literal["video", "image", "image-or-video", "images", "json"]
JsonSchema: TypeAlias = dict[str, JsonValue]
MakesOpacity = Literal["no", "may", "must"]
AnyParams: TypeAlias = Any
"""Parameters in the hooks of the base class. A subclass annotates its hooks with its own `Params`."""


@dataclass(frozen=True)
class InputSpec:
    """An input of a method. The video to be stylised is always named `video`.

    Attributes:
        part: the part of a project's layer (`Method.parts`) from which the input is made. Of kind "images": the part
            and a member of its pictures, such as "keys.mask". Of kind "json": the part, which `part_documents` may
            convert. Empty: a file that the layer names in its own `inputs`.
        preview: whether the input takes part in a preview of a single frame. A preview refuses inputs that do not.
        needs: name of another input that is required if this one is given; empty: none.
        applies_when: the conditions under which the input has an effect; empty: always. A live session takes pictures
            and JSON, unless a condition has a `way`.
        fits: what it must have in common with other inputs.
    """

    name: str
    kind: InputKind
    required: bool
    title: str
    help: str
    part: str = ""
    preview: bool = True
    needs: str = ""
    applies_when: Alternatives = ()
    fits: Fits = ANY


def missing_inputs(specs: Iterable[InputSpec], given: Collection[str]) -> Iterator[tuple[InputSpec, str]]:
    """Required inputs that a job lacks, each with a sentence that says why it is required.

    Args:
        specs: all inputs that the job may have.
        given: names of the inputs that it has.
    """
    known = {spec.name: spec for spec in specs}
    for spec in known.values():
        if spec.required and spec.name not in given:
            yield spec, f"The input {spec.name!r} is missing."
        if spec.needs and spec.name in given and spec.needs not in given:
            yield known[spec.needs], f"The input {spec.name!r} needs the input {spec.needs!r}, which is missing."


@dataclass(frozen=True)
class Example:
    """A preset: parameters with a name that users recognise. The API lists it, the page offers it."""

    name: str
    title: str
    params: TaskResult


@dataclass(frozen=True)
class Exemplar:
    """A painting of the style library that the method makes: of a frame of a scene of Impasto's own.

    Attributes:
        name: in addresses, [a-z-].
        scene: its name in `pipeline.scenes`; `at`: number of the frame, at 24 frames per second.
        params: the method must be causal with them.
    """

    name: str
    title: str
    scene: str
    at: int
    params: TaskResult


class Method:
    """Base class of a published method. An instance is stateless and registered in `pipeline.methods`.

    A subclass sets the class variables without a default and overrides the hooks that it needs.

    Attributes:
        paper: key in references.bib.
        artefacts: optional artefacts that a job may request.
        regions_artefact: the one that `frame_regions` reads; empty: the method finds no regions.
        parts: parts of a layer that its inputs name.
        part_documents: input of kind "json" -> the document that is made from its part, whose type is the part's;
            None: no input. An input without an entry is the part itself.
        studio: what the studio offers for layers of the method.
        opacity_of: the input whose opacity the film gets.
        depth_bits: bits of a channel that its frames have if the film holds them: 8, or more if it composites in finer
            steps.
        palette_input: the input whose colours the result takes on, for quality reports; empty: none.
        clusters_step: the step whose arrays `frame_clusters` reads; empty: the method has no clusters.
        clusters_params: values of parameters without which it finds none.
        cpu_s_per_megapixel: CPU seconds a frame and megapixel at default parameters, measured by
            `python -m benchmarks.estimates`; estimates use it until the farm has finished jobs of its own.
        cpu_growth: exponent with which CPU seconds a frame grow with its pixels, measured there too; below 1 where
            parts work at a fixed size.
        input_schemas: JSON Schema of the inputs of kind "json", by input name, made on access.
        input_examples: documents to begin with, by input name: frame count of the video -> name -> document.
        input_checks: checks of those documents, by input name.
        artefacts_when: the conditions under which an artefact can be made, by name; without an entry: always.
        makes_passes: passes that a job may request beside its film, see `TaskContext.emit_passes`.
        passes_when: as `artefacts_when`, of these passes.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    summary: ClassVar[str]
    paper: ClassVar[str]
    Params: ClassVar[type[Params]]
    inputs: ClassVar[tuple[InputSpec, ...]]
    steps: ClassVar[tuple[Step[AnyParams], ...]]
    artefacts: ClassVar[tuple[str, ...]] = ()
    passes: ClassVar[tuple[str, ...]] = ()
    """Kinds of render passes of the video that the method uses, see `pipeline.passes.facts.PassFacts.kinds`."""
    task_cpus: ClassVar[float] = 1.0
    """Processors that one task keeps busy, threads inside it included; a compute device is counted separately. For the
    scheduler of one machine, and for estimates. Ray reserves `IMPASTO_TASK_CPUS` for every task: an actor of more
    processors would keep those of two small tasks from their workers while it is idle."""
    task_threads: ClassVar[Mapping[str, float]] = MappingProxyType({})
    """Processors that a task can keep busy on a large machine, where this is more than one, by step and the first part
    of its key ("paint/run"): measured by `python -m benchmarks.one_shot`."""
    task_params: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({})
    """Names of the parameters that a task reads, by step and the first part of its key; without an entry: all. The
    results of an earlier job with other values of the rest are used again."""
    reads_again: ClassVar[bool] = False
    """Whether most frames and artefacts are read by several tasks, so that it pays to keep them in memory."""
    regions_artefact: ClassVar[str] = ""
    clusters_step: ClassVar[str] = ""
    clusters_params: ClassVar[Mapping[str, JsonValue]] = MappingProxyType({})
    examples: ClassVar[tuple[Example, ...]] = ()
    exemplars: ClassVar[tuple[Exemplar, ...]] = ()
    parts: ClassVar[tuple[LayerPart, ...]] = ()
    part_documents: ClassVar[Mapping[str, Callable[[Any], JsonValue]]] = MappingProxyType({})
    studio: ClassVar[Studio] = Studio()
    palette_input: ClassVar[str] = ""
    opacity_of: ClassVar[str] = "video"
    depth_bits: ClassVar[int] = 8
    cpu_s_per_megapixel: ClassVar[float] = 1.0
    cpu_growth: ClassVar[float] = 1.0
    input_schemas: ClassVar[Mapping[str, Callable[[], JsonSchema]]] = MappingProxyType({})
    input_examples: ClassVar[Mapping[str, Callable[[int], Mapping[str, JsonSchema]]]] = MappingProxyType({})
    input_checks: ClassVar[Mapping[str, InputCheck]] = MappingProxyType({})
    artefacts_when: ClassVar[Mapping[str, Alternatives]] = MappingProxyType({})
    makes_passes: ClassVar[tuple[MadePass, ...]] = ()
    passes_when: ClassVar[Mapping[str, Alternatives]] = MappingProxyType({})

    def inputs_of(self, params: AnyParams) -> tuple[InputSpec, ...]:
        """Inputs of a job with these parameters."""
        return self.inputs

    def keys_input(self, member: str = "image") -> str:
        """Name of the input that is made from a member of painted keys; empty: none."""
        parts = {f"{part.name}.{member}" for part in self.parts if part.value == PaintedKeys}
        return next((spec.name for spec in self.inputs if spec.part in parts), "")

    def preview_kinds(self) -> tuple[PreviewKind, ...]:
        """Kinds of previews that the service makes of layers of the method."""
        found: list[PreviewKind] = ["paint", "source", "styles", "cuts", "flicker", "matte"]
        if self.keys_input():
            found += ["keys", "propagate"]
        if self.regions_artefact:
            found += ["regions"]
        if type(self).directions is not Method.directions:
            found += ["directions"]
        if self.clusters_step:
            found += ["clusters", "spread"]
        if type(self).move_marks is not Method.move_marks:
            found += ["spread"]
        if "object" in self.studio.tools:
            found += ["object"]
        return tuple(found)

    def steps_of(self, params: AnyParams) -> tuple[Step[AnyParams], ...]:
        """Steps of a job with these parameters."""
        return self.steps

    def expected_results(self, step: str, context: PlanContext[AnyParams]) -> Mapping[str, TaskResult] | None:
        """Typical results of the tasks of `step` by key, as far as later plans use them: a job is explained before it
        runs. Tasks that are not named have the result {}. None: later plans depend on what the step finds.

        Args:
            context: with the results of the steps before, some of which may be expected ones.
        """
        return {}

    def input_faults(self, params: AnyParams, facts: Mapping[str, InputFacts]) -> list[BadParameter]:
        """Faults of the inputs together that `InputSpec` and `input_checks` cannot express.

        Args:
            facts: of the given inputs, by name.
        """
        return []

    def passes_of(self, params: AnyParams) -> tuple[MadePass, ...]:
        """Passes that a job with these parameters may request."""
        return self.makes_passes

    def paints_opacity(self, params: AnyParams) -> MakesOpacity:
        """Whether the method makes an opacity of its own, see `TaskContext.paints_opacity`."""
        return "no"

    def ineffective(
        self, params: AnyParams, inputs: Collection[str], stream: bool, piece: bool, artefacts: Collection[str] = (),
        passes: Collection[str] = (), video_passes: Collection[str] = (),
    ) -> list[Ineffective]:  # fmt: skip
        """Parameters that differ from their defaults, given inputs, and requested artefacts and passes, that have no
        effect.

        Args:
            inputs: names of the given inputs.
            stream: whether frames are painted as they arrive.
            piece: whether a piece of a film is painted.
            video_passes: kinds of render passes that the video has.
        """
        conditions = {spec.name: spec.applies_when for spec in self.inputs_of(params)}
        situation = Situation(dict(params), inputs, stream, piece, video_passes)
        found = ineffective(params.applies_when, dict(type(params)()), conditions, situation)
        lost = unmade(self.artefacts_when, artefacts, situation, "output.artefacts")
        return [*found, *lost, *unmade(self.passes_when, passes, situation, "output.passes")]

    def stream(self, params: AnyParams, size: tuple[int, int], seed: int, references: References) -> Session | None:
        """A live session for frames of `size` (width, height) px; None if the method is not causal."""
        return None

    def load(self) -> None:
        """Load what a task needs besides the method's modules, such as a device. Called in a thread while a job starts.

        Raises: DeviceError.
        """

    def relative_cost(self, params: AnyParams, size: tuple[int, int]) -> float:
        """CPU seconds of a frame of (width, height) px, relative to those of frames of other sizes: estimates from
        previews depend on it."""
        return float((size[0] * size[1] / 1e6) ** self.cpu_growth)

    def live_filter(self, params: AnyParams, size: tuple[int, int]) -> LiveFilter | None:
        """A filter behind the live session of any method, for frames of `size` (width, height) px; None if the method
        cannot be one."""
        return None

    def preview(self, request: PreviewRequest[AnyParams]) -> Frame | None:
        """Paint the last frame of the request; None if the platform should use the stream or the plan instead.

        Raises: BadParameter, if a document or an image is invalid, with the path of the fault.
        """
        return None

    def directions(self, request: PreviewRequest[AnyParams]) -> NDArray[np.float32] | None:
        """Stroke directions in the last frame of the request: float32 (h', w', 2), angle in [0, pi), clockwise from x,
        and strength >= 0, perhaps coarser than the frame; None if the method has none. Raises as `preview`."""
        return None

    def film_plane(self, kind: FilmPlaneKind, number: int, film: FilmTasks) -> FilmPlane | None:
        """The regions or directions that the film uses in a frame, see `FilmPlane`; None if it has none."""
        return None

    def move_marks(
        self, params: AnyParams, marks: Plane | None, before: Frame, frame: Frame, drawn: AnyArray | None
    ) -> Plane | None:
        """What is marked in a frame as the film has it there, for an overlay of kind "marks": float32 (h', w', 2), the
        mark's gray value, 0..1, times its weight, and its weight; None: nothing is marked.

        Args:
            marks: the same in the frame before; None: nothing.
            drawn: what the user has drawn on this frame, if anything.
        """
        return None

    def scaled_inputs(self, inputs: Mapping[str, Any], found: Callable[[], Mapping[str, bytes]]) -> Mapping[str, Any]:
        """Inputs for a film of smaller frames than the video's, where they refer to what depends on the size of frames.

        Args:
            inputs: as a task reads them, at the smaller size.
            found: computes the entries of `regions_artefact` of the whole video.
        """
        return inputs

    def frame_regions(self, files: Mapping[str, bytes], frame: int) -> FrameRegions | None:
        """Regions of a frame, read from the entries of `regions_artefact` by path; None if that has no such frame."""
        return None

    def frame_clusters(self, arrays: Arrays) -> Mapping[int, FrameClusters]:
        """Clusters by frame, read from arrays that a task of `clusters_step` has saved; empty if it saved others."""
        return {}

    def propagator(self, params: AnyParams, frames: Sequence[Frame], seed: int) -> KeyPropagator | None:
        """Repaints the frames around a painted key while a user edits it; None if the method has no fast
        implementation for these parameters: the platform then runs the plan for those frames.

        Args:
            frames: frames of the shot at preview size, uint8 (height, width, 3), each decoded on access.
        """
        return None

    def single_frame_params(self, params: AnyParams) -> AnyParams:
        """Parameters for painting one frame of a longer video with the plan: without the parts that use other
        frames."""
        return params

    def resources(self, step: str, context: PlanContext[AnyParams]) -> Resources | None:
        """Resources of the tasks of `step` that declare none; None: those of the farm's settings.

        Memory depends on the size of the frames and of the window, never on the length of the video.
        """
        return None
