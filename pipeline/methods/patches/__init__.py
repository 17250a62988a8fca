"""patches: painterly video with painting patches, which are painted once and warped to each frame (zhang2011patches).

Steps:

scan      counts frames, detects cuts, validates the user's inputs
cluster   computes optical flow between the frames of a window, and clusters pixels of similar motion by random walks;
          labels are consistent over a shot
correct   clusters frames again from label maps that the user has corrected
register  computes the warp of every cluster from frame to frame, with little distortion
patch     places each cluster's frames in one panorama, relaxes them, and paints the panorama once
paint     warps patches back to every frame, over a painting of the pixels that no patch covers
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from pydantic import JsonValue

from pipeline.errors import BadParameter
from pipeline.methods.base import (
    Alternatives,
    AnyParams,
    Arrays,
    Example,
    Fits,
    FrameClusters,
    InputCheck,
    InputFacts,
    InputSpec,
    LayerPart,
    MadePass,
    Method,
    Params,
    PlanContext,
    Resources,
    Step,
    Studio,
    TaskResult,
    checked,
    resources_per_pixel,
)
from pipeline.methods.patches.artefacts import ARTEFACTS
from pipeline.methods.patches.clustering import plan_cluster, run_cluster, stored_clusters
from pipeline.methods.patches.compositing import plan_paint, run_paint
from pipeline.methods.patches.correction import plan_correct, run_correct
from pipeline.methods.patches.expected import expected_results
from pipeline.methods.patches.frame_passes import MADE
from pipeline.methods.patches.layer_parts import PARTS, STUDIO, solved_intervals
from pipeline.methods.patches.params import CLUSTERED, PatchesParams
from pipeline.methods.patches.patch_construction import plan_patch, run_patch
from pipeline.methods.patches.patch_styles import label_styles
from pipeline.methods.patches.registration import plan_register, run_register
from pipeline.methods.patches.scan import label_intervals, plan_scan, run_scan
from pipeline.methods.patches.window_flow import load_kernels

__all__ = ["Patches", "PatchesParams"]


class Patches(Method):
    """Registry entry of the method. It has no live form, since a patch is the mean of past and future frames."""

    name: ClassVar[str] = "patches"
    title: ClassVar[str] = "Painting patches"
    summary: ClassVar[str] = (
        "Paints each moving object once and moves the painting with it, so that strokes stay on the object."
    )
    paper: ClassVar[str] = "zhang2011patches"
    Params: ClassVar[type[Params]] = PatchesParams
    passes = ("motion",)
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec("video", "video", True, "Video", "The video, image (still or animated) or zip of images to paint."),
        InputSpec(
            "masks", "images", False, "Foreground masks",
            "White = foreground, black = background, gray or transparent = unknown, so scribbles suffice. A zip of "
            "images named by frame number; each is propagated from its frame on.", "scribbles.image",
            applies_when=CLUSTERED, fits=Fits(aspect="video"),
        ),
        InputSpec(
            "labels", "images", False, "Corrected label maps",
            "Gray value = label, 0 = unclustered, 1 = background, as in the artefact `labels`. A zip of images named "
            "by frame number; the shot is clustered again from them, or the frames that label_intervals names.",
            "labels.image", applies_when=CLUSTERED, fits=Fits(aspect="video"),
        ),
        InputSpec(
            "label_intervals", "json", False, "Frames that a corrected label map changes",
            'How many frames before and after a corrected map are clustered again: [{"frame": 40, "before": 10, '
            '"after": 12}]. A map that it does not name changes its whole shot.', "labels",
            needs="labels", applies_when=CLUSTERED,
        ),
        InputSpec(
            "styles", "json", False, "Styles of patches",
            'Styles of single patches, by label: {"background": "wash", "3": "circles"}, or parameters: '
            '{"3": {"style": "circles", "stroke_size": 0.5}}.', "label_styles",
            applies_when=CLUSTERED,
        ),
    )  # fmt: skip
    steps: ClassVar[tuple[Step[PatchesParams], ...]] = (
        Step("scan", "Find the shots", plan_scan, run_scan, weight=0.005, version=2),
        Step("cluster", "Cluster by motion", plan_cluster, run_cluster, weight=1.0, version=2),
        Step("correct", "Apply corrections", plan_correct, run_correct, weight=0.0, version=2),
        Step("register", "Register frames", plan_register, run_register, weight=0.26),
        Step("patch", "Paint patches", plan_patch, run_patch, weight=0.4, version=2),
        Step("paint", "Composite frames", plan_paint, run_paint, version=2),
    )
    parts: ClassVar[tuple[LayerPart, ...]] = PARTS
    part_documents: ClassVar[Mapping[str, Callable[[Any], JsonValue]]] = {"label_intervals": solved_intervals}
    artefacts: ClassVar[tuple[str, ...]] = ARTEFACTS
    makes_passes: ClassVar[tuple[MadePass, ...]] = MADE
    passes_when: ClassVar[Mapping[str, Alternatives]] = dict.fromkeys((made.name for made in MADE), CLUSTERED)
    studio: ClassVar[Studio] = STUDIO
    input_checks: ClassVar[Mapping[str, InputCheck]] = {
        "styles": checked(label_styles), "label_intervals": checked(label_intervals),
    }  # fmt: skip
    artefacts_when: ClassVar[Mapping[str, Alternatives]] = dict.fromkeys(ARTEFACTS, CLUSTERED)
    clusters_step: ClassVar[str] = "cluster"
    task_threads: ClassVar[Mapping[str, float]] = {"cluster/flow": 3.4, "cluster/run": 1.4, "paint/run": 1.7}
    clusters_params: ClassVar[Mapping[str, JsonValue]] = {"temporal": "on"}
    reads_again: ClassVar[bool] = True
    task_params: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "cluster/flow": ("flow", "window", "temporal", "colour_scale")
    }
    depth_bits: ClassVar[int] = 16
    cpu_s_per_megapixel: ClassVar[float] = 1.2
    cpu_growth: ClassVar[float] = 0.5
    examples: ClassVar[tuple[Example, ...]] = (
        Example("circles", "Round dabs of colour", {"style": "circles"}),
        Example("threes", "On threes: ten paintings per second", {"frames_per_painting": 3}),
        Example("broad", "Broad strokes", {"stroke_size": 1.6, "threshold": 40}),
        Example(
            "small",
            "Complex motion in many small patches of fine strokes",
            {"smallest_cluster": 0.3, "table_area": "mean"},
        ),
        Example("pan", "The same strokes over a long pan", {"longest_travel": 10, "longest_patch": 480}),
        Example("wash", "A washed background", {"background_style": "wash"}),
    )

    def input_faults(self, params: AnyParams, facts: Mapping[str, InputFacts]) -> list[BadParameter]:
        """Intervals of frames without a corrected label map."""
        labels, intervals = facts.get("labels"), facts.get("label_intervals")
        if labels is None or labels.numbers is None or intervals is None or not isinstance(intervals.document, list):
            return []
        rows = [row for row in intervals.document if isinstance(row, dict)]
        return [
            BadParameter(
                f"Frame {row['frame']} has an interval and no label map.", field=f"inputs.label_intervals[{place}]",
                value=row["frame"], remedy="Give its label map, or leave the row out.",
            )
            for place, row in enumerate(rows) if row.get("frame", -1) not in labels.numbers
        ]  # fmt: skip

    def expected_results(self, step: str, context: PlanContext[PatchesParams]) -> Mapping[str, TaskResult]:
        """A background and one moving cluster, and no energies."""
        return expected_results(step, context)

    def load(self) -> None:
        """Load the kernels of the first tasks."""
        load_kernels()

    def single_frame_params(self, params: PatchesParams) -> PatchesParams:
        """Parameters of a single frame: without temporal coherence."""
        return params.model_copy(update={"temporal": "off"})

    def frame_clusters(self, arrays: Arrays) -> Mapping[int, FrameClusters]:
        """Clusters of the frames of a task "run-<run>", at the working size."""
        return stored_clusters(arrays)

    def resources(self, step: str, context: PlanContext[PatchesParams]) -> Resources:
        """Peak memory of a task: measured with `python -m benchmarks.task_memory`, plus 20 %; paintings of 16 bit take
        60 bytes a pixel more."""
        each = 570 if context.deep else 500
        return resources_per_pixel(context.video, 60 if step == "scan" else each)
