"""Law 4 within documents: every member of a JSON input that an editor changes has an effect.

What is changed is data: `DOCUMENTS` has a document whose members all count, `CHANGES` another value of each. The
numbers of styles that the studio has sliders for take part by themselves.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from pipeline.methods import method
from pipeline.methods.local import LocalContext, run_plan
from tests.laws.cases import Case
from tests.laws.ways import Frames, difference

FRAMES = 6
Given = tuple[str, str]
"""Method and input."""

_LEFT = [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]
DOCUMENTS: Mapping[Given, Any] = {
    ("multistyle", "design"): {
        "version": 1,
        "regions": {"left": {"polygons": [{"frame": 1, "points": _LEFT}], "border": "plain"}},
        "styles": {"own": {"base": "pointillism", "size": 30, "technique": {"overlap": 3}}},
        "keys": [
            {"region": "left", "frame": 0, "style": "van-gogh", "set": {"size": 60}, "ease": "linear"},
            {"region": "left", "frame": 5, "style": "own", "set": {"hue": 90}},
        ],
        "directions": [
            {
                "region": "left", "frame": 0, "edge_weight": 0.2, "follow": True, "free": False, "ease": "linear",
                "elements": [
                    {"pattern": "wedge", "at": [0.2, 0.3], "angle": 10, "reach": 0.3, "strength": 1},
                    {"pattern": "regular", "at": [0.4, 0.8], "angle": 100, "reach": "everywhere", "strength": 0.5},
                ],
            },
            {"region": "left", "frame": 5, "elements": [{"pattern": "node", "at": [0.2, 0.5]}]},
            {"region": "rest", "frame": 0, "elements": [{"pattern": "regular", "at": [0.7, 0.5], "angle": 45}]},
        ],
        "corrections": [{"region": "left", "frame": 1, "points": [[0.7, 0.2], [0.8, 0.4]], "width": 0.2}],
    },
}  # fmt: skip
CHANGES: Mapping[Given, Mapping[str, Any]] = {
    ("multistyle", "design"): {
        "regions.left.border": "soft", "regions.left.polygons.0.points": [[0, 0], [0.3, 0], [0.3, 1]],
        "styles.own.base": "watercolor", "styles.own.size": 60, "styles.own.technique.overlap": 6,
        "keys.0.style": "expressionism", "keys.0.frame": 3, "keys.0.ease": "out", "keys.1.set.hue": -90,
        "directions.0.edge_weight": 0.9, "directions.0.follow": False, "directions.0.free": True,
        "directions.0.ease": "hold", "directions.0.elements.0.pattern": "trisector",
        "directions.0.elements.0.at": [0.4, 0.6], "directions.0.elements.0.angle": 80,
        "directions.0.elements.0.reach": "everywhere", "directions.0.elements.0.strength": 4,
        "corrections.0.region": "rest", "corrections.0.frame": 4, "corrections.0.width": 0.5,
        "corrections.0.points": [[0.9, 0.8]],
    },
}  # fmt: skip


def members() -> Iterator[tuple[str, str, str]]:
    """(method, input, path) of every member that is changed."""
    for (name, given), changes in CHANGES.items():
        yield from ((name, given, path) for path in changes)
        yield from ((name, given, f"keys.0.set.{one}") for one in _sliders(name))


def _sliders(name: str) -> dict[str, tuple[float, float]]:
    """The numbers of styles that the studio has sliders for, with their ranges."""
    sections = method(name).studio.sections
    return {one.name: (one.minimum, one.maximum) for section in sections for one in section.sliders}


def effect_of_member(name: str, given: str, path: str) -> float:
    """Mean change of the film by another value of a member, gray levels."""
    base, leaf = DOCUMENTS[name, given], path.rpartition(".")[2]
    values = [CHANGES[name, given][path]] if path in CHANGES[name, given] else list(_sliders(name)[leaf])
    first = _film(name, given, "", None)
    changes = (difference(first, _film(name, given, path, value)) for value in values if value != _at(base, path))
    return max(changes)


def _at(document: Any, path: str) -> Any:
    for step in path.split("."):
        document = document[int(step)] if step.isdigit() else document.get(step)
    return document


def _film(name: str, given: str, path: str, value: Any) -> Frames:
    return _painted(name, given) if not path else _paint(name, given, _with(DOCUMENTS[name, given], path, value))


@cache
def _painted(name: str, given: str) -> Frames:
    return _paint(name, given, DOCUMENTS[name, given])


def _paint(name: str, given: str, document: Any) -> Frames:
    case = replace(Case(7, name, {}, (given,), FRAMES, 0, (1, 2)), scale=2)
    context = LocalContext(case.parsed, case.film(), {**case.given(), given: document}, seed=case.seed)
    run_plan(case.chosen, context)
    return context.emitted


def _with(document: Any, path: str, value: Any) -> Any:
    changed = copy.deepcopy(document)
    way, _, leaf = path.rpartition(".")
    owner = _at(changed, way)
    owner[int(leaf) if leaf.isdigit() else leaf] = value
    return changed
