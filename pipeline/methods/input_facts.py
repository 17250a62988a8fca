"""Facts about inputs that need no decoding (sizes, lengths, numbers), and the sizes and lengths that must agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pydantic import JsonValue

from pipeline.errors import BadInput
from pipeline.methods.previews import InputFault


@dataclass(frozen=True)
class Fits:
    """Other inputs whose size or length an input must match.

    Attributes:
        size: the input whose frame size it must have; aspect: the input whose aspect ratio it must have.
        frames: the input of whose frames it needs one for each; exactly: and no more.
    """

    size: str = ""
    aspect: str = ""
    frames: str = ""
    exactly: bool = False


ANY = Fits()
"""Nothing."""


@dataclass(frozen=True)
class InputFacts:
    """Facts of an input.

    Attributes:
        width, height: px; frames: frame count; 0: unknown.
        numbers: frames to which numbered images belong; None: unknown, or not numbered.
        document: a parsed JSON document.
    """

    width: int = 0
    height: int = 0
    frames: int = 0
    numbers: frozenset[int] | None = None
    document: JsonValue = None


def checked(read: Callable[[JsonValue], object]) -> Callable[..., list[InputFault]]:
    """A `InputCheck` from a function that reads a document and raises BadInput for the first fault, with its path from
    "inputs.NAME" on."""

    def check(document: JsonValue, *, frames: int | None, masks: bool | None) -> list[InputFault]:
        try:
            read(document)
        except BadInput as error:
            path = error.field.replace("[", ".").replace("]", "").split(".")[2:]
            parts = tuple(int(part) if part.isdecimal() else part for part in path)
            return [InputFault(parts, error.message, error.value, error.remedy)]
        return []

    return check
