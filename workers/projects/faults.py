"""Faults of a project document, collected with their locations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pipeline.errors import BadInput, ImpastoError

Path = tuple[str | int, ...]
"""Members and indices from the document's root."""


def pointer(path: Path) -> str:
    """The path as a JSON Pointer (RFC 6901)."""
    return "".join(f"/{str(part).replace('~', '~0').replace('/', '~1')}" for part in path)


def dotted(path: Path) -> str:
    """The path in dotted notation: shots[0].layers[1].method."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).lstrip(".")


@dataclass(frozen=True)
class DocumentFault:
    """One fault of a document.

    Attributes:
        path: JSON Pointer to the faulty member.
        field: the same location in dotted notation.
        code: stable, as in `pipeline.errors`.
        value: the member's value, shortened to 200 characters.
    """

    path: str
    field: str
    code: str
    message: str
    value: str | None = None
    remedy: str = ""


def fault(path: Path, message: str, *, value: object = None, remedy: str = "") -> DocumentFault:
    """A fault at `path`."""
    shown = None if value is None else str(value)[:200]
    return DocumentFault(pointer(path), dotted(path), "bad-input", message, shown, remedy)


def fault_at(path: Path, error: ImpastoError) -> DocumentFault:
    """An error that a check has raised, as a fault at `path`."""
    return DocumentFault(pointer(path), dotted(path), error.code, error.message, error.value, error.remedy)


class BadProject(BadInput):
    """A document has faults. `errors` holds all of them; the message and the field are those of the first one."""

    code = "bad-project"

    def __init__(self, errors: Sequence[DocumentFault]) -> None:
        first = errors[0]
        more = "" if len(errors) == 1 else f" There are {len(errors) - 1} more errors."
        super().__init__(f"{first.message}{more}", field=first.field, value=first.value, remedy=first.remedy)
        self.errors = tuple(errors)

    def __reduce__(self) -> tuple[object, ...]:
        return BadProject, (self.errors,)


def refuse_if_any(faults: Iterable[DocumentFault]) -> None:
    """Raise BadProject if there are faults."""
    if found := tuple(faults):
        raise BadProject(found)
