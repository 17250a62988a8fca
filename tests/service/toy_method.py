"""A method with one parameter of each kind, for tests that must not depend on a real method."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field

from pipeline.methods.base import Example, InputSpec, Method, Params, Step


class ToyParams(Params):
    sigma_px: float = Field(default=1.5, ge=0, le=10, json_schema_extra={"unit": "px", "symbol": "sigma"})
    mode: Literal["soft", "hard"] = "soft"
    lines: bool = True


class Toy(Method):
    name: ClassVar[str] = "toy"
    title: ClassVar[str] = "Toy <method>"
    summary: ClassVar[str] = "Does nothing."
    paper: ClassVar[str] = "nobody"
    Params: ClassVar[type[Params]] = ToyParams
    inputs: ClassVar[tuple[InputSpec, ...]] = (InputSpec("video", "video", True, "Video", "What is painted."),)
    steps: ClassVar[tuple[Step[Any], ...]] = (Step("paint", "Paint", lambda context: (), lambda task, context: {}),)
    artefacts: ClassVar[tuple[str, ...]] = ("svg", "regions")
    examples: ClassVar[tuple[Example, ...]] = (Example("hard", "Hard", {"mode": "hard"}),)
