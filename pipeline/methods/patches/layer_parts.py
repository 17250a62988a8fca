"""Parts of a project's layer from which inputs of the method are made, and what the studio offers for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

from pydantic import Field, JsonValue, model_validator

from pipeline.methods.parts import MOST_PICTURES, Drawing, Drawings, FrameRange, Json, LayerPart
from pipeline.methods.patches.artefacts import LABELS, UNCERTAINTY
from pipeline.methods.studio import Mark, Overlay, Section, Studio

SCRIBBLES = "scribbles"


class LabelMap(Drawing):
    """A corrected label map: gray value = label."""

    solve: FrameRange | None = Field(
        default=None, description="Frames [first, end) that are clustered again from it; null: the shot."
    )

    @model_validator(mode="after")
    def _own_frame_is_solved(self) -> Self:
        if self.solve is not None and not self.solve[0] <= self.frame < self.solve[1]:
            raise ValueError("solve must contain the map's own frame")
        return self


def solved_intervals(maps: Sequence[LabelMap]) -> JsonValue:
    """Frames to cluster again before and after each corrected label map, for maps with an interval."""
    return [
        {"frame": one.frame, "before": one.frame - one.solve[0], "after": one.solve[1] - 1 - one.frame}
        for one in sorted(maps, key=lambda one: one.frame) if one.solve is not None
    ]  # fmt: skip


PARTS = (
    LayerPart(SCRIBBLES, "Scribbles on the foreground and the background", Drawings, {"scribbles": ""}),
    LayerPart(
        "labels", "Corrected label maps", Annotated[tuple[LabelMap, ...], Field(max_length=MOST_PICTURES)],
        {"labels": ""},
    ),
    LayerPart("label_styles", "Styles of patches", Json, {"label_styles": ""}),
)  # fmt: skip

STUDIO = Studio(
    sections=(
        Section(
            "marks", SCRIBBLES, "Foreground",
            "Scribble over the foreground and over the background: the rest of the shot follows.",
            marks=(Mark("Foreground", "#ffffff"), Mark("Background", "#000000")),
            overlay=Overlay("mask", "Show the foreground", "spread", (SCRIBBLES,)),
        ),
        Section(
            "clusters", "labels", "Clusters",
            overlay=Overlay("labels", "Show the clusters", "clusters", (SCRIBBLES,), LABELS, UNCERTAINTY),
        ),
    ),
    tools=("brush", "eraser", "object", "label"),
    cuts="cut_sensitivity",
)  # fmt: skip
