"""Parts of a project's layer: what an artist draws, paints or edits, and from which inputs of jobs are made.

A document has them by name, in the member `parts` of a layer. Their types are those of the methods, so that the
document's schema, its checks and the studio know no part of any method.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from pipeline.compositing import Blend

Id = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,40}$")]
AssetName = Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]{1,80}$", description="A name in `assets`.")]
Title = Annotated[str, Field(max_length=200)]
FrameNumber = Annotated[int, Field(ge=0, le=10_000_000)]
FrameRange = Annotated[tuple[FrameNumber, FrameNumber], Field(description="[first frame, one past the last)")]
Ratio = Annotated[float, Field(ge=0, le=1)]
Json = dict[str, JsonValue]
Ui = Annotated[dict[str, Any], Field(description="For the page; not read by the service.")]
Place = tuple[str | int, ...]
"""Members and indices that lead to a value."""
MOST_PICTURES = 1000


class Member(BaseModel):
    """Base class of everything in a document: unknown members are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Picture(Member):
    """An image for one frame: PNG of the video's size."""

    frame: FrameNumber
    image: AssetName
    ui: Ui = Field(default={})

    def assets(self) -> Iterator[tuple[Place, str]]:
        """(place, name) of every asset that it names."""
        yield ("image",), self.image


class Drawing(Picture):
    """A drawing on one frame."""

    strokes: AssetName | None = Field(default=None, description="Editable form of the drawing.")

    def assets(self) -> Iterator[tuple[Place, str]]:
        yield from super().assets()
        if self.strokes is not None:
            yield ("strokes",), self.strokes


class PaintLayer(Member):
    """One layer of the editable form of a painted key. The service reads only its assets, to keep them."""

    id: Id
    name: Title = ""
    image: AssetName | None = None
    strokes: AssetName | None = None
    mask: AssetName | None = Field(default=None, description="Where it is visible: the opacity of a PNG.")
    opacity: Ratio = 1.0
    blend: Blend | Literal["pass-through"] = Field(
        default="over", description="`pass-through`, of a group: each of its layers is blended with all that is below."
    )
    visible: bool = True
    clip: bool = Field(default=False, description="Whether it is visible only where the layer below it is.")
    locked: bool = Field(default=False, description="Whether strokes leave its opacity as it is.")
    group: bool = Field(default=False, description="Whether it is a group of the layers that name it as their parent.")
    parent: Id | None = Field(default=None, description="The group that it is in. A group follows its layers.")


class Paint(Member):
    """The editable form of a painted key. `mask`: that of the key's mask, as a layer of opaque paint."""

    layers: tuple[PaintLayer, ...] = Field(default=(), max_length=200)
    mask: PaintLayer | None = None


class PaintedKey(Picture):
    """A frame painted by the artist. Pixels that are transparent, or black in the mask, are painted by the method."""

    mask: AssetName | None = None
    paint: Paint | None = None
    before: FrameNumber | None = Field(
        default=None, description="How many frames before it it reaches; null: up to the next key."
    )
    after: FrameNumber | None = Field(default=None, description="The same for the frames after it.")
    weight: float = Field(
        default=1.0, ge=0.1, le=10, description="Between two keys, what each determines relates as their weights."
    )

    def assets(self) -> Iterator[tuple[Place, str]]:
        yield from super().assets()
        if self.mask is not None:
            yield ("mask",), self.mask
        paint = self.paint or Paint()
        rows: list[tuple[Place, PaintLayer]] = [(("layers", index), layer) for index, layer in enumerate(paint.layers)]
        rows += [(("mask",), paint.mask)] if paint.mask else []
        for place, layer in rows:
            for member in ("image", "strokes", "mask"):
                if (name := getattr(layer, member)) is not None:
                    yield ("paint", *place, member), name


Drawings = Annotated[tuple[Drawing, ...], Field(max_length=MOST_PICTURES)]
PaintedKeys = Annotated[tuple[PaintedKey, ...], Field(max_length=MOST_PICTURES)]


@dataclass(frozen=True)
class LayerPart:
    """A part of a layer. Methods that describe the same part alike share it, so that another method takes it over.

    Attributes:
        name: its name in `parts`.
        value: its type, from which JSON Schema and checks are made: `Drawings`, `PaintedKeys`, a tuple of another
            subclass of `Picture`, `Json`, or a `Member`.
        former: what schema 1 of the document had in its place: members of a layer -> their names in the part; "" = the
            part itself.
    """

    name: str
    title: str
    value: Any
    former: Mapping[str, str] = field(default_factory=dict)

    def __hash__(self) -> int:
        return hash(self.name)
