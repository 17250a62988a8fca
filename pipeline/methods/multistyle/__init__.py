"""multistyle: video painting with style and stroke directions that vary over objects and time (kagaya2011video)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from pipeline.frames import Frame
from pipeline.methods.base import (
    Example,
    Exemplar,
    FrameRegions,
    InputCheck,
    InputSpec,
    JsonSchema,
    LayerPart,
    MadePass,
    MakesOpacity,
    Method,
    Params,
    PlanContext,
    PreviewRequest,
    References,
    Resources,
    Step,
    Studio,
    TaskResult,
    When,
    resources_per_pixel,
)
from pipeline.methods.multistyle.design import check, schema
from pipeline.methods.multistyle.effects import documents
from pipeline.methods.multistyle.film_planes import film_plane
from pipeline.methods.multistyle.layer_parts import PARTS, STUDIO, design_document
from pipeline.methods.multistyle.orientation_picture import DIRECTIONS
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.passes import MADE
from pipeline.methods.multistyle.plan import (
    plan_maps,
    plan_paint,
    plan_regions,
    plan_scan,
    run_maps,
    run_paint,
    run_regions,
    run_scan,
)
from pipeline.methods.multistyle.preview import frame_regions, preview_directions, preview_frame
from pipeline.methods.multistyle.region_maps import ARTEFACT as REGIONS
from pipeline.methods.multistyle.region_maps import expected_results
from pipeline.methods.multistyle.scaled_design import names_segments, with_label_maps
from pipeline.methods.multistyle.session import MultistyleSession
from pipeline.methods.multistyle.styles import STYLES
from pipeline.methods.previews import FilmPlane, FilmPlaneKind, FilmTasks

__all__ = ["Multistyle", "MultistyleParams", "MultistyleSession"]


class Multistyle(Method):
    """The method's entry in the registry."""

    name: ClassVar[str] = "multistyle"
    title: ClassVar[str] = "Painting in many styles"
    summary: ClassVar[str] = "Brush strokes that follow form and motion, in six styles, or in a style for each object."
    paper: ClassVar[str] = "kagaya2011video"
    Params: ClassVar[type[Params]] = MultistyleParams
    passes = ("motion",)
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec("video", "video", True, "Video", "The video, image (still or animated) or zip of images to paint."),
        InputSpec(
            "design", "json", False, "Design",
            "Regions, their styles and stroke directions at keyframes; format in docs/multistyle.md.",
            "design", applies_when=(When(way="film"),),
        ),
        InputSpec(
            "masks", "images", False, "Label maps",
            "Locations of the design's regions: images named by frame number, whose pixel values are labels.",
            "region_maps.image", applies_when=(When(inputs=("design",)),),
        ),
    )  # fmt: skip
    steps: ClassVar[tuple[Step[MultistyleParams], ...]] = (
        Step("scan", "Find the shots", plan_scan, run_scan, weight=0.01, version=2),
        Step("regions", "Find the regions", plan_regions, run_regions, weight=0.0),
        Step("maps", "Map the regions", plan_maps, run_maps, weight=0.0),
        Step("paint", "Paint", plan_paint, run_paint, version=5),
    )
    parts: ClassVar[tuple[LayerPart, ...]] = PARTS
    part_documents: ClassVar[Mapping[str, Callable[[Any], JsonValue]]] = {"design": design_document}
    artefacts: ClassVar[tuple[str, ...]] = (REGIONS, DIRECTIONS)
    makes_passes: ClassVar[tuple[MadePass, ...]] = MADE
    studio: ClassVar[Studio] = STUDIO
    task_threads: ClassVar[Mapping[str, float]] = {"paint/analyze": 4.0}
    task_params: ClassVar[Mapping[str, tuple[str, ...]]] = {"paint/flow": ("flow", "stillness")}
    regions_artefact: ClassVar[str] = REGIONS
    depth_bits: ClassVar[int] = 16
    cpu_s_per_megapixel: ClassVar[float] = 0.5
    cpu_growth: ClassVar[float] = 0.7
    examples: ClassVar[tuple[Example, ...]] = (
        *(Example(name, named.title, {"style": name}) for name, named in STYLES.items() if name != "van-gogh"),
        Example("rack-focus", "Rack focus", {"style": "pointillism", "effect": "rack-focus"}),
        Example("emphasis", "Emphasis", {"style": "impressionism", "effect": "emphasis"}),
        Example("calm-to-stress", "Calm to stress", {"style": "van-gogh", "effect": "calm-to-stress"}),
    )

    exemplars: ClassVar[tuple[Exemplar, ...]] = (
        Exemplar("harbour-swirls", "Swirling strokes", "harbour", 20, {"style": "van-gogh"}),
        Exemplar("portrait-dabs", "Broken dabs", "portrait", 20, {"style": "impressionism"}),
        Exemplar("harbour-dots", "Dots", "harbour", 44, {"style": "pointillism"}),
        Exemplar("portrait-bold", "Bold colour", "portrait", 44, {"style": "expressionism"}),
        Exemplar("harbour-wash", "Washes", "harbour", 60, {"style": "watercolor"}),
    )
    input_schemas: ClassVar[Mapping[str, Callable[[], JsonSchema]]] = {"design": schema}
    input_examples: ClassVar[Mapping[str, Callable[[int], Mapping[str, JsonSchema]]]] = {"design": documents}
    input_checks: ClassVar[Mapping[str, InputCheck]] = {"design": check}

    def paints_opacity(self, params: MultistyleParams) -> MakesOpacity:
        """The coverage of the strokes; explicit strokes are painted onto a ground."""
        return "no" if params.renderer == "explicit" else "may"

    def single_frame_params(self, params: MultistyleParams) -> MultistyleParams:
        """A frame on its own is painted without what other frames contribute."""
        alone: MultistyleParams = params.model_copy(update={"temporal": "off"})
        return alone

    def resources(self, step: str, context: PlanContext[MultistyleParams]) -> Resources:
        """Peak memory measured by `python -m benchmarks.task_memory`, plus 20 %."""
        return resources_per_pixel(context.video, 60 if step == "scan" else 300)

    def expected_results(
        self, step: str, context: PlanContext[MultistyleParams]
    ) -> Mapping[str, TaskResult] | None:  # fmt: skip
        """Region maps without ellipses; the tubes of a video cannot be guessed."""
        return expected_results(step, context)

    def preview(self, request: PreviewRequest[MultistyleParams]) -> Frame:
        return preview_frame(request)

    def scaled_inputs(self, inputs: Mapping[str, Any], found: Callable[[], Mapping[str, bytes]]) -> Mapping[str, Any]:
        """Label maps in place of tubes and objects, whose numbers are those of the video's frames."""
        given = inputs.get("design") or {}
        regions = (given.get("regions") or {}).values()
        if any(region.get("label") is not None for region in regions) or not any(map(names_segments, regions)):
            return inputs
        design, maps = with_label_maps(given, found())
        return {**inputs, "design": design, "masks": maps}

    def frame_regions(self, files: Mapping[str, bytes], frame: int) -> FrameRegions | None:
        """Tubes of a frame, and the object of each."""
        return frame_regions(files, frame)

    def directions(self, request: PreviewRequest[MultistyleParams]) -> NDArray[np.float32]:
        """Stroke directions of the last frame, with the design."""
        return preview_directions(request)

    def film_plane(self, kind: FilmPlaneKind, number: int, film: FilmTasks) -> FilmPlane | None:
        """Regions and stroke directions of a frame."""
        return film_plane(kind, number, film)

    def stream(
        self, params: MultistyleParams, size: tuple[int, int], seed: int, references: References
    ) -> MultistyleSession:
        """A live session, without a design."""
        return MultistyleSession(params, size, seed)
