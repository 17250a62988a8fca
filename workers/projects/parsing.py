"""Parses JSON into a structurally valid document, or reports all faults."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from pipeline.methods import layer_parts, methods
from workers.contract.request import Json
from workers.projects.document import Document, Layer, Shot
from workers.projects.faults import BadProject, DocumentFault, Path, fault, pointer, refuse_if_any
from workers.projects.upgrades import moved, upgraded

_MOST_FAULTS = 1000


def parse_document(value: Json) -> Document:
    """The document, which may be of schema 1.

    Raises:
        BadProject: unknown members, wrong types, numbers out of range, repeated ids, names of assets that are not in
        `assets`. It contains all faults, at most 1,000 of the structure.
    """
    try:
        document = Document.model_validate(upgraded(value))
    except ValidationError as error:
        raise BadProject(structure_faults(error)) from None
    refuse_if_any(_faults(document))
    return document


def structure_faults(error: ValidationError, within: Path = ()) -> list[DocumentFault]:
    """Faults of the structure of a document, or of the part of it at `within`."""
    return [_fault(found, within) for found in error.errors(include_url=False)[:_MOST_FAULTS]]


def _fault(error: ErrorDetails, within: Path) -> DocumentFault:
    path: Path = (*within, *(part for part in error["loc"] if part != "[key]"))
    if error["type"] == "extra_forbidden" and (place := moved(pointer(path))):
        message = f"A layer has no member {path[-1]!r} since schema 2."
        return fault(path, message, value=error["input"], remedy=f"Use {place}.")
    if error["type"] == "missing":
        return fault(path, f"{path[-1]} is missing.", remedy="Give it.")
    if error["type"] == "extra_forbidden":
        return fault(path, f"There is no member {path[-1]!r} here.", value=error["input"], remedy="Leave it out.")
    return fault(path, f"{error['msg']}.", value=error["input"], remedy="See GET /v1/projects/schema.")


def _faults(document: Document) -> Iterator[DocumentFault]:
    shots = {shot.id: shot for shot in document.shots}
    yield from _twice(((shot.id for shot in document.shots)), ("shots",))
    yield from _twice((variant.id for variant in document.variants), ("variants",))
    for index, shot in enumerate(document.shots):
        yield from _of_shot(shot, ("shots", index))
    for index, variant in enumerate(document.variants):
        path: Path = ("variants", index)
        known = [layer.id for layer in shots[variant.shot].layers] if variant.shot in shots else []
        if variant.shot not in shots:
            yield fault((*path, "shot"), "Shot not found.", value=variant.shot, remedy="Name one of `shots`.")
        elif variant.layer not in known:
            yield fault((*path, "layer"), "Layer not found in the shot.", value=variant.layer, remedy="Name one of it.")
    for path, name in _names(document):
        if name not in document.assets:
            yield fault(path, f"There is no asset named {name!r}.", value=name, remedy="Add it to `assets`.")


def _of_shot(shot: Shot, path: Path) -> Iterator[DocumentFault]:
    if shot.range is not None and shot.range[0] >= shot.range[1]:
        yield fault((*path, "range"), "A range has at least one frame.", value=shot.range, remedy="Use [first, end).")
    yield from _twice((layer.id for layer in shot.layers), (*path, "layers"))
    for index, layer in enumerate(shot.layers):
        at = (*path, "layers", index)
        for part in layer.parts:
            yield from _twice((picture.frame for picture in layer.pictures(part)), (*at, "parts", part), "frame")
            if part not in layer_parts() and layer.method in methods():
                remedy = f"Use one of: {', '.join(layer_parts())}."
                yield fault((*at, "parts", part), "No method has such a part.", value=part, remedy=remedy)


def _twice(values: Iterable[Hashable], path: Path, member: str = "id") -> Iterator[DocumentFault]:
    earlier: set[Hashable] = set()
    for index, value in enumerate(values):
        if value in earlier:
            yield fault((*path, index, member), f"This {member} is used twice.", value=value, remedy="Use it once.")
        earlier.add(value)


def _names(document: Document) -> Iterator[tuple[Path, str]]:
    """(path, name) of every use of an asset."""
    for s, shot in enumerate(document.shots):
        yield ("shots", s, "video"), shot.video
        for k, layer in enumerate(shot.layers):
            yield from _names_of_layer(layer, ("shots", s, "layers", k))
    for v, variant in enumerate(document.variants):
        if variant.image is not None:
            yield ("variants", v, "image"), variant.image


def _names_of_layer(layer: Layer, path: Path) -> Iterator[tuple[Path, str]]:
    for member in ("source", "matte"):
        if (name := getattr(layer, member)) is not None:
            yield (*path, member), name
    for input_name, name in layer.inputs.items():
        yield (*path, "inputs", input_name), name
    for part in layer.parts:
        for index, picture in enumerate(layer.pictures(part)):
            for place, name in picture.assets():
                yield (*path, "parts", part, index, *place), name
