"""Numbers that vary over the film: a parameter's value may be a list of keys, [[frame, value], ...]."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, SchemaValidator, core_schema

MOST_KEYS = 1000
"""Keys of one parameter."""
LAST_FRAME = 10_000_000


class Keys(tuple[tuple[int, float], ...]):
    """(frame, value) in the order of strictly increasing frames, numbers of the film; at least one."""

    __slots__ = ()

    def at(self, frame: int) -> float:
        """The value of a frame: linear between two keys, constant before the first and after the last."""
        frames, values = np.array(self, np.float64).T
        return float(np.interp(frame, frames, values))


def largest(value: float | Keys) -> float:
    """The largest value of a parameter in the film."""
    return max(one for _, one in value) if isinstance(value, tuple) else value


@dataclass(frozen=True)
class Varies:
    """Metadata of a number's field: its value may also be `Keys`, given as a list. Each value has the field's range."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        number = handler(source)
        key = core_schema.tuple_positional_schema([core_schema.int_schema(strict=True, ge=0, le=LAST_FRAME), number])
        keys = SchemaValidator(core_schema.list_schema(key, min_length=1, max_length=MOST_KEYS))

        def checked(value: Any, of_number: core_schema.ValidatorFunctionWrapHandler) -> Any:
            return _increasing(keys.validate_python(value)) if isinstance(value, list | tuple) else of_number(value)

        return core_schema.no_info_wrap_validator_function(
            checked, number, serialization=core_schema.simple_ser_schema("any")
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        number = handler(schema)
        frame = {"type": "integer", "minimum": 0, "maximum": LAST_FRAME}
        key = {"type": "array", "prefixItems": [frame, number], "minItems": 2, "maxItems": 2}
        keys = {"type": ["number", "array"], "items": key, "minItems": 1, "maxItems": MOST_KEYS}
        return {**number, **keys, "varies": True}


def _increasing(keys: list[tuple[int, float]]) -> Keys:
    for (before, _), (frame, _) in pairwise(keys):
        if frame <= before:
            raise PydanticCustomError(
                "unsorted_keys", "Frames of keys must increase: {frame} follows {before}",
                {"frame": frame, "before": before},
            )  # fmt: skip
    return Keys(keys)
