"""The laws as functions of a case: each returns a sentence if the case breaks it, otherwise nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from pipeline.errors import ImpastoError
from tests.laws import ways
from tests.laws.cases import SEE_LEAD, Case, drawn_value, properties_of
from tests.laws.ways import WAYS, difference

Verdict = str | None


def film_is_painted(case: Case) -> ways.Frames | str:
    """The film, or why the case has none: it must then be a fault that its own error names."""
    try:
        return ways.film(case)
    except ImpastoError as error:
        return f"{error.field}: {error.message}"


def piece_is_film(case: Case) -> Verdict:
    """Frames [a, b) painted alone are those of the film."""
    if "preroll" in case.chosen.Params.model_fields:
        case = case.with_params(preroll=SEE_LEAD)
    film = film_is_painted(case)
    if isinstance(film, str):
        return None
    piece = ways.piece(case)
    if sorted(piece) != list(range(*case.piece)):
        return f"the piece {case.piece} has the frames {sorted(piece)}"
    found = difference(piece, film)
    return f"the piece {case.piece} differs by {found:.2f} levels" if found and is_exact(case) else None


def is_exact(case: Case) -> bool:
    """Whether a piece has the bytes of the film: it paints the memory of the film, or depends on drawn keys only."""
    params, given = case.parsed, set(case.inputs)
    if "preroll" in type(params).model_fields or params.temporal == "off":
        return True
    keyed = given >= {"keyframes"} and (not case.cut or (1 < case.cut <= 4 < case.frames))
    return keyed or bool(given & {"masks", "labels", "label_intervals", "styles"} and case.method == "patches")


def every_way_is_the_same(case: Case) -> Verdict:
    """Each way has the frames of the film, or refuses by name what it cannot do."""
    film = film_is_painted(case)
    if isinstance(film, str):
        return None
    way = WAYS[case.seed % len(WAYS)]
    if not way.takes(case):
        return None
    found = difference(film, way.frames(case))
    return f"the way {way.name} differs by {found:.2f} levels" if found else None


def idle_is_said(case: Case) -> Verdict:
    """What is said to have no effect has none. (What has one is checked for every parameter and input by itself.)"""
    film = film_is_painted(case)
    draw = np.random.default_rng(case.seed)
    properties = properties_of(case.chosen)
    conditions = case.chosen.Params.applies_when
    names = sorted(conditions) or sorted(properties)
    name = names[int(draw.integers(len(names)))]
    changed = case.with_params(**{name: drawn_value(properties[name], name, draw)})
    idle = {found.field for found in changed.chosen.ineffective(changed.parsed, {"video", *case.inputs}, False, False)}
    if isinstance(film, str) or f"params.{name}" not in idle:
        return None
    plain = ways.film(replace(case, params={k: v for k, v in case.params.items() if k != name}))
    found = difference(plain, ways.film(changed))
    return f"{name} is said to have no effect, and changes {found:.2f} levels" if found else None


LAWS: Mapping[str, Callable[[Case], Verdict]] = {
    law.__name__: law for law in (piece_is_film, every_way_is_the_same, idle_is_said)
}
