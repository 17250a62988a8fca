"""Changes to a document: JSON Patch (RFC 6902) and JSON Merge Patch (RFC 7396)."""

from __future__ import annotations

import json

from jsonpatch import JsonPatch, JsonPatchException
from jsonpointer import JsonPointerException, resolve_pointer
from pydantic import JsonValue

from pipeline.errors import BadInput
from workers.contract.request import Json
from workers.projects.document import MAX_DOCUMENT_BYTES
from workers.projects.upgrades import moved
from workers.strict_json import MAX_DEPTH, BadJson, Budget, check_value

MAX_OPERATIONS = 1000
MAX_COPIED_VALUES = 200_000
"""Maximum number of values that all operations `copy` of a patch may copy, besides `MAX_DOCUMENT_BYTES`."""
_LONGEST_REASON = 200
"""Characters of the library's explanation that are shown; it may contain the whole document."""


class BadPatch(BadInput):
    """A patch cannot be read, or does not fit the document."""

    code = "bad-patch"


def patched(document: Json, operations: object) -> JsonValue:
    """The document after all operations of a JSON Patch. Time and memory are bounded while it grows, by the number of
    operations, the size of their values, and what `copy` may copy.

    Raises:
        BadPatch: an operation is malformed, its location does not exist, a test fails, or too much is copied.
        BadJson: the result is deeper or has more values than a document may have.
    """
    if not isinstance(operations, list) or len(operations) > MAX_OPERATIONS:
        raise BadPatch(
            f"A JSON Patch is a list of at most {MAX_OPERATIONS} operations.", field="body",
            remedy='For example [{"op": "replace", "path": "/name", "value": "Swan"}].',
        )  # fmt: skip
    changed: JsonValue = json.loads(json.dumps(document))
    budget = Budget(MAX_COPIED_VALUES, MAX_DOCUMENT_BYTES)
    for index, operation in enumerate(operations):
        try:
            _spend(budget, changed, operation, index)
            changed = JsonPatch([operation]).apply(changed, in_place=True)
        except BadPatch:
            raise
        except (BadJson, JsonPatchException, JsonPointerException, TypeError, ValueError) as error:
            raise BadPatch(
                f"The patch cannot be applied: {str(error)[:_LONGEST_REASON]}.", field=f"body.{index}",
                remedy="Load the document and send a new patch.",
            ) from None  # fmt: skip
    check_value(changed)
    return changed


def _spend(budget: Budget, document: JsonValue, operation: Json, index: int) -> None:
    """Refuse pointers that are deeper than a document, and count what `copy` copies."""
    if not isinstance(operation, dict):
        raise ValueError("an operation is an object")
    for name in ("path", "from"):
        pointer = operation.get(name, "")
        if not isinstance(pointer, str):
            raise ValueError(f"{name!r} is not a text")
        if pointer.count("/") > MAX_DEPTH:
            raise ValueError(f"a location is deeper than {MAX_DEPTH} levels")
        if place := moved(pointer):
            raise BadPatch(
                "A document has no such location since schema 2.", field=f"body.{index}.{name}", value=pointer,
                remedy=f"Use {place}.",
            )  # fmt: skip
    if operation.get("op") == "copy":
        budget.spend(resolve_pointer(document, operation.get("from", "")))


def merged(document: JsonValue, patch: JsonValue) -> JsonValue:
    """The document after a JSON Merge Patch: objects are merged member by member, null removes a member, any other
    value replaces it."""
    if not isinstance(patch, dict):
        return patch
    result = dict(document) if isinstance(document, dict) else {}
    for name, value in patch.items():
        if value is None:
            result.pop(name, None)
        else:
            result[name] = merged(result.get(name), value)
    return result
