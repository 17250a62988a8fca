"""Parameters of a method: their base class, and fields with limits, unit and help for forms and command lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, JsonValue, StringConstraints, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from pipeline.methods.applies import Alternatives
from pipeline.methods.over_time import Keys, Varies

RemovedValues = Mapping[str, Mapping[str, str]]
"""Parameter -> removed value -> remedy, one sentence. A request with such a value is refused with it."""


class Params(BaseModel):
    """Base class of every method's parameters: immutable; unknown names and NaN are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)

    deprecated_names: ClassVar[Mapping[str, str]] = {}
    """Former names of parameters and their present ones. Both are accepted; results use the present name."""
    removed_values: ClassVar[RemovedValues] = {}
    """Values that are refused with a remedy of their own."""

    applies_when: ClassVar[Mapping[str, Alternatives]] = {}
    """Parameter -> the conditions under which it has an effect; without an entry: always. The schema has them, too."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = handler.resolve_ref_schema(handler(core_schema))
        for name, alternatives in cls.applies_when.items():
            schema["properties"][name]["applies_when"] = [when.as_json() for when in alternatives]
        return schema

    @property
    def over_time(self) -> dict[str, Keys]:
        """Parameters that have values over time, by name."""
        return {name: value for name, value in self if isinstance(value, Keys)}

    def at(self, frame: int) -> Self:
        """The parameters of one frame, every one a single value. `frame`: its number in the film."""
        changed = {name: keys.at(frame) for name, keys in self.over_time.items()}
        return self.model_copy(update=changed) if changed else self

    @classmethod
    def varying(cls) -> tuple[str, ...]:
        """Names of the parameters that may have values over time."""
        return tuple(name for name, field in cls.model_fields.items() if Varies() in field.metadata)

    @property
    def lead_frames(self) -> int:
        """Frames to paint before a piece of a film and throw away, so that a method with memory has one when the piece
        begins."""
        return 0

    @model_validator(mode="before")
    @classmethod
    def _replace_deprecated_names(cls, values: object) -> object:
        if not isinstance(values, Mapping) or not cls.deprecated_names.keys() & values.keys():
            return values
        renamed = dict(values)
        for former, present in cls.deprecated_names.items():
            if former in renamed:
                if present in renamed:
                    raise ValueError(f"{former!r} is the former name of {present!r}: give only {present!r}.")
                renamed[present] = renamed.pop(former)
        return renamed


P = TypeVar("P", bound=Params)
P_co = TypeVar("P_co", bound=Params, covariant=True)

Switch = Literal["on", "off"]
FlowName = Literal["dis-ultrafast", "dis-fast", "dis-medium", "tvl1"]
"""Optical flow methods, from the fastest to the most accurate: see `pipeline.perception.flow.estimate`."""


def number(
    default: float, low: float, high: float, title: str, help_: str, unit: str, group: str, symbol: str = ""
) -> Any:
    """Field for a number from `low` to `high`.

    Args:
        symbol: name of the parameter in the paper.
    """
    extra: dict[str, JsonValue] = {"unit": unit, "group": group, **({"symbol": symbol} if symbol else {})}
    return Field(default, ge=low, le=high, title=title, description=help_, json_schema_extra=extra)


def varying(
    default: float, low: float, high: float, title: str, help_: str, unit: str, group: str, symbol: str = ""
) -> Any:
    """Field for a number that may have values over time: see `number`, and `Keys`.

    The method reads it frame by frame, from `Params.at`; neither its plan nor the form of its state depends on it.
    """
    field = number(default, low, high, title, help_, unit, group, symbol)
    field.metadata.append(Varies())
    return field


def preroll(default: int) -> Any:
    """Field for `Params.lead_frames` of a method with memory."""
    return number(
        default, 0, 2000, "Preroll",
        "Frames that are painted before a piece of a film and thrown away, so that it begins with the memory of the "
        "film. Larger values differ less from the film and take longer.", "frames", "Time",
    )  # fmt: skip


_HEX = "^#[0-9a-fA-F]{6}$"
Colour = Annotated[str, StringConstraints(pattern=_HEX)]


def colour(default: str, title: str, help_: str, group: str) -> Any:
    """Field for a colour, "#rrggbb"; the field's annotation is `str`."""
    return Field(
        default, pattern=_HEX, title=title, description=help_,
        json_schema_extra={"format": "color", "unit": "", "group": group},
    )  # fmt: skip


def colours(most: int, title: str, help_: str, group: str) -> Any:
    """Field for up to `most` colours, none by default; the field's annotation is `tuple[Colour, ...]`."""
    return Field(
        (), max_length=most, title=title, description=help_,
        json_schema_extra={"format": "colors", "unit": "", "group": group},
    )  # fmt: skip


def choice(default: str, title: str, help_: str, group: str) -> Any:
    """Field for one of a few words; the annotation of the field lists them."""
    return Field(default, title=title, description=help_, json_schema_extra={"group": group})
