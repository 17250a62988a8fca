"""Parts of a project's layer from which inputs of the method are made, and what the studio offers for them."""

from __future__ import annotations

from pydantic import Field, JsonValue

from pipeline.methods.multistyle.styles import STYLES
from pipeline.methods.parts import Drawings, Json, LayerPart, Member
from pipeline.methods.studio import Choice, Section, Slider, Studio


class DesignPart(Member):
    """A design document without its version, see docs/multistyle.md. `design.check` checks what is in it."""

    regions: Json = Field(default={})
    styles: Json = Field(default={})
    keys: tuple[JsonValue, ...] = ()
    directions: tuple[JsonValue, ...] = ()


def design_document(part: DesignPart) -> JsonValue:
    """The design document; None if the part is empty."""
    members: Json = {
        "regions": part.regions, "styles": part.styles, "keys": list(part.keys), "directions": list(part.directions),
    }  # fmt: skip
    return {"version": 1, **members} if any(members.values()) else None


PARTS = (
    LayerPart(
        "design", "Regions, their styles and directions", DesignPart,
        {"regions": "regions", "styles": "styles", "style_keys": "keys", "directions": "directions"},
    ),
    LayerPart("region_maps", "Label maps of regions", Drawings, {"region_maps": ""}),
)  # fmt: skip

STUDIO = Studio(
    sections=(
        Section(
            "regions", "design", "Regions",
            sliders=(
                Slider("size", "Stroke width", 2, 150, 1),
                Slider("length", "Stroke length", 0, 600, 5),
                Slider("opacity", "Opacity", 0.02, 1, 0.01),
                Slider("hue", "Hue", -180, 180, 1),
                Slider("saturation", "Saturation", -1, 1, 0.05),
            ),
            styles=tuple(Choice(name, style.title) for name, style in STYLES.items()),
            style_param="style",
            replaces=("effect",),
        ),
    ),
    tools=("region", "lasso", "direction"),
    cuts="cut_sensitivity",
)  # fmt: skip
