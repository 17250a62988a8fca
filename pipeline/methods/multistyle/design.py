"""The design document: regions, their styles and stroke directions at keyframes. JSON with a version number."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator
from itertools import pairwise
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from pipeline.errors import BadParameter
from pipeline.methods.base import InputFault, JsonSchema
from pipeline.methods.multistyle.params import STYLE_NAMES, StyleName
from pipeline.methods.multistyle.styles import FIELDS, STYLES, TECHNIQUE_FIELDS, Style, Technique
from pipeline.tensors.elements import Pattern

VERSION = 1
INPUT = "inputs.design"
REST = "rest"
"""Name of the region of all pixels that belong to no other region."""
MOST_REGIONS = 200
"""Region numbers are stored in 8 bits, and 255 is reserved."""

Ease = Literal["linear", "smooth", "in", "out", "hold"]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_. -]{0,63}$")]
Fraction = Annotated[float, Field(ge=-2, le=3)]
"""A position as a fraction of the picture's width or height: 0 = left or top, 1 = right or bottom."""
Point = tuple[Fraction, Fraction]
FrameNumber = Annotated[int, Field(ge=0)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Polygon(_Part):
    """An outline drawn in a keyframe. It is propagated to the frames around it along the motion. Several outlines of a
    region in one frame are its parts."""

    frame: FrameNumber
    points: Annotated[tuple[Point, ...], Field(min_length=3, max_length=2000)]


class Correction(_Part):
    """A stroke with a brush in a keyframe: its pixels belong to the region `region`, which may be `rest`.

    Corrections are propagated along the motion through the shot; later strokes of a frame cover earlier ones.
    """

    region: Name
    frame: FrameNumber
    points: Annotated[tuple[Point, ...], Field(min_length=1, max_length=2000)]
    width: Annotated[float, Field(gt=0, le=2, description="Width of the stroke, picture heights.")]


class Region(_Part):
    """Location of a region. At least one of `label`, `tubes`, `objects` and `polygons` must be given; with
    several, it is where one of them is.

    Later regions cover earlier ones. `border`: plain = style and direction jump between regions that have keys, and
    spread into regions without; sharp = nothing spreads across this region's border; soft = they change gradually, over
    two hundredths of the shorter side.
    """

    label: Annotated[int | None, Field(ge=0, le=65535, description="Value in the label maps of the input `masks`.")] = (
        None
    )
    tubes: Annotated[
        tuple[int, ...], Field(max_length=10000, description="Numbers of the tubes that make up the region.")
    ] = ()
    objects: Annotated[
        tuple[int, ...], Field(max_length=1000, description="Numbers of the objects that make up the region.")
    ] = ()
    polygons: Annotated[tuple[Polygon, ...], Field(max_length=1000, description="Outlines in keyframes.")] = ()
    of: Annotated[Name | None, Field(description="Parent region: only pixels inside it count.")] = None
    border: Literal["plain", "sharp", "soft"] = "plain"


def _optional(field: FieldInfo) -> Any:
    """The same field, optional."""
    return Annotated[(float | None, *field.metadata, Field(description=field.description))], None


class Changes(_Part):
    """Changes of style parameters, each as in `Style`."""

    size: Annotated[float | None, Field(ge=2, le=150)] = None
    length: Annotated[float | None, Field(ge=0, le=600)] = None
    opacity: Annotated[float | None, Field(ge=0.02, le=1)] = None
    hue: Annotated[float | None, Field(ge=-180, le=180)] = None
    saturation: Annotated[float | None, Field(ge=-1, le=1)] = None
    value: Annotated[float | None, Field(ge=-1, le=1)] = None
    jitter: Annotated[float | None, Field(ge=0, le=1)] = None
    relief: Annotated[float | None, Field(ge=0, le=20)] = None
    grain: Annotated[float | None, Field(ge=0, le=1)] = None
    layers: Annotated[float | None, Field(ge=1, le=4)] = None
    threshold: Annotated[float | None, Field(ge=0, le=442)] = None


TechniqueChanges = create_model(
    "TechniqueChanges", __base__=_Part, __doc__="Changes of technique parameters, each as in `Technique`.",
    **{name: _optional(field) for name, field in Technique.model_fields.items()},
)  # fmt: skip


class OwnStyle(Changes):
    """A style defined by the user: a named style with changes; without `base`, the job's style with changes."""

    base: StyleName | None = None
    technique: Annotated[
        TechniqueChanges, Field(description="Changes of layers, profile, ground, light and paper.")
    ] = TechniqueChanges()


class StyleKey(_Part):
    """Style of a region at a frame. Up to the region's next key it is interpolated with the function `ease`."""

    region: Name
    frame: FrameNumber = 0
    style: Annotated[str | None, Field(description="A named style or one of `styles`; none = the job's style.")] = None
    set: Changes = Changes()
    ease: Ease = "linear"


class ElementAt(_Part):
    """A design element of the orientation field."""

    pattern: Pattern
    at: Point
    angle: Annotated[float, Field(ge=-360, le=360, description="Degrees, clockwise.")] = 0.0
    reach: Annotated[
        Literal["everywhere"] | Annotated[float, Field(ge=0, le=100)],
        Field(
            description="Distance, in picture heights, at which 37 % of the strength is left; everywhere, or 0 = the "
            "strength is the same in the whole region."
        ),
    ] = "everywhere"
    strength: Annotated[float, Field(ge=0, le=100)] = 1.0


class DirectionKey(_Part):
    """Stroke directions of a region: the picture's own directions by `edge_weight`, the rest by elements."""

    region: Name
    frame: FrameNumber = 0
    edge_weight: Annotated[float, Field(ge=0, le=1, description="w of P = w E + (1 - w) sum of M.")] = 0.5
    elements: Annotated[tuple[ElementAt, ...], Field(max_length=200)] = ()
    follow: Annotated[
        bool, Field(description="Elements translate, rotate and scale with the region; those of rest stay.")
    ] = True
    free: Annotated[
        bool, Field(description="No directions of its own: those of the surroundings are spread into the region.")
    ] = False
    ease: Ease = "linear"


class Design(_Part):
    """A design for the method multistyle, format version 1."""

    version: Literal[1]
    regions: Annotated[dict[Name, Region], Field(max_length=MOST_REGIONS)] = {}
    styles: Annotated[dict[Name, OwnStyle], Field(max_length=MOST_REGIONS)] = {}
    keys: Annotated[tuple[StyleKey, ...], Field(max_length=20000)] = ()
    directions: Annotated[tuple[DirectionKey, ...], Field(max_length=20000)] = ()
    corrections: Annotated[tuple[Correction, ...], Field(max_length=20000)] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Region names by region number; 0 is `rest`."""
        return (REST, *(name for name in self.regions if name != REST))

    @property
    def wants_tubes(self) -> bool:
        return any(region.tubes or region.objects for region in self.regions.values())

    @property
    def wants_masks(self) -> bool:
        return any(region.label is not None for region in self.regions.values())

    def style(self, key: StyleKey, base: Style) -> Style:
        """Style of a key; `base` is the job's style."""
        own, named = self._resolved(key)
        found = base if named is None else STYLES[named].style
        return _changed(_changed(found, own, FIELDS), key.set, FIELDS)

    def technique(self, key: StyleKey, base: Technique) -> Technique:
        """Technique of a key; `base` is the job's technique."""
        own, named = self._resolved(key)
        found = base if named is None else STYLES[named].technique
        return found if own is None else _changed(found, own.technique, TECHNIQUE_FIELDS)

    def _resolved(self, key: StyleKey) -> tuple[OwnStyle | None, StyleName | None]:
        """The user's style that a key names, if any, and the named style below it, if any."""
        own = self.styles.get(key.style) if key.style is not None else None
        if own is not None:
            return own, own.base
        return None, next((name for name in STYLE_NAMES if name == key.style), None)


Model = TypeVar("Model", bound=BaseModel)


def _changed(style: Model, changes: BaseModel | None, names: Iterable[str]) -> Model:
    if changes is None:
        return style
    return style.model_copy(update={name: new for name in names if (new := getattr(changes, name)) is not None})


def schema() -> JsonSchema:
    """JSON Schema of the design document."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Design.model_json_schema()}


def parse(document: object, *, frames: int | None = None, masks: bool | None = None) -> Design:
    """Validate a parsed JSON document and return the design.

    Args:
        frames: number of frames of the video; None = unknown, then frame numbers are not checked.
        masks: whether the input `masks` is given; None = unknown.

    Raises:
        BadParameter: the design is invalid: its first fault; `field` is the path, such as inputs.design.keys[3].frame.
    """
    design, faults = _checked(document, frames, masks)
    if faults:
        first = faults[0]
        raise BadParameter(first.message, field=_dotted(first.path), value=first.value, remedy=first.remedy)
    assert design is not None
    return design


def check(document: object, *, frames: int | None, masks: bool | None) -> list[InputFault]:
    """Every fault of a design document; arguments as for `parse`."""
    return _checked(document, frames, masks)[1]


def _checked(document: object, frames: int | None, masks: bool | None) -> tuple[Design | None, list[InputFault]]:
    try:
        design = Design.model_validate(document)
    except ValidationError as error:
        return None, [_fault_of(found) for found in error.errors(include_url=False)]
    return design, [*_region_faults(design), *_key_faults(design), *_frame_faults(design, frames),
                    *_mask_faults(design, masks)]  # fmt: skip


def _fault_of(error: ErrorDetails) -> InputFault:
    path = tuple(part for part in error["loc"] if part != "[key]")
    remedy = f"Use {VERSION}." if path == ("version",) else "See docs/multistyle.md for the format."
    return InputFault(path, f"{error['msg']}.", error.get("input"), remedy)


def _dotted(path: Iterable[int | str]) -> str:
    return INPUT + "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)


def _mask_faults(design: Design, masks: bool | None) -> Iterator[InputFault]:
    for name, region in design.regions.items():
        if masks is False and region.label is not None:
            yield InputFault(
                ("regions", name, "label"),
                "A region by label needs label maps.",
                region.label,
                "Add the input `masks`.",
            )


def _region_faults(design: Design) -> Iterator[InputFault]:
    taken: dict[tuple[str, int], str] = {}
    for name, region in design.regions.items():
        path = ("regions", name)
        given = [kind for kind in ("label", "tubes", "objects", "polygons") if getattr(region, kind) not in (None, ())]
        if name == REST:
            if given or region.of:
                yield InputFault(
                    path, "The region `rest` has no location of its own.", given, "Set at most its `border`."
                )
            continue
        if not given:
            yield InputFault(path, "A region needs a label, tubes, objects or polygons.", given, "Give one of them.")
        for kind, numbers in (("label", (region.label,)), ("tubes", region.tubes), ("objects", region.objects)):
            for number in numbers:
                if number is not None and taken.setdefault((kind, number), name) != name:
                    other = taken[kind, number]
                    yield InputFault(
                        (*path, kind), f"The region {other!r} already contains it.", number, "List it once."
                    )
        yield from _of_faults(design, name)


def _of_faults(design: Design, name: str) -> Iterator[InputFault]:
    path = ("regions", name, "of")
    visited, at = {name}, design.regions[name].of
    while at is not None and at != REST:
        if at not in design.regions:
            yield InputFault(path, "Unknown region.", at, f"Known regions: {', '.join(design.names)}.")
            return
        if at in visited:
            yield InputFault(path, "A region cannot be its own parent.", at, "Remove the cycle of `of`.")
            return
        visited.add(at)
        at = design.regions[at].of


def _key_faults(design: Design) -> Iterator[InputFault]:
    styles, regions = (*STYLE_NAMES, *design.styles), design.names
    for index, key in enumerate(design.keys):
        if key.region not in regions:
            yield _no_region(design, ("keys", index, "region"), key.region)
        if key.style is not None and key.style not in styles:
            path = ("keys", index, "style")
            yield InputFault(path, "Unknown style.", key.style, f"Use one of: {', '.join(styles)}.")
    for index, direction in enumerate(design.directions):
        if direction.region not in regions:
            yield _no_region(design, ("directions", index, "region"), direction.region)
    for index, correction in enumerate(design.corrections):
        if correction.region not in regions:
            yield _no_region(design, ("corrections", index, "region"), correction.region)
    yield from _twice(((key.region, key.frame) for key in design.keys), ("keys",))
    yield from _twice(((key.region, key.frame) for key in design.directions), ("directions",))


def _no_region(design: Design, path: tuple[str | int, ...], name: str) -> InputFault:
    return InputFault(path, "Unknown region.", name, f"Known regions: {', '.join(design.names)}.")


def _twice(keys: Iterable[Hashable], path: tuple[str | int, ...]) -> Iterator[InputFault]:
    met: set[Hashable] = set()
    for index, key in enumerate(keys):
        if key in met:
            yield InputFault(
                (*path, index, "frame"), "Two keys of one region have the same frame.", key, "Keep one of them."
            )
        met.add(key)


def _frame_faults(design: Design, frames: int | None) -> Iterator[InputFault]:
    for path, number in _frame_numbers(design):
        if frames is not None and number >= frames:
            yield InputFault(path, f"The video has {frames} frames.", number, f"Use 0 to {frames - 1}.")


def _frame_numbers(design: Design) -> Iterator[tuple[tuple[str | int, ...], int]]:
    for name, region in design.regions.items():
        for index, polygon in enumerate(region.polygons):
            yield ("regions", name, "polygons", index, "frame"), polygon.frame
    for index, key in enumerate(design.keys):
        yield ("keys", index, "frame"), key.frame
    for index, direction in enumerate(design.directions):
        yield ("directions", index, "frame"), direction.frame
    for index, correction in enumerate(design.corrections):
        yield ("corrections", index, "frame"), correction.frame


Key = TypeVar("Key", StyleKey, DirectionKey)


def keys_around(keys: Iterable[Key], region: str, frame: int) -> tuple[Key, Key, float] | None:
    """The two keys of a region around a frame, and the eased interpolation parameter, 0..1, between them.

    Before the first and after the last key both are that key; None if the region has no key.

    Source: kagaya2011video, section 3.1, step 1.
    """
    own = sorted((key for key in keys if key.region == region), key=lambda key: key.frame)
    if not own:
        return None
    if frame <= own[0].frame:
        return own[0], own[0], 0.0
    for before, after in pairwise(own):
        if frame < after.frame:
            return before, after, eased((frame - before.frame) / (after.frame - before.frame), before.ease)
    return own[-1], own[-1], 0.0


def followed(design: Design) -> list[tuple[str, int]]:
    """(region, keyframe) of the directions whose elements follow their region. Those of `rest` stay: its shape changes
    with the regions that move in front of it."""
    keys = (key for key in design.directions if key.elements and key.follow and key.region != REST)
    return sorted({(key.region, key.frame) for key in keys})


def eased(t: float, ease: Ease) -> float:
    """The interpolation function f(t), with f(0) = 0 and f(1) = 1."""
    match ease:
        case "linear":
            return t
        case "smooth":
            return t * t * (3 - 2 * t)
        case "in":
            return t * t * t
        case "out":
            return 1 - (1 - t) ** 3
        case "hold":
            return math.floor(t)
