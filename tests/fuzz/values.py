"""Random changes of JSON values, texts and headers, as a hostile client would send them."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

Random = np.random.Generator
HOSTILE: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 0.5, 1e308, -1e-308, 2**31, 2**63, -(2**63), 2**200, [], {}, [[]], [{}],
    [None] * 40, {"": ""}, {"a": {"a": {}}}, "", " ", "a", "0", "-1", "null", "../../etc/passwd",
    "..\\..\\", "\u0000", "%00", "%",
    "\ud7ff\U0010ffff", "\u202e", "a" * 300, "${7*7}", "'; DROP TABLE jobs; --", "<script>", "http://[::1]/",
    "file:///etc/passwd", "2026-13-45T99:99:99Z", "NaN", "1e999", "\u00b2", "\u0663", "=?utf-8?b?AA?=",
)  # fmt: skip


def pick(random: Random, values: Any) -> Any:
    """One of the values."""
    return values[int(random.integers(len(values)))]


def hostile(random: Random) -> Any:
    """A copy of one of the hostile values."""
    return copy.deepcopy(pick(random, HOSTILE))


def changed_json(value: Any, random: Random, changes: int = 2) -> Any:
    """A copy in which up to `changes` places are replaced, removed, added, repeated or exchanged."""
    found = copy.deepcopy(value)
    for _ in range(int(random.integers(1, changes + 1))):
        found = _change(found, random)
    return found


def _change(value: Any, random: Random) -> Any:
    places = list(_places(value, ()))
    path = pick(random, places)
    if not path:
        return hostile(random) if random.random() < 0.1 else value
    parent = value
    for step in path[:-1]:
        parent = parent[step]
    what, last = int(random.integers(5)), path[-1]
    if what == 0:
        del parent[last]
    elif what == 1 and isinstance(parent, dict):
        parent[str(hostile(random))[:40]] = hostile(random)
    elif what == 2:
        other = pick(random, places)
        lent = value
        for step in other:
            lent = lent[step] if isinstance(lent, list | dict) and _has(lent, step) else None
        parent[last] = copy.deepcopy(lent)
    else:
        parent[last] = hostile(random)
    return value


def _has(parent: Any, step: Any) -> bool:
    return step in parent if isinstance(parent, dict) else isinstance(step, int) and step < len(parent)


def _places(value: Any, path: tuple[Any, ...]) -> Any:
    yield path
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _places(item, (*path, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _places(item, (*path, index))


def changed_text(text: str, random: Random) -> str:
    """A text with one change: a character, a repetition, a cut, a hostile value beside it or instead of it."""
    what, at = int(random.integers(6)), int(random.integers(len(text) + 1))
    if what == 0:
        return text[:at] + chr(int(random.integers(1, 0x2FF))) + text[at + 1 :]
    if what == 1:
        return text[:at]
    if what == 2:
        return text * int(random.integers(2, 20))
    if what == 3:
        return text[:at] + str(hostile(random)) + text[at:]
    return str(hostile(random)) if what == 4 else text[::-1]
