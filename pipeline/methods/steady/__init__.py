"""steady: flicker removal for videos that any other tool stylised frame by frame (bonneel2015blind)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pipeline.methods.base import (
    AnyParams,
    Example,
    Fits,
    InputSpec,
    MadePass,
    Method,
    Params,
    PlanContext,
    Resources,
    Step,
    Studio,
    resources_per_pixel,
)
from pipeline.methods.steady.filter import SteadyFilter
from pipeline.methods.steady.params import SteadyParams
from pipeline.methods.steady.plan import plan_scan, plan_steady, run_scan, run_steady
from pipeline.passes.made import FLOW

__all__ = ["Steady", "SteadyFilter", "SteadyParams"]


class Steady(Method):
    """The method's entry in the registry."""

    name: ClassVar[str] = "steady"
    title: ClassVar[str] = "Steady frames"
    summary: ClassVar[str] = "Removes the flicker of a video that any other tool stylised frame by frame."
    paper: ClassVar[str] = "bonneel2015blind"
    Params: ClassVar[type[Params]] = SteadyParams
    passes = ("motion",)
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec("video", "video", True, "Video", "The video as it was before it was stylised."),
        InputSpec(
            "styled", "video", True, "Styled video",
            "The same video, stylised by any tool: a video or a zip of numbered images, with the same frame size and "
            "the same number of frames.", fits=Fits(size="video", frames="video", exactly=True),
        ),
        InputSpec(
            "mask", "images", False, "Mask",
            "White where the result is to be steady, black where it is to stay as styled; a zip of images named by "
            "frame number, each valid until the next.", preview=False,
        ),
    )  # fmt: skip
    steps: ClassVar[tuple[Step[AnyParams], ...]] = (
        Step("scan", "Compare the videos", plan_scan, run_scan, weight=0.2, version=2),
        Step("steady", "Remove the flicker", plan_steady, run_steady, version=2),
    )
    makes_passes: ClassVar[tuple[MadePass, ...]] = (
        FLOW,
        MadePass(
            "occlusion",
            "1 where a pixel has no known past, because it was hidden, outside or moves uncertainly; 0 where it has.",
            ("Y",),
        ),
    )
    depth_bits: ClassVar[int] = 32
    cpu_s_per_megapixel: ClassVar[float] = 0.21
    task_threads: ClassVar[Mapping[str, float]] = {"steady/run": 7.0}
    task_cpus = 2.0  # the motion of a frame is estimated while the frame before it is steadied
    studio: ClassVar[Studio] = Studio(cuts="cut_sensitivity")
    examples: ClassVar[tuple[Example, ...]] = (
        Example("steadiest", "Steadiest", {"look_ahead": 4}),
        Example("gentle", "Gentle", {"strength": 6}),
        Example("firm", "Firm", {"strength": 80, "trail_suppression": 15}),
    )

    def live_filter(self, params: SteadyParams, size: tuple[int, int]) -> SteadyFilter:
        """The filter of a live session, whose painted frames replace the input `styled`."""
        return SteadyFilter(params, size)

    def resources(self, step: str, context: PlanContext[SteadyParams]) -> Resources:
        """Peaks (`python -m benchmarks.task_memory`), decoders included, plus 20 %: 590 bytes a pixel with the threads
        of four processors and more, at 1920x1080 (390 on two, at 3840x2160), and 120 more of frames in floating point.
        A frame of the second pass takes 18 bytes a pixel (27), and 24 in it."""
        each, kept = (855, 27) if context.deep else (710, 18)
        ahead = 3 * kept * context.params.look_ahead + 24 * bool(context.params.look_ahead)
        return resources_per_pixel(context.video, 60 if step == "scan" else each + ahead)
