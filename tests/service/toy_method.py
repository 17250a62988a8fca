"""A method with a parameter of each kind, for tests that must not depend on a real one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal

from pydantic import Field

from pipeline.frames import Frame
from pipeline.methods.base import Example, InputSpec, Params, Session, Step


class ToyParams(Params):
    sigma_px: float = Field(default=1.5, ge=0, le=10, json_schema_extra={"unit": "px", "symbol": "sigma"})
    mode: Literal["soft", "hard"] = "soft"
    lines: bool = True


class Toy:
    name: ClassVar[str] = "toy"
    title: ClassVar[str] = "Toy <method>"
    summary: ClassVar[str] = "Does nothing."
    paper: ClassVar[str] = "nobody"
    Params: ClassVar[type[Params]] = ToyParams
    inputs: ClassVar[tuple[InputSpec, ...]] = (InputSpec("video", "video", True, "Video", "What is painted."),)
    steps: ClassVar[tuple[Step, ...]] = (Step("paint", "Paint", lambda brief: (), lambda task, bench: {}),)
    artefacts: ClassVar[tuple[str, ...]] = ("svg",)
    examples: ClassVar[tuple[Example, ...]] = (Example("hard", "Hard", {"mode": "hard"}),)

    def stream(
        self, params: Any, size: tuple[int, int], seed: int, references: Mapping[str, Iterator[Frame]]
    ) -> Session | None:
        return None
