"""Response bodies of methods."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.methods.base import Example, InputSpec, MadePass, Method, Studio
from pipeline.methods.studio import PreviewKind
from workers.contract.request import Json


@dataclass(frozen=True)
class StepOut:
    name: str
    title: str


@dataclass(frozen=True)
class PartOut:
    name: str
    """In `parts` of a project's layer; GET /v1/projects/schema has its JSON Schema."""
    title: str


@dataclass(frozen=True)
class MethodOut:
    name: str
    title: str
    summary: str
    paper: str
    """Key of the paper in references.bib."""
    inputs: tuple[InputSpec, ...]
    params_schema: Json
    """JSON Schema; properties have the keywords `unit` and `symbol` (the paper's) where they apply."""
    defaults: Json
    examples: tuple[Example, ...]
    artefacts: tuple[str, ...]
    """Optional artefacts, for `output.artefacts` of a job."""
    makes_passes: tuple[MadePass, ...]
    """Passes beside the film, for `output.passes` of a job."""
    steps: tuple[StepOut, ...]
    parts: tuple[PartOut, ...]
    previews: tuple[PreviewKind, ...]
    """Kinds of previews that the service makes of layers of the method."""
    studio: Studio
    thumbnail: str
    """Path of a thumbnail."""


@dataclass(frozen=True)
class MethodsOut:
    items: tuple[MethodOut, ...]
    cursor: None = None


def method_out(method: Method) -> MethodOut:
    return MethodOut(
        name=method.name,
        title=method.title,
        summary=method.summary,
        paper=method.paper,
        inputs=method.inputs,
        params_schema=method.Params.model_json_schema(),
        defaults=method.Params().model_dump(mode="json"),
        examples=method.examples,
        artefacts=method.artefacts,
        makes_passes=method.makes_passes,
        steps=tuple(StepOut(step.name, step.title) for step in method.steps),
        parts=tuple(PartOut(part.name, part.title) for part in method.parts),
        previews=method.preview_kinds(),
        studio=method.studio,
        thumbnail=f"/v1/methods/{method.name}/thumbnail",
    )
