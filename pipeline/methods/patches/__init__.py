"""patches: painterly video with painting patches that are painted once and carried (zhang2011patches).

scan      how many frames there are, and where shots begin
cluster   motion between all frames of a window, and how far it can be trusted; what moves together, by random walks;
          labels keep their meaning over the whole shot
correct   frames between label maps that the user has corrected, again
register  the warp of every cluster from frame to frame, with little distortion
patch     each cluster's frames in one panorama, relaxed, and painted once
paint     patches carried back into every frame, over a painting of what belongs to none
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from pipeline.frames import Frame
from pipeline.methods.base import (
    Example,
    InputSpec,
    Method,
    Params,
    PlanContext,
    Resources,
    Session,
    Step,
    resources_per_pixel,
)
from pipeline.methods.patches.artefacts import ARTEFACTS
from pipeline.methods.patches.build import plan_patch, run_patch
from pipeline.methods.patches.clusters import plan_cluster, run_cluster
from pipeline.methods.patches.composite import plan_paint, run_paint
from pipeline.methods.patches.correct import plan_correct, run_correct
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.register import plan_register, run_register
from pipeline.methods.patches.scan import plan_scan, run_scan

__all__ = ["Patches", "PatchesParams"]


class Patches(Method):
    """The method as the registry knows it."""

    name: ClassVar[str] = "patches"
    title: ClassVar[str] = "Painting patches"
    summary: ClassVar[str] = "Each moving thing is painted once, by hand as it were, and carried along."
    paper: ClassVar[str] = "zhang2011patches"
    Params: ClassVar[type[Params]] = PatchesParams
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec("video", "video", True, "Video", "The video, GIF, image or zip of numbered images to paint."),
        InputSpec(
            "masks", "images", False, "Foreground masks",
            "White = foreground, black = background, gray or transparent = not said (so scribbles will do): a zip of "
            "images named by frame number. Each is carried on from its frame.", "scribbles.image",
        ),
        InputSpec(
            "labels", "images", False, "Corrected label maps",
            "Gray value = label, 0 = unclustered, 1 = background, as in the artefact `labels`: a zip of images named "
            "by frame number. Frames between two of them are clustered again.", "labels.image",
        ),
        InputSpec(
            "styles", "json", False, "Styles of patches",
            'A style for single patches, by label: {"background": "wash", "3": "circles"}.', "label_styles",
        ),
    )  # fmt: skip
    steps: ClassVar[tuple[Step[Any], ...]] = (
        Step("scan", "Find the shots", plan_scan, run_scan, weight=0.02),
        Step("cluster", "See what moves together", plan_cluster, run_cluster, weight=0.45),
        Step("correct", "Follow your corrections", plan_correct, run_correct, weight=0.0),
        Step("register", "Lay frames over each other", plan_register, run_register, weight=0.3),
        Step("patch", "Paint each patch", plan_patch, run_patch, weight=0.2),
        Step("paint", "Put frames together", plan_paint, run_paint),
    )
    artefacts: ClassVar[tuple[str, ...]] = ARTEFACTS
    examples: ClassVar[tuple[Example, ...]] = (
        Example("circles", "Dabs of colour, as in the paper's figure 6", {"style": "circles"}),
        Example("threes", "On threes: ten paintings a second", {"hold": 3}),
        Example("broad", "Broad strokes", {"stroke_size": 1.6, "threshold": 40}),
        Example("wash", "A washed background", {"background_style": "wash"}),
    )

    def single_frame_params(self, params: Any) -> PatchesParams:
        """A frame on its own is painted without what other frames contribute."""
        alone: PatchesParams = params.model_copy(update={"temporal": "off"})
        return alone

    def resources(self, step: str, context: PlanContext[PatchesParams]) -> Resources:
        """Peaks by `python -m benchmarks.task_memory`, and a fifth more."""
        return resources_per_pixel(context.video, 60 if step == "scan" else 500)

    def stream(
        self, params: Any, size: tuple[int, int], seed: int, references: Mapping[str, Iterator[Frame]]
    ) -> Session | None:
        """None: a patch is the mean of frames that are still to come."""
        return None
