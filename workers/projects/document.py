"""The project document, schema 1, in JSON: assets, shots, layers with their drawings, variants, output.

Frame numbers count the frames of the shot's video from 0, even if `range` selects only a piece of it. The parts of a
layer (keys, regions, scribbles, ...) have the artist's terms; `InputSpec.part` maps them to inputs of a method. Parts
that the layer's method does not use are kept, so that changing the method loses nothing. Members named `ui` belong to
the page.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from pipeline.compositing import Blend, covers
from pipeline.formats import OutputName
from workers.contract.request import MAX_SEED, Alpha, Json

SCHEMA = 1
MAX_DOCUMENT_BYTES = 4 << 20

Id = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,40}$")]
AssetName = Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]{1,80}$", description="A name in `assets`.")]
InputName = Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]{1,80}$")]
Title = Annotated[str, Field(max_length=200)]
FrameNumber = Annotated[int, Field(ge=0, le=10_000_000)]
FrameRange = Annotated[tuple[FrameNumber, FrameNumber], Field(description="[first frame, one past the last)")]
Ratio = Annotated[float, Field(ge=0, le=1)]
Ui = Annotated[Json, Field(description="For the page; not read by the service.")]


class Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class AssetRef(Part):
    """An uploaded file with a name for use in the document."""

    id: str = Field(pattern=r"^ast_[0-9a-f]{64}$")
    title: Title = ""


class PaintLayer(Part):
    """One layer of the editable form of a painted key. The service reads only its assets, to keep them."""

    id: Id
    name: Title = ""
    image: AssetName | None = None
    strokes: AssetName | None = None
    opacity: Ratio = 1.0
    blend: Blend = "over"
    visible: bool = True


class Paint(Part):
    """The editable form of a painted key."""

    layers: tuple[PaintLayer, ...] = Field(default=(), max_length=200)


class Drawing(Part):
    """An image for one frame: PNG of the video's size."""

    frame: FrameNumber
    image: AssetName
    strokes: AssetName | None = Field(default=None, description="Editable form of the drawing.")
    ui: Ui = {}


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


class PaintedKey(Part):
    """A frame painted by the artist. Pixels that are transparent, or black in the mask, are painted by the method."""

    frame: FrameNumber
    image: AssetName
    mask: AssetName | None = None
    paint: Paint | None = None
    ui: Ui = {}


class Layer(Part):
    """A method applied to a shot, and the compositing of its picture over the layers below, or over the video."""

    id: Id
    name: Title = ""
    method: str = Field(min_length=1, max_length=64)
    params: Json = Field(default={}, max_length=256)
    seed: int = Field(default=0, ge=0, le=MAX_SEED)
    visible: bool = True
    opacity: Ratio = 1.0
    blend: Blend = "over"
    source: AssetName | None = Field(default=None, description="Another video for this layer, frame by frame.")
    matte: AssetName | None = Field(default=None, description="Gray pictures: white where the layer is.")
    inputs: dict[InputName, AssetName] = Field(default={}, max_length=64, description="Files by the method's inputs.")
    keys: tuple[PaintedKey, ...] = Field(default=(), max_length=1000)
    regions: Json = {}
    styles: Json = {}
    style_keys: tuple[object, ...] = ()
    directions: tuple[object, ...] = ()
    region_maps: tuple[Drawing, ...] = Field(default=(), max_length=1000)
    scribbles: tuple[Drawing, ...] = Field(default=(), max_length=1000)
    labels: tuple[LabelMap, ...] = Field(default=(), max_length=1000)
    label_styles: Json = {}
    importance: tuple[Drawing, ...] = Field(default=(), max_length=1000)
    histogram: Json | None = None
    ui: Ui = {}

    @property
    def covers(self) -> bool:
        """Whether the layer hides everything below it."""
        return covers(self.opacity, self.blend, self.matte is not None)

    @property
    def label_intervals(self) -> list[Json]:
        """Frames to solve again before and after each corrected label map, for maps with an interval."""
        return [
            {"frame": one.frame, "before": one.frame - one.solve[0], "after": one.solve[1] - 1 - one.frame}
            for one in sorted(self.labels, key=lambda one: one.frame) if one.solve is not None
        ]  # fmt: skip

    @property
    def design(self) -> Json | None:
        """Regions, styles, style keys and directions as one design document; None if there are none."""
        parts = {
            "regions": self.regions, "styles": self.styles, "keys": list(self.style_keys),
            "directions": list(self.directions),
        }  # fmt: skip
        return {"version": 1, **parts} if any(parts.values()) else None


class Shot(Part):
    """A video, or a piece of it, and its layers from back to front."""

    id: Id
    name: Title = ""
    video: AssetName
    range: FrameRange | None = None
    layers: tuple[Layer, ...] = Field(default=(), max_length=32)
    ui: Ui = {}


class Variant(Part):
    """An alternative version of a layer."""

    id: Id
    name: Title = ""
    shot: Id
    layer: Id
    set: Json = Field(default={}, description="JSON Merge Patch (RFC 7396) on the layer.")
    frame: FrameNumber | None = None
    image: AssetName | None = None
    ui: Ui = {}


class Output(Part):
    """Output settings of the project's jobs."""

    format: OutputName = "mp4"
    quality: int = Field(default=20, ge=0, le=51, description="Constant rate factor, 0 (lossless) to 51.")
    profile: str = Field(default="", max_length=32, description="Encoding of the format; empty: its usual one.")
    alpha: Alpha = Field(default="auto", description="Opacity of the film, as in a job.")
    artefacts: tuple[InputName, ...] = Field(default=(), max_length=32)
    report: bool = Field(default=False, description="Measure the film against the video, see `report.json`.")
    on_damage: Literal["warn", "fail"] = Field(
        default="warn",
        description="If frames of an input are missing or unreadable: use what can be read and add a warning to the "
        "job, or fail with the code `damaged-media`.",
    )


class Document(Part):
    """A project, schema 1."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_by_name=True)

    schema_version: Literal[1] = Field(alias="schema")
    name: str = Field(min_length=1, max_length=200)
    assets: dict[AssetName, AssetRef] = Field(default={}, max_length=20_000)
    shots: tuple[Shot, ...] = Field(default=(), max_length=500)
    variants: tuple[Variant, ...] = Field(default=(), max_length=500)
    output: Output = Output()
    ui: Ui = {}

    @property
    def asset_ids(self) -> frozenset[str]:
        """Ids of all assets that the document names."""
        return frozenset(ref.id for ref in self.assets.values())


def empty(name: str) -> Json:
    """A new document without shots."""
    return {"schema": SCHEMA, "name": name}


def json_schema() -> Json:
    """JSON Schema of the document."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Document.model_json_schema(by_alias=True)}
