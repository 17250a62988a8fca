"""Patches that grow: refused while they grow, with bounded memory and time."""

from __future__ import annotations

import time
import tracemalloc
from typing import Any

import pytest

from pipeline.errors import ImpastoError
from workers.projects.patching import MAX_OPERATIONS, patched

START: dict[str, Any] = {"name": "x", "ui": {"a": ["x" * 1000], "o": {"k": 1}, "many": [0] * 200_000}}
DOUBLED = {"op": "copy", "from": "/ui/a", "path": "/ui/a/-"}
NESTED = {"op": "copy", "from": "/ui/o", "path": "/ui/o/k"}
SELF = {"op": "copy", "from": "", "path": "/ui/o/k"}
FRONT = {"op": "add", "path": "/ui/many/0", "value": 1}
BOMBS = {
    "an array is copied into itself": [DOUBLED] * 24,
    "an object is copied into itself": [NESTED] * 70,
    "the document is copied into itself": [SELF] * 24,
    "many empty lists are copied": [
        {"op": "add", "path": "/ui/e", "value": [[]] * 1000},
        *[{"op": "copy", "from": "/ui/e", "path": "/ui/e/-"}] * 20,
    ],
    "a chain grows by moves": [
        *[{"op": "add", "path": f"/ui/c{n}", "value": {"k": {}}} for n in range(300)],
        *[{"op": "move", "from": f"/ui/c{n}", "path": f"/ui/c{n + 1}/k/k"} for n in range(299)],
    ],
    "a pointer is deep": [{"op": "test", "path": "/a" * 2_000_000, "value": 1}],
    "an index has many digits": [{"op": "remove", "path": "/ui/a/" + "9" * 1_000_000}],
    "too many operations": [FRONT] * (MAX_OPERATIONS + 1),
    "a failed test shows both values": [{"op": "test", "path": "", "value": START["ui"]}],
}


@pytest.mark.parametrize("operations", BOMBS.values(), ids=BOMBS.keys())
def test_a_patch_that_grows_is_refused_while_it_grows(operations: list[Any]) -> None:
    began_s = time.thread_time()
    tracemalloc.start()
    try:
        with pytest.raises(ImpastoError) as refused:
            patched(START, operations)
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak_bytes < 100 << 20
    assert len(str(refused.value)) < 1000
    assert time.thread_time() - began_s < 20, "under tracemalloc, which takes some ten times as long"


def test_insertions_at_the_front_of_a_long_array_take_bounded_time() -> None:
    began_s = time.thread_time()
    assert patched(START, [FRONT] * MAX_OPERATIONS)["ui"]["many"][:2] == [1, 1]  # type: ignore[index, call-overload]
    assert time.thread_time() - began_s < 5


def test_a_layer_can_be_copied() -> None:
    made: Any = patched(START, [DOUBLED, {"op": "move", "from": "/ui/o", "path": "/ui/p"}])
    assert len(made["ui"]["a"]) == 2 and "o" not in made["ui"]
