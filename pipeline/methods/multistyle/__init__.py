"""multistyle: video painting with style and stroke directions that vary over objects and time (kagaya2011video)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar

from pipeline.frames import Frame
from pipeline.methods.base import Brief, Example, InputSpec, Needs, Params, Step, working
from pipeline.methods.multistyle.design import schema
from pipeline.methods.multistyle.params import MultistyleParams
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
from pipeline.methods.multistyle.session import MultistyleSession
from pipeline.methods.multistyle.sketch import sketch
from pipeline.methods.multistyle.styles import STYLES

__all__ = ["Multistyle", "MultistyleParams", "MultistyleSession"]


class Multistyle:
    """The method as the registry knows it."""

    name: ClassVar[str] = "multistyle"
    title: ClassVar[str] = "Painting in many styles"
    summary: ClassVar[str] = "Brush strokes that follow form and motion, in six styles, or in a style for each object."
    paper: ClassVar[str] = "kagaya2011video"
    Params: ClassVar[type[Params]] = MultistyleParams
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec("video", "video", True, "Video", "The video, GIF, image or zip of numbered images to paint."),
        InputSpec(
            "design", "json", False, "Design",
            "Regions, their styles and stroke directions at keyframes: see docs/multistyle.md.",
        ),
        InputSpec(
            "masks", "images", False, "Label maps",
            "Where the design's regions are: images named by frame number, each pixel's value a region's label.",
        ),
    )  # fmt: skip
    steps: ClassVar[tuple[Step, ...]] = (
        Step("scan", "Find the shots", plan_scan, run_scan, weight=0.03),
        Step("regions", "Find the regions", plan_regions, run_regions, weight=0.0),
        Step("maps", "Map the regions", plan_maps, run_maps, weight=0.0),
        Step("paint", "Paint", plan_paint, run_paint),
    )
    artefacts: ClassVar[tuple[str, ...]] = ("regions",)
    examples: ClassVar[tuple[Example, ...]] = (
        *(Example(name, named.title, {"style": name}) for name, named in STYLES.items() if name != "van-gogh"),
        Example("rack-focus", "Rack focus", {"style": "pointillism", "effect": "rack-focus"}),
        Example("emphasis", "Emphasis", {"style": "impressionism", "effect": "emphasis"}),
        Example("calm-to-stress", "Calm to stress", {"style": "van-gogh", "effect": "calm-to-stress"}),
    )

    sketch = staticmethod(sketch)
    input_schemas: ClassVar[Mapping[str, Callable[[], dict[str, Any]]]] = {"design": schema}

    @staticmethod
    def needs(step: str, brief: Brief) -> Needs:
        """Peaks by `python -m benchmarks.needs`, and a fifth more."""
        return working(brief.video, 60 if step == "scan" else 300)

    def stream(
        self, params: Any, size: tuple[int, int], seed: int, references: Mapping[str, Iterator[Frame]]
    ) -> MultistyleSession:
        """A live session, without a design."""
        return MultistyleSession(params, size, seed)
