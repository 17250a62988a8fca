"""GET /v1/methods: the methods with the JSON Schema of their parameters and inputs."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Annotated, TypeVar

from fastapi import Path, Query
from pydantic import TypeAdapter
from starlette.responses import Response

from pipeline.errors import did_you_mean
from pipeline.methods import methods
from pipeline.methods.base import Method
from service.context.depends import Reader
from service.methods.schemas import MethodOut, MethodsOut, method_out
from service.methods.thumbnail import thumbnail
from service.routing import Router
from service.schemas import Responses
from workers.contract.request import Json
from workers.errors import NotFound

T = TypeVar("T")

router = Router(prefix="/v1/methods", tags=["methods"])

Name = Annotated[str, Path(max_length=64, description="A method's name.")]

InputName = Annotated[str, Path(max_length=64, description="The name of one of its inputs.")]

Frames = Annotated[int, Query(ge=1, le=10_000_000, description="Frames of the video.")]

PICTURE: Responses = {
    200: {"description": "The picture", "content": {"image/jpeg": {}, "image/svg+xml": {}}},
}


@router.get("", response_model=MethodsOut)
def list_methods(_caller: Reader) -> Response:
    """Every method."""
    return Response(_listing(*methods().values()), media_type="application/json")


@cache
def _listing(*found: Method) -> bytes:
    """The methods in JSON, cached, because every page requests them."""
    return TypeAdapter(MethodsOut).dump_json(MethodsOut(tuple(map(method_out, found))))


@router.get("/{name}")
def get_method(name: Name, _caller: Reader) -> MethodOut:
    """One method."""
    return method_out(_find(name))


@router.get("/{name}/thumbnail", response_class=Response, responses=PICTURE)
def get_thumbnail(name: Name, _caller: Reader) -> Response:
    """A picture that shows the method's effect."""
    picture = thumbnail(_find(name).name)
    return Response(picture.data, media_type=picture.media_type, headers={"Cache-Control": "private, max-age=3600"})


@router.get("/{name}/inputs/{input_name}/schema")
def get_input_schema(name: Name, input_name: InputName, _caller: Reader) -> Json:
    """The JSON Schema of a document that the method takes as input."""
    return _of_input(_find(name).input_schemas, input_name, "The method publishes no schema for such an input.")()


@router.get("/{name}/inputs/{input_name}/examples")
def get_input_examples(name: Name, input_name: InputName, _caller: Reader, frames: Frames) -> Json:
    """Example documents by name, for a video with that number of frames."""
    examples = _of_input(_find(name).input_examples, input_name, "The method has no examples for such an input.")
    return dict(examples(frames))


def _find(name: str) -> Method:
    try:
        return methods()[name]
    except KeyError:
        raise NotFound(
            f"Unknown method {name!r}.", field="name", value=name, remedy=did_you_mean(name, methods(), "methods")
        ) from None


def _of_input(offered: Mapping[str, T], input_name: str, missing: str) -> T:
    if input_name not in offered:
        remedy = f"There are: {', '.join(offered) or 'none'}."
        raise NotFound(missing, field="input_name", value=input_name, remedy=remedy)
    return offered[input_name]
