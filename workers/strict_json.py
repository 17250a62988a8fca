"""JSON by RFC 8259 within bounds, for every text and every value that a user can make grow.

A text is checked before it is parsed, because a parser makes 56 to 200 bytes of memory of the two bytes `[]`, and
recurses as deep as the text nests.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from itertools import accumulate
from typing import NoReturn

from pydantic import JsonValue

from pipeline.errors import BadInput

MAX_DEPTH = 64
"""Maximum depth of lists and objects."""
MAX_VALUES = 250_000
"""Maximum number of values and member names in one text, or one document."""
_STRINGS = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"?', re.DOTALL)
_NO_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
_STEP = {ord("["): 1, ord("{"): 1, ord("]"): -1, ord("}"): -1}
_ESCAPED = re.compile(rb"\\u(?:0000|[dD][89a-fA-F])")
"""Escapes that may encode a NUL or half of a surrogate pair."""


class BadJson(BadInput):
    """A text is not JSON, or is beyond the bounds."""

    code = "bad-json"


def strict_json(text: bytes, max_values: int = MAX_VALUES) -> JsonValue:
    """Parse JSON: no NaN or Infinity, numbers within float64, valid Unicode without NUL, bounded depth and number of
    values.

    Raises: BadJson.
    """
    _check_text(text, max_values)
    try:
        parsed: JsonValue = json.loads(text, parse_constant=_no_constant, parse_float=_finite)
        if _ESCAPED.search(text):
            _check_characters(json.dumps(parsed, ensure_ascii=False))
    except (ValueError, RecursionError) as error:
        raise BadJson("The body is not JSON.", field="body", remedy=f"Correct it: {error}.") from None
    return parsed


def check_value(value: object, max_values: int = MAX_VALUES) -> None:
    """Refuse a JSON value that `strict_json` would not return for its depth or number of values. Raises BadJson."""
    try:
        text = json.dumps(value, ensure_ascii=False)
    except RecursionError:
        raise _too_deep("") from None
    _check_text(text.encode("utf-8", "surrogatepass"), max_values)


def _check_characters(dumped: str) -> None:
    dumped.encode()
    if "\\u0000" in dumped:
        raise BadJson("The body contains a NUL character.", field="body", remedy="Remove it.")


def _check_text(text: bytes, max_values: int) -> None:
    """Refuse too many values and deep nesting before a parser reads them. Brackets inside strings do not count."""
    bare = _STRINGS.sub(b"", text)
    values = 1 + sum(bare.count(mark) for mark in (b",", b":", b"[", b"{"))
    if values > max_values:
        raise _too_many(max_values, values)
    brackets = bare.translate(None, _NO_BRACKETS)
    depth = max(accumulate(map(_STEP.__getitem__, brackets)), default=0)
    if depth > MAX_DEPTH:
        raise _too_deep(depth)


@dataclass
class Budget:
    """Remaining number of values and bytes that may be copied or checked."""

    values: int
    bytes: int

    def spend(self, value: object) -> None:
        """Count a value with everything in it. Raises BadJson as soon as the budget is used up, or beyond
        `MAX_DEPTH`."""
        level: list[object] = [value]
        for _ in range(MAX_DEPTH + 1):
            if not level:
                return
            level = [inner for outer in level for inner in self._count(outer)]
        raise _too_deep(f"more than {MAX_DEPTH}")

    def _count(self, value: object) -> list[object]:
        """Count one value without those in it, which are returned."""
        names = list(value) if isinstance(value, dict) else []
        inner = list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else []
        self.values -= 1 + len(names)
        self.bytes -= 4 + len(value) if isinstance(value, str) else 8 + sum(map(len, names))
        if min(self.values - len(inner), self.bytes) < 0:
            raise _too_many("the permitted number of", "")
        return inner


def _too_many(most: object, value: object) -> BadJson:
    return BadJson(f"These are more than {most} values.", field="body", value=value, remedy="Send fewer values.")


def _too_deep(depth: object) -> BadJson:
    return BadJson(
        f"The body nests deeper than {MAX_DEPTH} levels.", field="body", value=depth, remedy="Nest less deeply."
    )


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is too large for a number")
    return number
