"""abstraction: online cartoon abstraction of a video stream (zhang2011online).

Flat regions that flow with the picture, a colour scheme of your choice, and bold lines. Causal: frame t uses frames
up to t only, and a live stream runs the same session as a batch job.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pipeline.arrays import AnyArray
from pipeline.frames import Frame, Plane
from pipeline.methods.abstraction.moved_marks import move_marks
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.pass_maker import MADE
from pipeline.methods.abstraction.plan import (
    plan_abstract,
    plan_reference,
    plan_scan,
    run_abstract,
    run_reference,
    run_scan,
)
from pipeline.methods.abstraction.session import AbstractionSession, scheme_of
from pipeline.methods.abstraction.sizes import sizes_of
from pipeline.methods.base import (
    Alternatives,
    Example,
    Exemplar,
    InputSpec,
    LayerPart,
    MadePass,
    Method,
    Params,
    PlanContext,
    References,
    Resources,
    Step,
    Studio,
    When,
    resources_per_pixel,
)
from pipeline.methods.parts import Drawings, Json
from pipeline.methods.studio import Mark, Overlay, Section

__all__ = ["Abstraction", "AbstractionParams", "AbstractionSession"]


DRAWING_COST = 0.27
"""Cost of a pixel that is drawn and not analysed, as a share of one that is."""


class Abstraction(Method):
    """The method's entry in the registry."""

    name: ClassVar[str] = "abstraction"
    title: ClassVar[str] = "Cartoon abstraction"
    summary: ClassVar[str] = "Flat regions that flow with the picture, bold lines, a colour scheme of your choice."
    paper: ClassVar[str] = "zhang2011online"
    Params: ClassVar[type[Params]] = AbstractionParams
    passes = ("motion",)
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec(
            "video", "video", True, "Video", "The video, image or zip of images to turn into a cartoon.",
        ),
        InputSpec(
            "reference", "image-or-video", False, "Colour reference", "A picture or video whose colours to take on.",
            applies_when=(When(without=("histogram",)),),
        ),
        InputSpec(
            "histogram", "json", False, "Hue histogram",
            'A colour scheme drawn by hand: {"hue": [36 weights], "saturation_mean": 0.5, "saturation_std": 0.2, '
            '"value_mean": 0.6}. Goes before a reference.', "histogram",
        ),
        InputSpec(
            "importance", "images", False, "Importance masks",
            "White where detail matters, black where not; a zip of images named by frame number, "
            "each valid until the next. With transparent pixels: a drawing, which moves with the picture.",
            "importance.image",
        ),
    )  # fmt: skip
    task_cpus = 2.0  # the analysis of a frame overlaps the painting of the previous one
    task_threads: ClassVar[Mapping[str, float]] = {"abstract/run": 8.0}
    steps: ClassVar[tuple[Step[AbstractionParams], ...]] = (
        Step("scan", "Find the shots", plan_scan, run_scan, weight=0.05, version=2),
        Step("reference", "Learn the colours", plan_reference, run_reference, weight=0.0),
        Step("abstract", "Paint", plan_abstract, run_abstract, version=5),
    )
    parts: ClassVar[tuple[LayerPart, ...]] = (
        LayerPart("importance", "Importance masks", Drawings, former={"importance": ""}),
        LayerPart("histogram", "Hue histogram", Json, former={"histogram": ""}),
    )
    artefacts: ClassVar[tuple[str, ...]] = ("svg",)
    makes_passes: ClassVar[tuple[MadePass, ...]] = MADE
    passes_when: ClassVar[Mapping[str, Alternatives]] = {"lines": (When({"lines": ("dog",)}),)}
    palette_input: ClassVar[str] = "reference"
    studio: ClassVar[Studio] = Studio(
        sections=(
            Section(
                "marks", "importance", "Detail",
                "Paint over what needs finer regions and more lines, or fewer. It moves with the picture.",
                marks=(Mark("Important", "#ffffff"), Mark("Unimportant", "#000000")),
                overlay=Overlay("marks", "Show the marks where they move", "spread", ("importance",)),
            ),
            Section(
                "histogram", "histogram", "Colour scheme",
                "Draw the hues of the painting: those of the video move to peaks in their “Hue neighbourhood”.",
            ),
        ),
        tools=("brush", "eraser", "object"),
        painting="reference",
        cuts="cut_sensitivity",
    )  # fmt: skip
    cpu_s_per_megapixel: ClassVar[float] = 0.12
    cpu_growth: ClassVar[float] = 1.1
    examples: ClassVar[tuple[Example, ...]] = (
        Example("cartoon", "Cartoon", {"vividness": 1.25}),
        Example("poster", "Poster", {"vividness": 1.6, "growing_limit": 30, "smallest_region": 0.6, "line_width": 3.6}),
        Example("comic", "Comic strip", {"line_width": 3.4, "line_threshold": 0.9, "vividness": 1.4}),
        Example("watercolour", "Soft shapes, no lines", {"lines": "off", "growing_limit": 14, "boundary_smoothing": 9}),
        Example("fine", "Fine detail", {"growing_limit": 12, "smallest_region": 0.05, "line_width": 1.8}),
        Example(
            "printed",
            "As printed in the paper",
            {"algorithm": "printed", "flow": "tvl1", "edge_threshold": 15, "line_threshold": 0, "cut_sensitivity": 0},
        ),
    )

    exemplars: ClassVar[tuple[Exemplar, ...]] = (Exemplar("harbour-print", "Colour print", "harbour", 32, {}),)

    def resources(self, step: str, context: PlanContext[AbstractionParams]) -> Resources:
        """Measured peak memory (`python -m benchmarks.task_memory`) plus 20 %."""
        return resources_per_pixel(context.video, 450 if step == "abstract" else 60)

    def relative_cost(self, params: AbstractionParams, size: tuple[int, int]) -> float:
        """Analysis grows with the analysed frame, the rest with the frame. Measured: 0.047 CPU seconds at 960x540, and
        0.038 at 1280x720, of which a quarter of the pixels are analysed."""
        work = sizes_of(params.effective(), size).work
        return super().relative_cost(params, work) + DRAWING_COST * (size[0] * size[1] - work[0] * work[1]) / 1e6

    def stream(
        self, params: AbstractionParams, size: tuple[int, int], seed: int, references: References
    ) -> AbstractionSession:
        """A live session. `references` may hold "reference", the frames to learn colours from, or "histogram"."""
        return AbstractionSession(params, size, scheme_of(references))

    def move_marks(
        self, params: AbstractionParams, marks: Plane | None, before: Frame, frame: Frame, drawn: AnyArray | None
    ) -> Plane | None:
        return move_marks(params.effective(), marks, before, frame, drawn)
