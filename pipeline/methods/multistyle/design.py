"""The design document: what a person wants of which region, when. JSON, versioned, checked down to the last key."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.errors import BadParameter
from pipeline.methods.multistyle.styles import FIELDS, STYLE_NAMES, STYLES, Style
from pipeline.tensors.elements import Pattern

VERSION = 1
INPUT = "inputs.design"
REST = "rest"
"""The region of all pixels that no other region has."""
MOST_REGIONS = 200

Ease = Literal["linear", "smooth", "in", "out", "hold"]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_. -]{0,63}$")]
Share = Annotated[float, Field(ge=-2, le=3)]
"""A position in shares of the picture's width or height: 0 = left or top, 1 = right or bottom."""
Point = tuple[Share, Share]
FrameNumber = Annotated[int, Field(ge=0)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Polygon(_Part):
    """An outline drawn in a keyframe; carried to the frames around it along the motion."""

    frame: FrameNumber
    points: Annotated[tuple[Point, ...], Field(min_length=3, max_length=2000)]


class Region(_Part):
    """Where a region is. Exactly one of `label`, `tubes`, `objects` and `polygons` is given.

    Regions that are named later lie over those before. `border`: plain = style and direction jump between regions that
    have keys, and spread from those into regions that have none; sharp = nothing spreads over this region's border;
    soft = they change gradually, over two hundredths of the height.
    """

    label: Annotated[int | None, Field(ge=0, le=65535, description="Value in the label maps of the input `masks`.")] = (
        None
    )
    tubes: Annotated[tuple[int, ...], Field(max_length=10000, description="Tubes of the segmentation, merged.")] = ()
    objects: Annotated[tuple[int, ...], Field(max_length=1000, description="Objects of the segmentation, merged.")] = ()
    polygons: Annotated[tuple[Polygon, ...], Field(max_length=1000, description="Outlines in keyframes.")] = ()
    of: Annotated[Name | None, Field(description="Only within this region, of which it splits off a part.")] = None
    border: Literal["plain", "sharp", "soft"] = "plain"


class Changes(_Part):
    """Style parameters to change, each as in `Style`."""

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


class OwnStyle(Changes):
    """A style of the user's own: a named one, changed."""

    base: Literal["van-gogh", "impressionism", "expressionism", "pointillism", "colorist-wash", "watercolor"] | None = (
        None
    )


class StyleKey(_Part):
    """From this frame on, a region has this style; it changes on the way to the region's next key as `ease` says."""

    region: Name
    frame: FrameNumber = 0
    style: Annotated[str | None, Field(description="A named style or one of `styles`; none = the job's own.")] = None
    set: Changes = Changes()
    ease: Ease = "linear"


class ElementAt(_Part):
    """A design element of the orientation field."""

    pattern: Pattern
    at: Point
    angle: Annotated[float, Field(ge=-360, le=360, description="Degrees, clockwise.")] = 0.0
    reach: Annotated[float, Field(ge=0, le=100, description="Heights at which 37 % are left; 0 = everywhere.")] = 0.0
    strength: Annotated[float, Field(ge=0, le=100)] = 1.0


class DirectionKey(_Part):
    """Which way a region's strokes run: `edge_weight` of the picture's own directions, the rest by elements."""

    region: Name
    frame: FrameNumber = 0
    edge_weight: Annotated[float, Field(ge=0, le=1, description="w of P = w E + (1 - w) sum of M.")] = 0.5
    elements: Annotated[tuple[ElementAt, ...], Field(max_length=200)] = ()
    follow: Annotated[bool, Field(description="Elements move, turn and grow with the region.")] = True
    free: Annotated[bool, Field(description="No direction of its own: its surroundings' spread into it.")] = False
    ease: Ease = "linear"


class Design(_Part):
    """A design for the method multistyle, version 1."""

    version: Literal[1]
    regions: Annotated[dict[Name, Region], Field(max_length=MOST_REGIONS)] = {}
    styles: Annotated[dict[Name, OwnStyle], Field(max_length=MOST_REGIONS)] = {}
    keys: Annotated[tuple[StyleKey, ...], Field(max_length=20000)] = ()
    directions: Annotated[tuple[DirectionKey, ...], Field(max_length=20000)] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Regions by their number in region maps: 0 is `rest`."""
        return (REST, *(name for name in self.regions if name != REST))

    @property
    def wants_tubes(self) -> bool:
        return any(region.tubes or region.objects for region in self.regions.values())

    @property
    def wants_masks(self) -> bool:
        return any(region.label is not None for region in self.regions.values())

    def style(self, key: StyleKey, base: Style) -> Style:
        """The style of a key; `base` is the job's own."""
        found = base
        if key.style in self.styles:
            own = self.styles[key.style]
            found = _changed(base if own.base is None else STYLES[own.base].style, own)
        elif key.style is not None:
            found = STYLES[key.style].style
        return _changed(found, key.set)


def _changed(style: Style, changes: Changes) -> Style:
    wanted = {name: getattr(changes, name) for name in FIELDS if getattr(changes, name) is not None}
    return style.model_copy(update=wanted)


def schema() -> dict[str, Any]:
    """JSON Schema of the design document."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Design.model_json_schema()}


def parse(document: Any, *, frames: int | None = None, masks: bool | None = None) -> Design:
    """The design in a parsed JSON document.

    Args:
        frames: of the video; None = not known, then frame numbers are not checked against it.
        masks: whether label maps were given; None = not known.

    Raises:
        BadParameter: `field` is the path of what is wrong, as inputs.design.keys[3].frame.
    """
    try:
        design = Design.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        remedy = f"Use {VERSION}." if first["loc"] == ("version",) else "See docs/multistyle.md for the format."
        raise BadParameter(
            f"{first['msg']}.", field=_path(first["loc"]), value=first.get("input"), remedy=remedy
        ) from None
    for check in (_check_regions, _check_keys):
        check(design)
    if frames is not None:
        _check_frames(design, frames)
    if masks is False and design.wants_masks:
        name = next(name for name, region in design.regions.items() if region.label is not None)
        _refuse(f".regions.{name}.label", design.regions[name].label, "It needs label maps.", "Give the input masks.")
    return design


def _path(loc: Iterable[int | str]) -> str:
    return INPUT + "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc)


def _refuse(path: str, value: object, message: str, remedy: str) -> None:
    raise BadParameter(message, field=f"{INPUT}{path}", value=value, remedy=remedy)


def _check_regions(design: Design) -> None:
    taken: dict[tuple[str, int], str] = {}
    for name, region in design.regions.items():
        path = f".regions.{name}"
        given = [kind for kind in ("label", "tubes", "objects", "polygons") if getattr(region, kind) not in (None, ())]
        if name == REST:
            if given or region.of:
                _refuse(path, given, "The rest is what no other region has.", "Give it a border at most.")
            continue
        if len(given) != 1:
            _refuse(path, given, "A region is one of label, tubes, objects or polygons.", "Give exactly one of them.")
        for kind, numbers in (("label", (region.label,)), ("tubes", region.tubes), ("objects", region.objects)):
            for number in numbers:
                if number is not None and taken.setdefault((kind, number), name) != name:
                    other = taken[kind, number]
                    _refuse(f"{path}.{kind}", number, f"The region {other!r} has it already.", "Name it once.")
        _check_of(design, name, path)
        _check_twice((polygon.frame for polygon in region.polygons), f"{path}.polygons", "frame")


def _check_of(design: Design, name: str, path: str) -> None:
    seen, at = {name}, design.regions[name].of
    while at is not None and at != REST:
        if at not in design.regions:
            _refuse(f"{path}.of", at, "There is no such region.", f"There are: {', '.join(design.names)}.")
        if at in seen:
            _refuse(f"{path}.of", at, "A region is no part of itself.", "Break the circle.")
        seen.add(at)
        at = design.regions[at].of


def _check_keys(design: Design) -> None:
    known = ", ".join((*STYLE_NAMES, *design.styles))
    for index, key in enumerate(design.keys):
        _check_region(design, f".keys[{index}].region", key.region)
        if key.style is not None and key.style not in (*STYLE_NAMES, *design.styles):
            _refuse(f".keys[{index}].style", key.style, "There is no such style.", f"Use one of: {known}.")
    for index, direction in enumerate(design.directions):
        _check_region(design, f".directions[{index}].region", direction.region)
    _check_twice(((key.region, key.frame) for key in design.keys), ".keys", "frame")
    _check_twice(((key.region, key.frame) for key in design.directions), ".directions", "frame")


def _check_region(design: Design, path: str, name: str) -> None:
    if name not in design.names:
        _refuse(path, name, "There is no such region.", f"There are: {', '.join(design.names)}.")


def _check_twice(keys: Iterable[Any], path: str, leaf: str) -> None:
    seen: set[Any] = set()
    for index, key in enumerate(keys):
        if key in seen:
            _refuse(f"{path}[{index}].{leaf}", key, "There is a key at this frame already.", "Keep one of them.")
        seen.add(key)


def _check_frames(design: Design, frames: int) -> None:
    for path, number in _frame_numbers(design):
        if number >= frames:
            _refuse(path, number, f"The video has {frames} frames.", f"Use 0 to {frames - 1}.")


def _frame_numbers(design: Design) -> Iterator[tuple[str, int]]:
    for name, region in design.regions.items():
        for index, polygon in enumerate(region.polygons):
            yield f".regions.{name}.polygons[{index}].frame", polygon.frame
    for index, key in enumerate(design.keys):
        yield f".keys[{index}].frame", key.frame
    for index, direction in enumerate(design.directions):
        yield f".directions[{index}].frame", direction.frame


Key = TypeVar("Key", StyleKey, DirectionKey)


def around(keys: Iterable[Key], region: str, frame: int) -> tuple[Key, Key, float] | None:
    """The keys of a region that a frame lies between, and how far it is on its way from one to the other, 0..1, eased.

    Outside all keys both are the nearest one; None if the region has none.

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


def eased(t: float, ease: Ease) -> float:
    """The interpolation function f(t), from 0 at 0 to 1 at 1."""
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
