"""Typical results of the steps, from which the later steps of a job are planned that has not run."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.methods.base import PlanContext, TaskResult
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_styles import BACKGROUND
from pipeline.methods.patches.patch_track import LabelRow
from pipeline.methods.patches.scan import WorkingGrid, run_key, runs

AREAS = {BACKGROUND: 0.6, BACKGROUND + 1: 0.15}
"""Label -> share of the frame. The rest is unclustered."""


def expected_results(step: str, context: PlanContext[PatchesParams]) -> Mapping[str, TaskResult]:
    """Results of the tasks of a step by key, as far as plans use them: a background and one moving cluster in every
    frame, and no energies."""
    if context.params.temporal != "on" or step not in ("cluster", "register"):
        return {}
    if step == "register":
        return {run_key(start): {"energies": {}} for start, _, _, _ in runs(context)}
    width, height = WorkingGrid.of((context.video.width, context.video.height)).size
    areas = {str(label): int(share * width * height) for label, share in AREAS.items()}
    return {
        run_key(start): {"labels": {label: _row(start, stop, area) for label, area in areas.items()}}
        for start, stop, _, _ in runs(context)
    }


def _row(start: int, stop: int, area: int) -> LabelRow:
    return [start, stop - 1, area * (stop - start), start, area, 0.0]
