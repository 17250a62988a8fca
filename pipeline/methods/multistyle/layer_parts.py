"""Parts of a project's layer from which inputs of the method are made, and what the studio offers for them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, JsonValue

from pipeline.methods.multistyle.styles import STYLES, Style
from pipeline.methods.parts import Drawings, Json, LayerPart, Member
from pipeline.methods.studio import Choice, Section, Slider, Studio


class DesignPart(Member):
    """A design document without its version, see docs/multistyle.md. `design.check` checks what is in it."""

    regions: Json = Field(default={})
    styles: Json = Field(default={})
    keys: tuple[JsonValue, ...] = ()
    directions: tuple[JsonValue, ...] = ()
    corrections: tuple[JsonValue, ...] = ()


def design_document(part: DesignPart) -> JsonValue:
    """The design document; None if the part is empty. Without corrections it has the bytes of earlier versions, so that
    their films are still found."""
    members: Json = {
        "regions": part.regions, "styles": part.styles, "keys": list(part.keys), "directions": list(part.directions),
    }  # fmt: skip
    if part.corrections:
        members["corrections"] = list(part.corrections)
    return {"version": 1, **members} if any(members.values()) else None


PARTS = (
    LayerPart(
        "design", "Regions, their styles and directions", DesignPart,
        {"regions": "regions", "styles": "styles", "style_keys": "keys", "directions": "directions"},
    ),
    LayerPart("region_maps", "Label maps of regions", Drawings, {"region_maps": ""}),
)  # fmt: skip

_SLIDERS: tuple[tuple[str, str, float, bool, str, Literal["factor", "sum"]], ...] = (
    ("size", "Stroke width", 1, True, "stroke_size", "factor"),
    ("length", "Stroke length", 5, True, "stroke_length", "factor"),
    ("opacity", "Opacity", 0.01, True, "opacity", "factor"),
    ("hue", "Hue", 1, True, "hue", "sum"),
    ("saturation", "Saturation", 0.05, True, "saturation", "sum"),
    ("value", "Brightness", 0.05, False, "value", "sum"),
    ("jitter", "Colour variation", 0.05, False, "jitter", "factor"),
    ("relief", "Relief", 0.1, False, "relief", "factor"),
    ("grain", "Bristles", 0.05, False, "grain", "factor"),
    ("layers", "Layers", 0.1, False, "layers", "sum"),
    ("threshold", "Error threshold", 1, False, "threshold", "factor"),
)
"""Name, title, step, whether it is shown at first, and the parameter of `styles.adjusted` with what it does."""


def _slider(
    name: str, title: str, step: float, basic: bool, param: str, by: Literal["factor", "sum"]
) -> Slider:  # fmt: skip
    schema = Style.model_json_schema()["properties"][name]
    about = f"{schema['description']} Unit: {schema['unit']}."
    return Slider(
        name, title, schema["minimum"], schema["maximum"], step, about, basic, name == "hue", param, by
    )  # fmt: skip


STUDIO = Studio(
    sections=(
        Section(
            "regions", "design", "Regions",
            sliders=tuple(_slider(*row) for row in _SLIDERS),
            styles=tuple(
                Choice(name, named.title, named.style.model_dump(), named.technique.model_dump())
                for name, named in STYLES.items()
            ),
            style_param="style",
            replaces=("effect",),
        ),
    ),
    tools=("region", "lasso", "correct", "direction"),
    cuts="cut_sensitivity",
)  # fmt: skip
