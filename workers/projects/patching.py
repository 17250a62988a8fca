"""Changes to a document: JSON Patch (RFC 6902) and JSON Merge Patch (RFC 7396)."""

from __future__ import annotations

from jsonpatch import JsonPatch, JsonPatchException
from jsonpointer import JsonPointerException
from pydantic import JsonValue

from pipeline.errors import BadInput
from workers.model import Json

MAX_OPERATIONS = 10_000


class BadPatch(BadInput):
    """A patch cannot be read, or does not fit the document."""

    code = "bad-patch"


def patched(document: Json, operations: object) -> JsonValue:
    """The document after all operations of a JSON Patch.

    Raises:
        BadPatch: an operation is malformed, its location does not exist, or a test fails.
    """
    if not isinstance(operations, list) or len(operations) > MAX_OPERATIONS:
        raise BadPatch(
            f"A JSON Patch is a list of at most {MAX_OPERATIONS} operations.", field="body",
            remedy='For example [{"op": "replace", "path": "/name", "value": "Swan"}].',
        )  # fmt: skip
    try:
        changed: JsonValue = JsonPatch(operations).apply(document)
        return changed
    except (JsonPatchException, JsonPointerException, TypeError, ValueError) as error:
        raise BadPatch(
            f"The patch cannot be applied: {error}.", field="body", remedy="Load the document and send a new patch."
        ) from None


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
