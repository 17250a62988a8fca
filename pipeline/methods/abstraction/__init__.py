"""abstraction: online cartoon abstraction of a video stream (zhang2011online).

Flat regions that flow with the picture, a colour scheme of your choice, and bold lines. Causal: frame t uses frames
up to t only, and a live stream runs the same session as a batch job.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from pipeline.colour.scheme import learn
from pipeline.frames import Frame
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.plan import (
    plan_abstract,
    plan_reference,
    plan_scan,
    run_abstract,
    run_reference,
    run_scan,
)
from pipeline.methods.abstraction.session import AbstractionSession
from pipeline.methods.base import (
    Example,
    InputSpec,
    Method,
    Params,
    PlanContext,
    Resources,
    Step,
    Studio,
    resources_per_pixel,
)

__all__ = ["Abstraction", "AbstractionParams", "AbstractionSession"]


class Abstraction(Method):
    """The method's entry in the registry."""

    name: ClassVar[str] = "abstraction"
    title: ClassVar[str] = "Cartoon abstraction"
    summary: ClassVar[str] = "Flat regions that flow with the picture, bold lines, a colour scheme of your choice."
    paper: ClassVar[str] = "zhang2011online"
    Params: ClassVar[type[Params]] = AbstractionParams
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec(
            "video", "video", True, "Video", "The video, image or zip of images to turn into a cartoon.",
        ),
        InputSpec(
            "reference", "image-or-video", False, "Colour reference", "A picture or video whose colours to take on.",
        ),
        InputSpec(
            "histogram", "json", False, "Hue histogram",
            'A colour scheme drawn by hand: {"hue": [36 weights], "saturation_mean": 0.5, "saturation_std": 0.2, '
            '"value_mean": 0.6}. Goes before a reference.', "histogram",
        ),
        InputSpec(
            "importance", "images", False, "Importance masks",
            "White where detail matters, black where not; a zip of images named by frame number, "
            "each valid until the next.", "importance.image",
        ),
    )  # fmt: skip
    task_cpus = 2.0  # the analysis of a frame overlaps the painting of the previous one
    steps: ClassVar[tuple[Step[AbstractionParams], ...]] = (
        Step("scan", "Find the shots", plan_scan, run_scan, weight=0.05),
        Step("reference", "Learn the colours", plan_reference, run_reference, weight=0.0),
        Step("abstract", "Paint", plan_abstract, run_abstract, version=2),
    )
    artefacts: ClassVar[tuple[str, ...]] = ("svg",)
    palette_input: ClassVar[str] = "reference"
    studio: ClassVar[Studio] = Studio(painting="reference")
    cpu_s_per_megapixel: ClassVar[float] = 0.12
    cpu_growth: ClassVar[float] = 1.1
    examples: ClassVar[tuple[Example, ...]] = (
        Example("cartoon", "Cartoon", {"vividness": 1.25}),
        Example("poster", "Poster", {"vividness": 1.6, "growing_limit": 30, "smallest_region": 0.6, "line_width": 3.6}),
        Example("comic", "Comic strip", {"line_width": 3.4, "line_threshold": 0.9, "vividness": 1.4}),
        Example("watercolour", "Soft shapes, no lines", {"lines": "off", "growing_limit": 14, "boundary_smoothing": 9}),
        Example("fine", "Fine detail", {"growing_limit": 12, "smallest_region": 0.05, "line_width": 1.8}),
    )

    def resources(self, step: str, context: PlanContext[AbstractionParams]) -> Resources:
        """Measured peak memory (`python -m benchmarks.task_memory`) plus 20 %. Flow-guided lines run on the device."""
        painting = step == "abstract"
        return resources_per_pixel(
            context.video, 450 if painting else 60, device=painting and context.params.lines == "flow"
        )

    def stream(
        self, params: AbstractionParams, size: tuple[int, int], seed: int, references: Mapping[str, Iterator[Frame]]
    ) -> AbstractionSession:
        """A live session. `references` may hold "reference": the frames to learn colours from."""
        scheme = learn(references["reference"]) if "reference" in references else None
        return AbstractionSession(params, size, scheme)
