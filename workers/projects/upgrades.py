"""Reads documents of schema 1, in which a layer had a member for each part of a built-in method (`LayerPart.former`).

Stored versions, exported projects and documents of clients are read through `upgraded`; nothing stored is rewritten
until it is saved. Where each member went, `moved` says to whoever still uses its name.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from pipeline.methods import layer_parts
from workers.contract.request import Json
from workers.projects.document import SCHEMA
from workers.projects.faults import Path

_IN_LAYER = re.compile(r"^((?:/shots/[^/]+/layers/[^/]+)|(?:/variants/[^/]+/set))/([^/]+)(.*)$")


def _former() -> dict[str, Path]:
    """Former member of a layer -> its present place in a layer."""
    parts = layer_parts().values()
    return {
        member: ("parts", part.name, *([inner] if inner else []))
        for part in parts for member, inner in part.former.items()
    }  # fmt: skip


def moved(pointer: str) -> str:
    """The present JSON Pointer of a former member, or of something in it; empty if the pointer names none."""
    found = _IN_LAYER.match(pointer)
    if found is None or found[2] not in _former():
        return ""
    return "/".join([found[1], *map(str, _former()[found[2]])]) + found[3]


def upgraded(document: Json) -> Json:
    """The document in the present schema. A malformed one is changed as far as it can be understood."""
    if not isinstance(document, dict) or document.get("schema") != SCHEMA - 1:
        return document
    shots = _each(document, "shots", lambda shot: _each(shot, "layers", _layer))
    return {**_each(shots, "variants", _variant), "schema": SCHEMA}


def _each(owner: Json, member: str, change: Callable[[Json], Json]) -> Json:
    items = owner.get(member)
    if not isinstance(items, list):
        return owner
    return {**owner, member: [change(item) if isinstance(item, dict) else item for item in items]}


def _variant(variant: Json) -> Json:
    change = variant.get("set")
    return {**variant, "set": _layer(change)} if isinstance(change, dict) else variant


def _layer(layer: Json) -> Json:
    """A layer, or a merge patch on one, with its former members in `parts`."""
    former = _former()
    kept = {name: value for name, value in layer.items() if name not in former}
    parts: Json = {}
    for name in [name for name in layer if name not in kept]:
        if layer[name] is None and "id" in layer:
            continue  # in a document, but not in a patch, null meant that there is none
        _, part, *inner = former[name]
        if inner:
            parts.setdefault(str(part), {})[str(inner[0])] = layer[name]
        else:
            parts[str(part)] = layer[name]
    given = layer.get("parts")
    return {**kept, "parts": parts | (given if isinstance(given, dict) else {})} if parts else kept
