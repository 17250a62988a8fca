"""The project document, schema 2, in JSON: assets, shots, layers with their parts, variants, output.

Frame numbers count the frames of the shot's video from 0, even if `range` selects only a piece of it. The parts of a
layer (what the artist draws, paints and edits) are those that methods describe (`LayerPart`); `InputSpec.part` maps
them to inputs of a method. Parts that the layer's method does not use are kept, so that changing the method loses
nothing. Members named `ui` belong to the page.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter
from typing_extensions import TypedDict

from pipeline.compositing import Blend, covers
from pipeline.formats import OutputName
from pipeline.methods import layer_parts
from pipeline.methods.parts import AssetName, FrameNumber, FrameRange, Id, LayerPart, Member, Picture, Ratio, Title, Ui
from pipeline.video.media import Fields, SourceOptions
from workers.contract.request import MAX_SEED, Alpha, Json

SCHEMA = 2
MAX_DOCUMENT_BYTES = 4 << 20

InputName = Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]{1,80}$")]


class AssetRef(Member):
    """An uploaded file with a name for use in the document."""

    id: str = Field(pattern=r"^ast_[0-9a-f]{64}$")
    title: Title = ""


@cache
def _type_of(parts: tuple[LayerPart, ...]) -> TypeAdapter[dict[str, Any]]:
    """Type of these parts by name; any other part is any JSON."""
    make: Any = TypedDict
    known = make("Parts", {part.name: part.value for part in parts}, total=False)
    known.__pydantic_config__ = ConfigDict(extra="allow")
    return TypeAdapter(known)


def _parts() -> TypeAdapter[dict[str, Any]]:
    """Type of the parts that the installed methods describe."""
    return _type_of(tuple(layer_parts().values()))


class Layer(Member):
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
    parts: Annotated[dict[InputName, object], AfterValidator(lambda value: _parts().validate_python(value))] = Field(
        default={}, max_length=64, description="What is drawn, painted and edited for methods, by their names of parts."
    )
    ui: Ui = Field(default={})

    @property
    def covers(self) -> bool:
        """Whether the layer hides everything below it."""
        return covers(self.opacity, self.blend, self.matte is not None)

    def pictures(self, part: str) -> tuple[Picture, ...]:
        """The pictures of a part, one for each frame; none if the part is something else."""
        value = self.parts.get(part)
        return value if isinstance(value, tuple) and all(isinstance(one, Picture) for one in value) else ()


class Reading(Member):
    """How a video is read."""

    picture: int | None = Field(
        default=None, ge=0, le=1000, description="Which of its video streams, from 0; null: the main one."
    )
    sound: tuple[Annotated[int, Field(ge=0, le=1000)], ...] | None = Field(
        default=None, max_length=16, description="Which of its sound tracks are delivered, from 0; null: all."
    )
    fields: Fields = Field(
        default="auto",
        description="`auto`: deinterlace what the file marks as interlaced; `progressive`: nothing; `top`, `bottom`: "
        "everything, with this field first.",
    )

    premultiplied: bool = Field(
        default=False,
        description="Whether colours are multiplied by their opacity, in formats that do not prescribe it.",
    )
    colour: str = Field(
        default="", max_length=200, description="Colour space of the pictures, a name of the OpenColorIO "
        "configuration, for example `ACEScg`; empty: as the file says.",
    )  # fmt: skip
    colour_view: str = Field(
        default="", max_length=200, description="View of that configuration through which HDR and scene-linear "
        "pictures are painted, for example `ACES 2.0 - SDR 100 nits (Rec.709)`; empty: no tone map.",
    )  # fmt: skip

    def options(self) -> SourceOptions:
        return SourceOptions(
            self.picture, self.sound, self.fields, self.premultiplied, colour=self.colour, colour_view=self.colour_view
        )


class Shot(Member):
    """A video, or a piece of it, and its layers from back to front."""

    id: Id
    name: Title = ""
    video: AssetName
    source: Reading = Reading()
    range: FrameRange | None = None
    layers: tuple[Layer, ...] = Field(default=(), max_length=32)
    ui: Ui = Field(default={})


class Variant(Member):
    """An alternative version of a layer."""

    id: Id
    name: Title = ""
    shot: Id
    layer: Id
    set: Json = Field(default={}, description="JSON Merge Patch (RFC 7396) on the layer.")
    frame: FrameNumber | None = None
    image: AssetName | None = None
    ui: Ui = Field(default={})


class Output(Member):
    """Output settings of the project's jobs."""

    format: OutputName = "mp4"
    quality: int = Field(default=20, ge=0, le=51, description="Constant rate factor, 0 (lossless) to 51.")
    profile: str = Field(default="", max_length=32, description="Encoding of the format; empty: its usual one.")
    alpha: Alpha = Field(default="auto", description="Opacity of the film, as in a job.")
    colour: str = Field(default="", max_length=200, description="Colour space of the film, as in a job.")
    layer: Id | None = Field(
        default=None, description="The layer that the film shows alone, with its opacity; null: all visible layers."
    )
    artefacts: tuple[InputName, ...] = Field(default=(), max_length=32)
    passes: tuple[InputName, ...] = Field(
        default=(),
        max_length=64,
        description="Passes beside the film, as in a job: of every shown layer whose method makes them.",
    )
    passes_format: str = Field(default="", max_length=32, description="Format of the passes, as in a job.")
    report: bool = Field(default=False, description="Measure the film against the video, see `report.json`.")
    on_damage: Literal["warn", "fail"] = Field(
        default="warn",
        description="If frames of an input are missing or unreadable: use what can be read and add a warning to the "
        "job, or fail with the code `damaged-media`.",
    )


class Document(Member):
    """A project, schema 2."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_by_name=True)

    schema_version: Literal[2] = Field(alias="schema")
    name: str = Field(min_length=1, max_length=200)
    assets: dict[AssetName, AssetRef] = Field(default={}, max_length=20_000)
    shots: tuple[Shot, ...] = Field(default=(), max_length=500)
    variants: tuple[Variant, ...] = Field(default=(), max_length=500)
    output: Output = Output()
    ui: Ui = Field(default={})

    @property
    def asset_ids(self) -> frozenset[str]:
        """Ids of all assets that the document names."""
        return frozenset(ref.id for ref in self.assets.values())


def empty(name: str) -> Json:
    """A new document without shots."""
    return {"schema": SCHEMA, "name": name}


def json_schema() -> Json:
    """JSON Schema of the document, with those of the parts that the installed methods have."""
    schema = Document.model_json_schema(by_alias=True)
    parts = _parts().json_schema()
    schema["$defs"] |= parts.pop("$defs", {})
    schema["$defs"]["Layer"]["properties"]["parts"] |= {"properties": parts["properties"]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
